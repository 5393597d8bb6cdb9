//! Meshes that come with rigd, made from formulas: a ball, a cylinder, and a knot of 70 000 triangles.

use super::mesh::Parts;
use crate::numerics::geometry::Vec3;
use std::f64::consts::{PI, TAU};

/// A mesh by its name.
pub fn by_name(name: &str) -> Option<Parts> {
    match name {
        "sphere" => Some(sphere(76)),
        "cylinder" => Some(cylinder()),
        "knot" => Some(knot(700, 50)),
        _ => None,
    }
}

/// A mesh by its name, with texture coordinates: the ball has them by longitude and latitude, where they run together at its poles.
pub fn textured(name: &str) -> Option<Parts> {
    if name == "sphere" { Some(globe()) } else { by_name(name) }
}

/// Their names.
pub const NAMES: [&str; 3] = ["sphere", "cylinder", "knot"];

/// A vertex: position, outward unit normal, texture coordinates.
type Vertex = (Vec3, Vec3, [f64; 2]);

/// Adds a sheet of `columns` x `rows` quadrilaterals; `vertex` is asked at s and t from 0 to 1.
fn sheet(parts: &mut Parts, columns: usize, rows: usize, vertex: impl Fn(f64, f64) -> Vertex) {
    let offset = parts.positions.len();
    for j in 0..=rows {
        for i in 0..=columns {
            let (position, normal, uv) = vertex(i as f64 / columns as f64, j as f64 / rows as f64);
            parts.positions.push(position);
            parts.normals.push(normal);
            parts.uv.push(uv);
        }
    }
    let at = |i: usize, j: usize| (offset + j * (columns + 1) + i) as u32;
    for j in 0..rows {
        for i in 0..columns {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            parts.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
}

/// A ball of radius 1 without texture coordinates: a cube of `side` x `side` quadrilaterals a face, blown up. It has no poles.
pub fn sphere(side: usize) -> Parts {
    let mut parts = Parts::default();
    for face in 0..6 {
        let [x, y, z] = [face / 2, (face / 2 + 1) % 3, (face / 2 + 2) % 3];
        sheet(&mut parts, side, side, |s, t| {
            // Equal angles rather than equal lengths on the cube: triangles of much the same size.
            let across = |s: f64| ((s - 0.5) * 0.5 * PI).tan();
            let mut point = Vec3::zeros();
            (point[x], point[y], point[z]) = (if face % 2 == 0 { 1.0 } else { -1.0 }, across(s), across(t));
            let normal = point.normalize();
            (normal, normal, [0.0; 2])
        });
    }
    parts.uv.clear();
    parts
}

/// A ball of radius 1 by longitude and latitude: two units of texture go around, one from pole to pole.
fn globe() -> Parts {
    let mut parts = Parts::default();
    sheet(&mut parts, 144, 72, |s, t| {
        let ((sin, cos), (across, up)) = ((TAU * s).sin_cos(), (PI * t).sin_cos());
        let normal = Vec3::new(across * sin, up, across * cos);
        (normal, normal, [2.0 * s, t])
    });
    parts
}

/// A cylinder of radius 1 and height 3 about the y axis, with its ends. One unit of texture is 3 wide and high; two go around,
/// stretched by a twentieth so that they meet.
fn cylinder() -> Parts {
    let (around, height) = (240, 3.0);
    let mut parts = Parts::default();
    let direction = |s: f64| Vec3::new((TAU * s).sin(), 0.0, (TAU * s).cos());
    sheet(&mut parts, around, 100, |s, t| {
        let normal = direction(s);
        (normal + (0.5 - t) * height * Vec3::y(), normal, [2.0 * s, t])
    });
    for up in [1.0, -1.0] {
        // From the centre outwards; where quadrilaterals meet in it, one of their triangles is left out by the mesh.
        sheet(&mut parts, around, 1, |s, t| {
            let out = t * direction(s);
            (out + up * 0.5 * height * Vec3::y(), up * Vec3::y(), [out.x / height, up * out.z / height])
        });
    }
    let positions = &parts.positions;
    parts.triangles.retain(|corners| {
        let [a, b, c] = corners.map(|corner| positions[corner as usize]);
        a != b && b != c && c != a
    });
    parts
}

/// A tube of radius 0.45 along a trefoil on a torus of radii 2 and 1, `along` x `about` quadrilaterals. One unit of texture goes
/// once about the tube, ten along it.
pub fn knot(along: usize, about: usize) -> Parts {
    let mut parts = Parts::default();
    sheet(&mut parts, along, about, |s, t| {
        let ((sin2, cos2), (sin3, cos3)) = ((2.0 * TAU * s).sin_cos(), (3.0 * TAU * s).sin_cos());
        let ring = Vec3::new(cos2, sin2, 0.0);
        let from_ring = cos3 * ring + sin3 * Vec3::z();
        let centre = 2.0 * ring + from_ring;
        let turned = Vec3::new(-sin2, cos2, 0.0);
        let tangent = (2.0 * (2.0 + cos3) * turned - 3.0 * sin3 * ring + 3.0 * cos3 * Vec3::z()).normalize();
        let side = tangent.cross(&from_ring).normalize();
        let out = side.cross(&tangent);
        let (sin, cos) = (TAU * t).sin_cos();
        let normal = cos * out + sin * side;
        (centre + 0.45 * normal, normal, [10.0 * s, t])
    });
    parts
}
