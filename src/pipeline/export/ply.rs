//! A surface as binary PLY (Turk 1994), single precision, little-endian.

use super::surface::Surface;

/// Which way the texture coordinate v of a program runs.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum V {
    /// From the top of the picture down.
    Down,
    /// From its bottom up.
    Up,
}

/// The file.
pub(super) fn ply(surface: &Surface, v: V) -> Vec<u8> {
    let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", surface.positions.len());
    ["x", "y", "z", "nx", "ny", "nz", "u", "v"].iter().for_each(|name| header += &format!("property float {name}\n"));
    header +=
        &format!("element face {}\nproperty list uchar int vertex_indices\nend_header\n", surface.triangles.len());
    let mut bytes = header.into_bytes();
    for ((position, normal), [u, down]) in surface.positions.iter().zip(&surface.normals).zip(&surface.uv) {
        let uv = [*u, if v == V::Down { *down } else { 1.0 - down }];
        for value in position.iter().chain(normal).chain(&uv) {
            bytes.extend(value.to_le_bytes());
        }
    }
    for corners in &surface.triangles {
        bytes.push(3);
        corners.iter().for_each(|corner| bytes.extend(corner.to_le_bytes()));
    }
    bytes
}
