//! Normal and position maps of a dataset, checked against its camera.

use super::exr;
use crate::numerics::geometry::{NormalMap, Projection, Vec3};
use crate::numerics::image::Image;
use crate::store::files::shown;
use std::path::Path;

/// How far from its own pixel's centre a point may project, pixels. Maps made by rendering or by fitting a shape are good
/// to a fraction; another frame, unit or crop is off by far more.
const OFF_PIXEL: f64 = 2.0;

/// Reads the maps of an object; their size must be `size`. Refused with file, place and remedy.
pub(super) fn read(
    normals: &Path,
    positions: Option<&Path>,
    size: (usize, usize),
    projection: &Projection,
) -> Result<NormalMap, String> {
    let map = NormalMap {
        normals: vectors(normals, size)?,
        positions: positions.map(|path| vectors(path, size)).transpose()?,
    };
    check_normals(&map.normals, projection).map_err(|reason| format!("{}: {reason}", shown(normals)))?;
    if let (Some(path), Some(positions)) = (positions, &map.positions) {
        check_positions(positions, &map.normals, projection).map_err(|reason| format!("{}: {reason}", shown(path)))?;
    }
    Ok(map)
}

fn vectors(path: &Path, size: (usize, usize)) -> Result<Image<[f32; 3]>, String> {
    exr::read_vectors(path, size).map_err(|e| e.to_string())
}

/// Column and row of every pixel on the object, with its index.
fn on_object(normals: &Image<[f32; 3]>) -> impl Iterator<Item = (usize, usize, usize)> {
    let at = |i: usize| (i % normals.width, i / normals.width, i);
    (0..normals.pixels.len()).filter(|&i| normals.pixels[i] != [0.0; 3]).map(at)
}

fn check_normals(normals: &Image<[f32; 3]>, projection: &Projection) -> Result<(), String> {
    let (mut seen, mut facing) = (0_usize, 0_usize);
    for (x, y, i) in on_object(normals) {
        let normal = normals.pixels[i];
        if !normal.iter().all(|v| v.is_finite()) {
            return Err(format!(
                "the normal at column {x}, row {y} is {normal:?}: give finite numbers, and 0 0 0 beside the object"
            ));
        }
        let sight = projection.ray(x as f64 + 0.5, y as f64 + 0.5).direction;
        seen += 1;
        facing += usize::from(Vec3::from(normal.map(f64::from)).dot(&sight) < 0.0);
    }
    if seen == 0 {
        return Err("no pixel has a normal: 0 0 0 stands for \"not the object\"".to_owned());
    }
    if 2 * facing < seen {
        return Err(format!(
            "{} of {seen} normals point away from the camera: x is right, y down, z forward, so a normal that faces the camera has a negative z; change the signs",
            seen - facing
        ));
    }
    Ok(())
}

fn check_positions(
    positions: &Image<[f32; 3]>,
    normals: &Image<[f32; 3]>,
    projection: &Projection,
) -> Result<(), String> {
    for (x, y, i) in on_object(normals) {
        let position = positions.pixels[i];
        let point = Vec3::from(position.map(f64::from));
        let before_camera = point.z > 0.0 || matches!(projection, Projection::Orthographic { .. });
        if !point.iter().all(|v| v.is_finite()) || !before_camera {
            return Err(format!(
                "the position at column {x}, row {y} is {position:?}: every pixel with a normal needs a finite point in front of the camera, mm"
            ));
        }
        let [u, v] = projection.project(&point);
        let there = (u - x as f64 - 0.5).hypot(v - y as f64 - 0.5) <= OFF_PIXEL;
        if !there {
            return Err(format!(
                "the position at column {x}, row {y} is {position:?}, which the camera sees at column {u:.1}, row {v:.1}: give points in the camera frame (x right, y down, z forward), mm"
            ));
        }
    }
    Ok(())
}
