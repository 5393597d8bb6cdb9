//! How well a fitted material relights the simulated ball, under lights that were never shot.

use crate::numerics::brdf;
use crate::numerics::fit::observations::HIGHLIGHT_HALF_ANGLE;
use crate::numerics::geometry::{Angles, SurfacePoint};
use crate::pipeline::dataset::Geometry;
use crate::pipeline::relight::relight;
use crate::sim::pose::Pose;
use crate::sim::world::World;
use crate::store::result::StoredMaterial;
use rig_config::Rig;

/// Arm angles that no plan of this project shoots, degrees.
pub const UNSEEN_DEG: [f64; 4] = [-38.0, -3.0, 32.0, 67.0];

/// Cosines above which relighting is judged.
pub const COSINE_CUTOFF: f64 = 0.15;

/// Errors of relighting: means of |I - model| / I against the world without noise, over fitted pixels, lights and channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relit {
    /// Of all samples.
    pub overall: f64,
    /// Of those with a half angle below 6 degrees; none where there are none.
    pub highlight: Option<f64>,
    /// Samples: fitted pixels under each light.
    pub samples: usize,
}

/// Sum and count of relative errors.
#[derive(Default)]
struct Errors(f64, usize);

impl Errors {
    fn add(&mut self, truth: &[f64; 3], model: &[f32; 3]) {
        self.0 += (0..3).map(|c| (truth[c] - f64::from(model[c])).abs() / truth[c]).sum::<f64>() / 3.0;
        self.1 += 1;
    }

    fn mean(&self) -> Option<f64> {
        (self.1 > 0).then(|| self.0 / self.1 as f64)
    }
}

/// The true camera and ball, whatever the fit was told; no lights.
pub fn true_geometry(rig: &Rig, world: &World) -> Geometry {
    let truth = world.truth();
    Geometry {
        width: rig.camera.width,
        height: rig.camera.height,
        projection: truth.projection.clone(),
        object: truth.object.clone().into(),
        mask: None,
        lights: Vec::new(),
        cosine_cutoff: COSINE_CUTOFF,
    }
}

/// Relights the ball of `world` with the lamp at [`UNSEEN_DEG`]; none for a model that is not known, or where nothing fitted is lit.
pub fn relit(rig: &Rig, world: &World, stored: &StoredMaterial) -> Option<Relit> {
    let lobe = brdf::by_name(&stored.material.model)?;
    let (geometry, materials) = (true_geometry(rig, world), stored.material.materials());
    let fitted = fitted_points(&geometry, stored);
    let (mut all, mut highlights) = (Errors::default(), Errors::default());
    for angle_deg in UNSEEN_DEG {
        let pose = Pose { angle_deg, lamp_permille: rig.lamp.level_permille };
        let (light, truth) = (world.light(pose), world.radiance(pose));
        let model = relight(lobe, &materials, &stored.weights, &geometry, &light);
        for (x, y, point) in &fitted {
            let angles = Angles::new(&point.normal, &light.at(&point.position).0, &point.view);
            if angles.cos_i <= COSINE_CUTOFF || angles.cos_r <= COSINE_CUTOFF {
                continue;
            }
            let (truth, model) = (truth.at(*x, *y), model.at(*x, *y));
            all.add(truth, model);
            if angles.half_angle() < HIGHLIGHT_HALF_ANGLE {
                highlights.add(truth, model);
            }
        }
    }
    Some(Relit { overall: all.mean()?, highlight: highlights.mean(), samples: all.1 })
}

/// Pixels with a weight, and what of the ball they show.
fn fitted_points(geometry: &Geometry, stored: &StoredMaterial) -> Vec<(usize, usize, SurfacePoint)> {
    let mut points = Vec::new();
    for y in 0..geometry.height {
        for x in 0..geometry.width {
            let ray = geometry.projection.ray(x as f64 + 0.5, y as f64 + 0.5);
            let fitted = stored.weights.iter().any(|map| *map.at(x, y) > 0.0);
            points.extend(geometry.object.at(x, y, &ray).filter(|_| fitted).map(|point| (x, y, point)));
        }
    }
    points
}
