//! Three lacquered balls: matt grey under a clear coat that mirrors the lamp's frosted bulb.

use crate::numerics::geometry::{Light, Ray, Sphere, SurfacePoint, Vec3};
use std::f64::consts::PI;

/// Radius of the balls, mm.
pub const BALL_RADIUS_MM: f64 = 25.0;

/// Where they stand about the middle of the stage, mm: as far apart as the picture is wide, none before another as seen from the
/// camera or from any lamp of a half circle raised by a third of its radius (by search; 46 mm to spare).
const PLACES: [[f64; 3]; 3] = [[85.0, 78.0, 35.0], [-83.0, -71.0, 0.0], [-109.0, 66.0, 0.0]];
/// Reflectance of the paint, red green blue.
const PAINT: [f64; 3] = [0.26, 0.24, 0.22];
/// What the coat mirrors of light that meets it straight (refractive index 1.5).
const COAT: f64 = 0.04;
/// Radius of the bulb, mm: it looks the same from all sides.
const BULB_MM: f64 = 9.0;

/// The three balls.
#[derive(Clone, Debug)]
pub struct Balls {
    spheres: [Sphere; 3],
}

impl Balls {
    /// Balls about the middle of the stage.
    pub fn new(stage: &Vec3) -> Self {
        let sphere = |place: [f64; 3]| Sphere { center: stage + Vec3::from(place), radius: BALL_RADIUS_MM };
        Self { spheres: PLACES.map(sphere) }
    }

    /// The balls as spheres.
    pub fn spheres(&self) -> &[Sphere; 3] {
        &self.spheres
    }

    /// Radiance along a ray; black beside them.
    pub(crate) fn radiance(&self, ray: &Ray, light: &Light) -> [f64; 3] {
        // None stands before another.
        self.spheres.iter().find_map(|sphere| sphere.intersect(ray)).map_or([0.0; 3], |point| shade(&point, light))
    }
}

fn shade(point: &SurfacePoint, light: &Light) -> [f64; 3] {
    let (direction, irradiance) = light.at(&point.position);
    let cosine = point.normal.dot(&direction).max(0.0);
    let mirrored = mirror(point, light, &direction);
    std::array::from_fn(|c| irradiance[c] * (PAINT[c] / PI * cosine + mirrored))
}

/// What the coat shows of the bulb: radiance in parts of the irradiance it makes. The bulb is a sphere of even radiance L, whose
/// irradiance at a distance d is pi L (r / d)^2; reflectance by Schlick (1994).
fn mirror(point: &SurfacePoint, light: &Light, direction: &Vec3) -> f64 {
    let Light::Point { position, .. } = light else { return 0.0 };
    let cos_view = point.normal.dot(&point.view);
    let reflected = point.normal * (2.0 * cos_view) - point.view;
    let distance2 = (position - point.position).norm_squared();
    let off2 = reflected.cross(direction).norm_squared();
    if reflected.dot(direction) <= 0.0 || off2 * distance2 > BULB_MM * BULB_MM {
        return 0.0;
    }
    let coat = COAT + (1.0 - COAT) * (1.0 - cos_view).powi(5);
    coat * distance2 / (PI * BULB_MM * BULB_MM)
}
