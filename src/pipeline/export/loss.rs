//! What an export loses: its own model, evaluated as a reader of its files does, against ours on the same points of the same scene.

use super::{Captured, Model};
use crate::numerics::fit::observations::HIGHLIGHT_HALF_ANGLE;
use crate::numerics::geometry::{Light, Vec3};
use crate::numerics::render::camera::{Camera, View};
use crate::numerics::render::mesh::Mesh;
use crate::numerics::render::tree::Tree;
use crate::numerics::render::{Scene, shapes};
use rayon::prelude::*;
use serde::Serialize;

/// The scene, for people.
pub const SCENE: &str = "a ball that wears the texture, 128 x 128 pixels, under seven distant lights 0 to 75 degrees from the camera; \
     relative difference of each lit pixel and channel, highlights where the half angle is below 6 degrees";

/// Pixels a side of the picture.
const SIDE: usize = 128;
/// Vertical field of view, degrees.
const FIELD_DEG: f64 = 30.0;
/// Angles of the lights from the middle, about the vertical axis, degrees: an arm's, as in the paper.
const LIGHTS_DEG: [f64; 7] = [-75.0, -50.0, -25.0, 0.0, 25.0, 50.0, 75.0];
/// How far the lights stand above the horizon, degrees.
const ELEVATION_DEG: f64 = 20.0;

/// How far the radiance of an export is from ours.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Loss {
    /// Mean of |export - ours| / ours over lit pixels and channels.
    pub mean: f64,
    /// The same where the half angle is below 6 degrees; none if there is no such pixel.
    pub highlight: Option<f64>,
}

/// A sum and how many were added.
#[derive(Clone, Copy, Default)]
struct Mean {
    sum: f64,
    count: usize,
}

impl Mean {
    fn value(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }

    fn add(&mut self, other: Self) {
        self.sum += other.sum;
        self.count += other.count;
    }
}

/// Measures the loss of an export.
///
/// # Errors
/// The material sends no light at all, so that nothing can be compared.
pub fn measure(captured: &Captured, model: &Model) -> Result<Loss, String> {
    let ball = shapes::textured("sphere").ok_or("the ball is missing")?;
    let mesh = Mesh::new(ball).map_err(|error| error.to_string())?;
    let tree = Tree::new(&mesh);
    let camera = Camera::new(&View::of(&mesh, FIELD_DEG, (SIDE, SIDE)), (SIDE, SIDE)).map_err(|e| e.to_string())?;
    let (mut all, mut highlight) = (Mean::default(), Mean::default());
    for azimuth in LIGHTS_DEG {
        let (azimuth, elevation) = (azimuth.to_radians(), ELEVATION_DEG.to_radians());
        let level = elevation.cos();
        let direction = Vec3::new(level * azimuth.sin(), elevation.sin(), level * azimuth.cos());
        let scene = Scene {
            mesh: &mesh,
            tree: &tree,
            tile: &captured.tile,
            repeats: f64::from(captured.repeats),
            lobe: captured.lobe,
            materials: &captured.materials,
            light: &Light::Distant { direction, irradiance: [1.0; 3] },
        };
        // Row by row, added up in order: the same figure at any number of threads.
        let rows: Vec<[Mean; 2]> = (0..SIDE).into_par_iter().map(|y| row(&scene, &camera, model, y)).collect();
        for [a, h] in rows {
            all.add(a);
            highlight.add(h);
        }
    }
    let mean = all.value().ok_or("the material reflects nothing on the whole tile: there is nothing to export")?;
    Ok(Loss { mean, highlight: highlight.value() })
}

/// Relative differences of a row: of all lit pixels, and of highlights.
fn row(scene: &Scene<'_>, camera: &Camera, model: &Model, y: usize) -> [Mean; 2] {
    let mut sums = [Mean::default(); 2];
    for x in 0..SIDE {
        let Some(lit) = scene.lit(&camera.ray(x as f64 + 0.5, y as f64 + 0.5)).flatten() else { continue };
        let Some(uv) = lit.met.uv else { continue };
        let ours = scene.brdf(&lit);
        let theirs = model(uv.map(|t| scene.repeats * t), &lit.angles);
        let is_highlight = lit.angles.half_angle() < HIGHLIGHT_HALF_ANGLE;
        for c in 0..3 {
            let Some(sum) = difference(ours[c], theirs[c]) else { continue };
            let one = Mean { sum, count: 1 };
            sums[0].add(one);
            if is_highlight {
                sums[1].add(one);
            }
        }
    }
    sums
}

/// |theirs - ours| / ours; light out of nothing counts as 1, nothing in both is no comparison.
fn difference(ours: f64, theirs: f64) -> Option<f64> {
    match (ours > 0.0, theirs > 0.0) {
        (true, _) => Some((theirs - ours).abs() / ours),
        (false, true) => Some(1.0),
        (false, false) => None,
    }
}
