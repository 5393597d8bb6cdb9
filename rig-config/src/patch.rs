//! `[reference_patch]` of the rig file, and where it may not be.

use crate::contradictions::{Found, View};
use crate::rig::ReferencePatch;
use schemars::JsonSchema;
use serde::Deserialize;

/// Pixels that the circle must be wide and high, so that some hundred whole ones of it are seen.
const LEAST_PX: f64 = 24.0;
/// Pixels kept between patch and object: a session looks at so much around the object, which must be dark.
const APART_PX: f64 = 8.0;
/// Cosine between its normal and the line of sight, at least: a patch seen edge on is no patch.
const SEEN: f64 = 0.5;
/// Points on the circle that are looked at.
const POINTS: u32 = 64;

/// A matt, evenly grey, flat piece fixed beside the object, in view and lit at most stations: it tells how bright the lamp is. Without
/// the section the lamp is taken to be steady.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawReferencePatch {
    /// Middle of the circle on it that is looked at, camera frame, mm.
    #[schemars(inner(range(min = -1.0e5, max = 1.0e5)))]
    pub center_mm: [f64; 3],
    /// Direction out of its lit side, camera frame, any length.
    #[schemars(inner(range(min = -1.0e5, max = 1.0e5)))]
    pub normal: [f64; 3],
    /// Diameter of that circle, mm: all of it must be patch.
    #[schemars(range(max = 1.0e4), extend("exclusiveMinimum" = 0))]
    pub diameter_mm: f64,
}

impl From<RawReferencePatch> for ReferencePatch {
    fn from(raw: RawReferencePatch) -> Self {
        Self { center_mm: raw.center_mm, normal: raw.normal, diameter_mm: raw.diameter_mm }
    }
}

type Point = [f64; 3];

fn dot(a: Point, b: Point) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn unit(v: Point) -> Point {
    v.map(|x| x / dot(v, v).sqrt())
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Refuses a patch that the camera does not see, sees edge on or too small, or sees before the object (the distortion left out).
pub(crate) fn check(view: &View, found: &mut Found) {
    let vectors = (view.numbers("reference_patch.center_mm"), view.numbers("reference_patch.normal"));
    let (Some(center), Some(normal), Some(diameter)) =
        (vectors.0, vectors.1, view.number("reference_patch.diameter_mm"))
    else {
        return;
    };
    if dot(normal, normal) == 0.0 {
        found.refuse("reference_patch.normal", "has no length: give the direction out of the patch's lit side");
        return;
    }
    let circle = circle(center, unit(normal), 0.5 * diameter);
    if circle.iter().any(|point| point[2] <= 0.0) {
        found.refuse("reference_patch.center_mm", "not all of the patch lies before the camera: increase z");
        return;
    }
    let seen = -dot(unit(normal), unit(center));
    if seen < SEEN {
        let what = format!(
            "the camera sees the patch at a cosine of {seen:.2}, {SEEN} at least is needed: turn its lit side more towards the camera"
        );
        found.refuse("reference_patch.normal", what);
        return;
    }
    let optics = (view.numbers::<2>("camera.focal_px"), view.numbers::<2>("camera.principal_px"));
    let (Some(focal), Some(principal)) = optics else { return };
    let spans: [[f64; 2]; 2] = [0, 1].map(|axis| span(&circle, axis, focal[axis], principal[axis]));
    in_frame(view, &spans, found);
    beside_object(view, &spans, (focal, principal), found);
}

/// Points on the circle about `center` in the plane with this unit normal.
fn circle(center: Point, normal: Point, radius: f64) -> Vec<Point> {
    let aside = if normal[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let across = unit(cross(normal, aside));
    let along = cross(normal, across);
    let point = |i: u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(POINTS)).sin_cos();
        std::array::from_fn(|k| center[k] + radius * (cos * across[k] + sin * along[k]))
    };
    (0..POINTS).map(point).collect()
}

/// Lowest and highest pixel of the points along an axis.
fn span(points: &[Point], axis: usize, focal: f64, principal: f64) -> [f64; 2] {
    let pixels = points.iter().map(|point| principal + focal * point[axis] / point[2]);
    pixels.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], pixel| [low.min(pixel), high.max(pixel)])
}

fn in_frame(view: &View, spans: &[[f64; 2]; 2], found: &mut Found) {
    for (axis, size_key) in [(0, "width"), (1, "height")] {
        let ([low, high], name) = (spans[axis], ["x", "y"][axis]);
        let Some(size) = view.number(&format!("camera.{size_key}")) else { continue };
        if low < 0.0 || high > size {
            let what = format!(
                "the patch spans {name} {low:.0} to {high:.0} px, outside the camera's view of 0 to {size} px: move it, or make \
                 reference_patch.diameter_mm smaller"
            );
            found.refuse("reference_patch.center_mm", what);
        } else if high - low < LEAST_PX {
            let what = format!("the patch is {:.0} px large along {name}: {LEAST_PX} at least are needed", high - low);
            found.refuse("reference_patch.diameter_mm", what);
        }
    }
}

/// The rectangles around patch and object must not meet.
fn beside_object(view: &View, spans: &[[f64; 2]; 2], (focal, principal): ([f64; 2], [f64; 2]), found: &mut Found) {
    let (Some([x, y, z]), Some(radius)) = (view.numbers("object.center_mm"), view.number("object.radius_mm")) else {
        return;
    };
    if z <= radius {
        return;
    }
    let object = [(0, x), (1, y)].map(|(axis, offset): (usize, f64)| {
        let (middle, half) = (offset.atan2(z), (radius / offset.hypot(z)).asin());
        [middle - half, middle + half].map(|angle| principal[axis] + focal[axis] * angle.tan())
    });
    let meet =
        (0..2).all(|axis| spans[axis][0] < object[axis][1] + APART_PX && spans[axis][1] > object[axis][0] - APART_PX);
    if meet {
        let what = format!(
            "the patch comes within {APART_PX} px of the rectangle around the object (x {:.0} to {:.0}, y {:.0} to {:.0} px): move it aside",
            object[0][0], object[0][1], object[1][0], object[1][1]
        );
        found.refuse("reference_patch.center_mm", what);
    }
}
