//! The reference patch: a matt, round, flat piece beside the sample.

use crate::numerics::geometry::{Light, Ray, Sphere, Vec3};
use crate::sim::world::around;
use rig_config::ReferencePatch;
use std::f64::consts::PI;

/// Its reflectance, which nobody is told.
const REFLECTANCE: f64 = 0.42;
/// It reaches beyond the circle that is looked at by this part of its radius.
const RIM: f64 = 0.15;

/// A patch as it really is.
#[derive(Clone, Debug)]
pub struct Patch {
    center: Vec3,
    normal: Vec3,
    radius: f64,
}

impl Patch {
    /// The patch of a rig file.
    pub fn new(stated: &ReferencePatch) -> Self {
        Self {
            center: Vec3::from(stated.center_mm),
            normal: Vec3::from(stated.normal).normalize(),
            radius: 0.5 * stated.diameter_mm * (1.0 + RIM),
        }
    }

    /// Corners of a box around it.
    pub fn outline(&self) -> [Vec3; 8] {
        around(&self.center, self.radius)
    }

    /// Radiance along a ray: Lambert's law, black where the sample hides the lamp, and beside it.
    pub(crate) fn radiance(&self, ray: &Ray, light: &Light, sample: &Sphere) -> [f64; 3] {
        let along = self.normal.dot(&(self.center - ray.origin)) / self.normal.dot(&ray.direction);
        if !(along.is_finite() && along > 0.0) {
            return [0.0; 3];
        }
        let point = ray.origin + ray.direction * along;
        if (point - self.center).norm() > self.radius {
            return [0.0; 3];
        }
        let (direction, irradiance) = light.at(&point);
        let before = sample.intersect(&Ray { origin: point, direction });
        let hidden = before.is_some_and(|hit| (hit.position - point).dot(&direction) > 0.0);
        let cosine = if hidden { 0.0 } else { self.normal.dot(&direction).max(0.0) };
        irradiance.map(|e| REFLECTANCE / PI * e * cosine)
    }
}
