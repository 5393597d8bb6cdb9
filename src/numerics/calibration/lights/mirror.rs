//! Mirror reflection on a ball: rays from a highlight to its lamp, their meeting point, and where a lamp is seen.

use crate::numerics::geometry::{Projection, Ray, Sphere, Vec3};
use nalgebra::Matrix3;

/// The ray from the ball towards the lamp whose highlight is seen at pixel `at`; none if the pixel misses the ball.
pub fn mirror_ray(projection: &Projection, ball: &Sphere, at: [f64; 2]) -> Option<Ray> {
    let point = ball.intersect(&projection.ray(at[0], at[1]))?;
    let direction = point.normal * (2.0 * point.normal.dot(&point.view)) - point.view;
    Some(Ray { origin: point.position, direction: direction.normalize() })
}

/// The point nearest to all rays (least squares, by the SVD of the summed projectors; paper 3.2). None for fewer than two rays,
/// parallel rays, or a point behind a ray's ball.
pub fn meeting_point(rays: &[Ray]) -> Option<Vec3> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vec3::zeros());
    for ray in rays {
        let across = Matrix3::identity() - ray.direction * ray.direction.transpose();
        normal += across;
        right += across * ray.origin;
    }
    let svd = normal.svd(true, true);
    let parallel = svd.singular_values.min() < 1e-9 * svd.singular_values.max();
    let point = (!parallel).then(|| svd.solve(&right, 0.0).ok()).flatten()?;
    rays.iter().all(|ray| (point - ray.origin).dot(&ray.direction) > 0.0).then_some(point)
}

/// The pixel at which a ball mirrors a lamp to a camera at the origin (Alhazen's problem): Newton's method on the angle of the
/// normal between the directions to camera and lamp. None when there is no such point, or parallel rays.
pub fn highlight(projection: &Projection, center: &Vec3, radius: f64, lamp: &Vec3) -> Option<[f64; 2]> {
    if matches!(projection, Projection::Orthographic { .. }) {
        return None;
    }
    let (eye, light) = (-center, lamp - center);
    let (far, near) = (eye.norm(), light.norm());
    let toward = eye / far;
    let across = light - toward * toward.dot(&light);
    let side = across.norm();
    if near <= radius || far <= radius || side < 1e-12 * near {
        // A lamp behind the camera on the ball's axis is mirrored at the nearest point.
        return (near > radius && far > radius).then(|| projection.project(&(center + toward * radius)));
    }
    let across = across / side;
    let angle = side.atan2(toward.dot(&light));
    // Direction to eye and lamp from the point at angle t make equal angles with the normal there.
    let tilt = |t: f64, distance: f64, at: f64| (distance * (at - t).sin()).atan2(distance * (at - t).cos() - radius);
    let (mut low, mut high) = (0.0, angle);
    let mut t = 0.5 * angle;
    for _ in 0..60 {
        let off = tilt(t, near, angle) + tilt(t, far, 0.0);
        if off.abs() < 1e-15 {
            break;
        }
        if off > 0.0 {
            low = t
        } else {
            high = t
        }
        const H: f64 = 1e-6;
        let slope = (tilt(t + H, near, angle) + tilt(t + H, far, 0.0) - off) / H;
        let newton = t - off / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - t).abs() < 1e-15 {
            break;
        }
        t = next;
    }
    let point = center + (toward * t.cos() + across * t.sin()) * radius;
    // Seen only if the point faces the eye and the lamp.
    let normal = (point - center) / radius;
    (normal.dot(&(-point)) > 0.0 && normal.dot(&(lamp - point)) > 0.0).then(|| projection.project(&point))
}
