//! The part of the frame that shows the object.

use crate::numerics::geometry::{Projection, Vec3};
use crate::pipeline::develop::Crop;
use rig_config::Rig;

/// Pixels kept around the object, so that its edge is seen against the background.
const MARGIN_PX: f64 = 8.0;
/// Points on the outline: the bounding box is then exact to a thousandth of the radius.
const OUTLINE_POINTS: usize = 256;

/// Kept around an object that is yet to be found, in parts of its own width: it may stand that far from where the rig file puts it.
const SEARCH: f64 = 0.75;

/// The part a session develops; `calibrated`: the object is yet to be found in the frames, so more is kept.
pub fn of_session(rig: &Rig, calibrated: bool) -> Option<Crop> {
    let near = of_object(rig)?;
    if !calibrated {
        return Some(near);
    }
    let [more_x, more_y] = [near.width, near.height].map(|side| (SEARCH * side as f64) as usize);
    let (x, y) = (near.x.saturating_sub(more_x), near.y.saturating_sub(more_y));
    let right = (near.x + near.width + more_x).min(rig.camera.width);
    let bottom = (near.y + near.height + more_y).min(rig.camera.height);
    Some(Crop { x, y, width: right - x, height: bottom - y })
}

/// Bounding box of the sphere's outline with a margin, clipped to the frame; none when the rig does not show the sphere.
pub fn of_object(rig: &Rig) -> Option<Crop> {
    let camera = &rig.camera;
    let projection = Projection::Pinhole {
        focal_px: camera.focal_px,
        principal_px: camera.principal_px,
        distortion: camera.distortion,
    };
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for point in outline(&Vec3::from(rig.object.center_mm), rig.object.radius_mm)? {
        if point.z <= 0.0 {
            return None;
        }
        let pixel = projection.project(&point);
        for axis in 0..2 {
            low[axis] = low[axis].min(pixel[axis]);
            high[axis] = high[axis].max(pixel[axis]);
        }
    }
    let clip = |value: f64, size: usize| value.clamp(0.0, size as f64) as usize;
    let (x, y) = (clip((low[0] - MARGIN_PX).floor(), camera.width), clip((low[1] - MARGIN_PX).floor(), camera.height));
    let right = clip((high[0] + MARGIN_PX).ceil(), camera.width);
    let bottom = clip((high[1] + MARGIN_PX).ceil(), camera.height);
    (right > x && bottom > y).then_some(Crop { x, y, width: right - x, height: bottom - y })
}

/// The circle in which the cone of sight from the origin touches the sphere; none from inside it.
fn outline(center: &Vec3, radius: f64) -> Option<impl Iterator<Item = Vec3> + use<>> {
    let distance2 = center.norm_squared();
    let share = radius * radius / distance2;
    if !share.is_finite() || share >= 1.0 {
        return None;
    }
    let middle = center * (1.0 - share);
    let ring = radius * (1.0 - share).sqrt();
    let across = center.cross(&Vec3::y()).try_normalize(0.0).unwrap_or_else(Vec3::x);
    let along = center.cross(&across).normalize();
    Some((0..OUTLINE_POINTS).map(move |i| {
        let (sin, cos) = (i as f64 / OUTLINE_POINTS as f64 * std::f64::consts::TAU).sin_cos();
        middle + (across * cos + along * sin) * ring
    }))
}
