//! A checked mesh as glTF 2.0 in one piece (.glb): what a viewer draws, and any other program reads.

use crate::numerics::geometry::Vec3;
use crate::numerics::render::mesh::Mesh;
use serde_json::{Value, json};

/// Numbers of the format: its name, its version, the kinds of its two parts, and of what the numbers are.
const MAGIC: u32 = 0x4654_6c67;
const VERSION: u32 = 2;
const JSON: u32 = 0x4e4f_534a;
const BINARY: u32 = 0x004e_4942;
const FLOAT: u32 = 5126;
const UNSIGNED: u32 = 5125;

/// The bytes of a .glb file. Its vertices are single precision, so they lie about the mesh's middle, in lengths of its radius; the
/// scale and the translation of its one node put them back. `extras` of the node say `extent` (longest side of the box around it,
/// mesh's unit), `dropped` (triangles without area, left out) and `textured`. A normal is zero where a vertex has none.
pub fn write(mesh: &Mesh) -> Vec<u8> {
    let parts = mesh.parts();
    let (middle, radius) = (mesh.middle(), mesh.radius());
    let positions: Vec<[f32; 3]> = parts.positions.iter().map(|p| single(&((p - middle) / radius))).collect();
    let mut body = Body::default();
    let (low, high) = bounds(&positions);
    let position = body.add("VEC3", FLOAT, positions.len(), positions.iter().flatten().map(|v| v.to_bits()));
    body.accessors[position]["min"] = json!(low);
    body.accessors[position]["max"] = json!(high);
    let normals = parts.normals.iter().flat_map(|n| single(n).map(f32::to_bits));
    let normal = body.add("VEC3", FLOAT, parts.normals.len(), normals);
    let mut attributes = json!({"POSITION": position, "NORMAL": normal});
    if mesh.is_textured() {
        let uv = parts.uv.iter().flatten().map(|&v| (v as f32).to_bits());
        attributes["TEXCOORD_0"] = json!(body.add("VEC2", FLOAT, parts.uv.len(), uv));
    }
    let corners = parts.triangles.iter().flatten().copied();
    let indices = body.add("SCALAR", UNSIGNED, 3 * parts.triangles.len(), corners);
    body.finish(&json!({
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{
            "mesh": 0,
            "translation": [middle.x, middle.y, middle.z],
            "scale": [radius, radius, radius],
            "extras": {"extent": mesh.extent(), "dropped": mesh.dropped(), "textured": mesh.is_textured()},
        }],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices}]}],
    }))
}

fn single(v: &Vec3) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

fn bounds(points: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    points.iter().fold(([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]), |(low, high), p| {
        (std::array::from_fn(|i| low[i].min(p[i])), std::array::from_fn(|i| high[i].max(p[i])))
    })
}

/// The numbers, and where which lie.
#[derive(Default)]
struct Body {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Body {
    /// Adds numbers of four bytes each; the number of their accessor.
    fn add(&mut self, shape: &str, kind: u32, count: usize, words: impl Iterator<Item = u32>) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend(words.flat_map(u32::to_le_bytes));
        self.views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": self.bytes.len() - offset}));
        let view = self.accessors.len();
        self.accessors.push(json!({"bufferView": view, "componentType": kind, "count": count, "type": shape}));
        view
    }

    /// The file: header, description, numbers. The largest mesh there can be takes 216 MB: lengths fit.
    fn finish(self, scene: &Value) -> Vec<u8> {
        let mut description = scene.clone();
        description["asset"] = json!({"version": "2.0", "generator": concat!("rigd ", env!("CARGO_PKG_VERSION"))});
        description["buffers"] = json!([{"byteLength": self.bytes.len()}]);
        description["bufferViews"] = json!(self.views);
        description["accessors"] = json!(self.accessors);
        let mut text = description.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + text.len() + 8 + self.bytes.len();
        let words = [MAGIC, VERSION, total as u32, text.len() as u32, JSON];
        let mut file: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        file.reserve_exact(total - file.len());
        file.extend(text);
        file.extend([self.bytes.len() as u32, BINARY].iter().flat_map(|word| word.to_le_bytes()));
        file.extend(self.bytes);
        file
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic)]
    use super::super::{Format, read};
    use super::*;
    use crate::numerics::render::mesh::Parts;
    use crate::numerics::render::shapes;

    /// The crate `gltf` reads it, and every corner, normal and texture coordinate is back to a ten-millionth of the mesh's size,
    /// also far from the origin.
    #[test]
    fn a_mesh_comes_back() {
        let far = Vec3::new(4e5, -7e6, 12.0);
        for name in shapes::NAMES {
            let parts = shapes::by_name(name).unwrap();
            let positions = parts.positions.iter().map(|p| far + 1e-3 * p).collect();
            let mesh = Mesh::new(Parts { positions, ..parts }.used()).unwrap();
            let back = read(Format::Gltf, &write(&mesh), &|_| panic!("it opens another file")).unwrap();
            let (was, is) = (mesh.parts(), back.parts());
            assert_eq!((&is.triangles, is.uv.len()), (&was.triangles, was.uv.len()), "{name}");
            // The node's translation and scale are single precision in the crate: about its middle they cancel.
            let about = |mesh: &Mesh, p: &Vec3| (p - mesh.middle()) / mesh.radius();
            for (p, q) in was.positions.iter().zip(&is.positions) {
                assert!((about(&mesh, p) - about(&back, q)).norm() < 3e-6, "{name}: {p} {q}");
            }
            for (n, m) in was.normals.iter().zip(&is.normals) {
                assert!((n - m).norm() < 1e-6, "{name}: {n} {m}");
            }
            for (a, b) in was.uv.iter().flatten().zip(is.uv.iter().flatten()) {
                assert!((a - b).abs() < 1e-6, "{name}: {a} {b}");
            }
        }
    }
}
