//! Wavefront OBJ, by the crate `tobj`.

use super::{MeshFileError, check_room, cut};
use crate::numerics::geometry::Vec3;
use crate::numerics::render::mesh::Parts;
use crate::pipeline::contain::contained;
use tobj::{LoadError, LoadOptions, Model};

/// All surfaces of a file. Polygons are cut into triangles, points and lines passed over. Normals and texture coordinates of
/// a part of which only some corners have them do not count.
pub fn read(bytes: &[u8]) -> Result<Parts, MeshFileError> {
    let unreadable = |reason: String| MeshFileError::Unreadable { format: "OBJ", reason: cut(reason) };
    let (triangles, vertices) = count(bytes);
    // Normals and texture coordinates are lists of their own; together with the positions they are what memory is taken for.
    check_room(triangles, vertices)?;
    let options = LoadOptions { triangulate: true, single_index: true, ignore_points: true, ignore_lines: true };
    let load = || tobj::load_obj_buf(&mut &*bytes, &options, |_| Err(LoadError::OpenFileFailed));
    let loaded = contained(load).ok_or_else(|| unreadable("the decoder gave up".to_owned()))?;
    let (models, _) = loaded.map_err(|error| unreadable(error.to_string()))?;
    let mut parts = Parts::default();
    for model in models {
        parts.append(surface(model))?;
    }
    Ok(parts)
}

/// Triangles, and the longest of the lists of numbers, as far as the first words of the lines tell.
fn count(bytes: &[u8]) -> (usize, usize) {
    let (mut triangles, mut lists) = (0, [0; 3]);
    for line in bytes.split(|&byte| byte == b'\n') {
        let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        match words.next() {
            Some(b"f") => triangles += words.count().saturating_sub(2).max(1),
            // They are passed over, but not before they were read.
            Some(b"l" | b"p") => triangles += words.count(),
            Some(b"v") => lists[0] += 1,
            Some(b"vt") => lists[1] += 1,
            Some(b"vn") => lists[2] += 1,
            _ => {}
        }
    }
    (triangles, lists.into_iter().max().unwrap_or(0))
}

fn surface(model: Model) -> Parts {
    let mesh = model.mesh;
    let vectors = |flat: &[f32]| flat.as_chunks().0.iter().map(|v: &[f32; 3]| Vec3::from(v.map(f64::from))).collect();
    let positions: Vec<Vec3> = vectors(&mesh.positions);
    let one_each = |numbers: usize, a_vertex: usize| numbers == a_vertex * positions.len();
    let normals = if one_each(mesh.normals.len(), 3) { vectors(&mesh.normals) } else { Vec::new() };
    let uv = if one_each(mesh.texcoords.len(), 2) { mesh.texcoords.as_chunks().0 } else { &[] };
    Parts {
        normals,
        // OBJ has v run up the picture.
        uv: uv.iter().map(|&[u, v]| [f64::from(u), 1.0 - f64::from(v)]).collect(),
        triangles: mesh.indices.as_chunks().0.to_vec(),
        positions,
    }
}
