//! A shape that wears the texture, in single precision as files hold it.

use crate::numerics::geometry::Vec3;
use crate::numerics::render::camera::View;
use crate::numerics::render::mesh::Mesh;
use crate::numerics::render::shapes;

/// Vertical field of view of scenes, degrees; with the light below it what `rigd render` takes unless told otherwise.
pub const FIELD_DEG: f64 = 30.0;
/// Towards the distant light of scenes, of any length.
pub const TO_LIGHT: [f64; 3] = [-0.3, 0.4, 1.0];
/// Its irradiance on a surface that faces it, radiance units.
pub const IRRADIANCE: f64 = 6.0;
/// Pixels a side of the picture of scenes.
pub const PIXELS: usize = 512;

/// A closed surface of triangles with texture coordinates; right-handed, y up, about the origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Vertices.
    pub positions: Vec<[f32; 3]>,
    /// Outward unit normals, one a vertex.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates, one a vertex, in tiles: 0 to 1 is the tile, u to the right, v down.
    pub uv: Vec<[f32; 2]>,
    /// Corners by vertex from 0, anticlockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// A view of the whole in a square picture.
    pub view: View,
}

impl Surface {
    /// A shape that comes with rigd, by its name; one unit of its own texture coordinates holds `repeats` tiles.
    pub fn of(name: &str, repeats: u16) -> Option<Self> {
        let mesh = Mesh::new(shapes::textured(name)?).ok()?;
        let parts = mesh.parts();
        let single = |v: &Vec3| [v.x as f32, v.y as f32, v.z as f32];
        let outward = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|corner| corner as usize);
            let normal = (parts.positions[b] - parts.positions[a]).cross(&(parts.positions[c] - parts.positions[a]));
            let agrees = normal.dot(&(parts.normals[a] + parts.normals[b] + parts.normals[c])) > 0.0;
            if agrees { *corners } else { [corners[0], corners[2], corners[1]] }
        };
        Some(Self {
            positions: parts.positions.iter().map(single).collect(),
            normals: parts.normals.iter().map(single).collect(),
            uv: parts.uv.iter().map(|uv| uv.map(|t| (f64::from(repeats) * t) as f32)).collect(),
            triangles: parts.triangles.iter().map(outward).collect(),
            view: View::of(&mesh, FIELD_DEG, (1, 1)),
        })
    }
}
