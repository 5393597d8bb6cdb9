//! The finite cylinder, which shows each half angle along a whole line instead of in one point.

use super::{Ray, SurfacePoint, Vec3};

/// A round bar of finite length. Its lateral surface is the sample; its two flat ends are not.
#[derive(Clone, Debug, PartialEq)]
pub struct Cylinder {
    start: Vec3,
    /// Unit direction from start to end.
    axis: Vec3,
    length: f64,
    radius: f64,
}

impl Cylinder {
    /// The cylinder around the line from `start` to `end`, all in mm; none without a positive finite length and radius.
    pub fn new(start: Vec3, end: Vec3, radius: f64) -> Option<Self> {
        let length = (end - start).norm();
        let sound = |size: f64| size.is_finite() && size > 0.0;
        let axis = (end - start) / length;
        (sound(length) && sound(radius)).then_some(Self { start, axis, length, radius })
    }

    /// Least z of any of its points, mm.
    pub fn nearest_depth(&self) -> f64 {
        let end = self.start + self.axis * self.length;
        let across = (1.0 - self.axis.z * self.axis.z).max(0.0).sqrt();
        self.start.z.min(end.z) - self.radius * across
    }

    /// True inside or on the surface.
    pub fn contains(&self, point: &Vec3) -> bool {
        let (along, across) = self.split(&(point - self.start));
        (0.0..=self.length).contains(&along) && across.norm() <= self.radius
    }

    /// The point of the lateral surface that the ray meets from outside, if any. A ray that enters through a flat end meets
    /// none, though it reaches the far wall from within.
    pub fn intersect(&self, ray: &Ray) -> Option<SurfacePoint> {
        let (_, from_axis) = self.split(&(ray.origin - self.start));
        let (_, across) = self.split(&ray.direction);
        let speed2 = across.norm_squared();
        let closest = from_axis - across * (from_axis.dot(&across) / speed2);
        let half_chord2 = (self.radius * self.radius - closest.norm_squared()) / speed2;
        // Not a number for a ray along the axis, which meets the ends only.
        if !(half_chord2 >= 0.0 && half_chord2.is_finite()) {
            return None;
        }
        let position = ray.origin + ray.direction * (-from_axis.dot(&across) / speed2 - half_chord2.sqrt());
        let (along, outward) = self.split(&(position - self.start));
        let on_it = (0.0..=self.length).contains(&along);
        on_it.then(|| SurfacePoint { position, normal: outward.normalize(), view: -ray.direction })
    }

    /// The part of `vector` along the axis, mm, and the rest, perpendicular to it.
    fn split(&self, vector: &Vec3) -> (f64, Vec3) {
        let along = vector.dot(&self.axis);
        (along, vector - self.axis * along)
    }
}
