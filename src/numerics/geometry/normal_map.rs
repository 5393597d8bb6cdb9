//! Any visible surface, as a normal a pixel.

use super::{Ray, SurfacePoint, Vec3};
use crate::numerics::image::Image;

/// Normals, and where they are known the points, of what each pixel shows. The surface casts no shadow on itself here:
/// leave out such pixels by a mask.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalMap {
    /// Outward normals in the camera frame, of any length; zero beside the object.
    pub normals: Image<[f32; 3]>,
    /// Surface points in the camera frame, mm, of the same size. Without them a point is taken to be where its ray begins:
    /// right in x and y, and z = 0, before an orthographic camera; of no use before a pinhole.
    pub positions: Option<Image<[f32; 3]>>,
}

impl NormalMap {
    /// The point that the pixel in column `x`, row `y` shows; none beside the object or the map.
    pub fn at(&self, x: usize, y: usize, ray: &Ray) -> Option<SurfacePoint> {
        let at = |map: &Image<[f32; 3]>| {
            let inside = x < map.width && y < map.height;
            inside.then(|| Vec3::from(map.at(x, y).map(f64::from)))
        };
        let normal = at(&self.normals)?.try_normalize(0.0)?;
        let position = match &self.positions {
            Some(positions) => at(positions)?,
            None => ray.origin,
        };
        Some(SurfacePoint { position, normal, view: -ray.direction })
    }
}
