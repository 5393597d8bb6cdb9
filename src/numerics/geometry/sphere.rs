//! The sphere, the paper's reference object.

use super::{Ray, SurfacePoint, Vec3};

/// A sphere.
#[derive(Clone, Debug, PartialEq)]
pub struct Sphere {
    /// Centre, mm.
    pub center: Vec3,
    /// Radius, mm.
    pub radius: f64,
}

impl Sphere {
    /// The first point of the sphere that the ray meets, if any.
    pub fn intersect(&self, ray: &Ray) -> Option<SurfacePoint> {
        let to_center = self.center - ray.origin;
        let along = to_center.dot(&ray.direction);
        let closest = to_center - ray.direction * along;
        let half_chord2 = self.radius * self.radius - closest.norm_squared();
        if half_chord2 < 0.0 {
            return None;
        }
        let position = ray.origin + ray.direction * (along - half_chord2.sqrt());
        let normal = (position - self.center) / self.radius;
        Some(SurfacePoint { position, normal, view: -ray.direction })
    }
}
