//! Where everything stands: the points that enough lights see, and the lights, true and assumed.

use super::Scene;
use crate::numerics::geometry::Angles;
use nalgebra::Vector3;
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal, UnitSphere};
use std::f64::consts::PI;

/// Radius of the ball, mm.
const RADIUS_MM: f64 = 30.0;
/// From the camera to the ball's centre, mm.
const DISTANCE_MM: f64 = 1500.0;
/// From the ball's centre to a light, mm.
pub const ARC_MM: f64 = 600.0;
/// Share of the ball's disc in the image that three of the seven lights see.
const SEEN_SHARE: f64 = 0.955;
/// A point counts when this many lights see it, or all of them if there are fewer.
const LEAST_LIGHTS: usize = 3;

/// A light: where it is, how strong it is, and where the fit believes it to be.
pub struct StageLight {
    pub position: Vector3<f64>,
    pub gain: f64,
    pub assumed: Vector3<f64>,
}

impl StageLight {
    fn sound(azimuth_deg: f64) -> Self {
        let azimuth = azimuth_deg.to_radians();
        let position = centre() + ARC_MM * Vector3::new(azimuth.sin(), 0.0, -azimuth.cos());
        Self { position, gain: 1.0, assumed: position }
    }
}

/// A point of the ball that the camera sees.
pub struct StagePoint {
    pub pixel: usize,
    pub position: Vector3<f64>,
    pub normal: Vector3<f64>,
    pub to_view: Vector3<f64>,
}

impl StagePoint {
    /// Angles under a light at `position`.
    pub fn angles(&self, position: &Vector3<f64>) -> Angles {
        Angles::new(&self.normal, &(position - self.position).normalize(), &self.to_view)
    }
}

/// Points and lights of a scene.
pub struct Stage {
    pub points: Vec<StagePoint>,
    pub lights: Vec<StageLight>,
    pub unseen: Vec<StageLight>,
    pub least_lights: usize,
}

fn centre() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, DISTANCE_MM)
}

impl Stage {
    pub fn new(scene: &Scene, seed: u64) -> Self {
        let lights = lights(scene, seed);
        let least_lights = LEAST_LIGHTS.min(lights.len());
        let mut points = ball(scene.points);
        points.retain(|point| {
            let seen = lights.iter().filter(|light| lit(&point.angles(&light.assumed), scene.cosine_cutoff));
            seen.count() >= least_lights
        });
        let unseen = super::UNSEEN_AZIMUTHS_DEG.map(StageLight::sound).into();
        Self { points, lights, unseen, least_lights }
    }

    pub fn normals(&self) -> Vec<Vector3<f64>> {
        self.points.iter().map(|point| point.normal).collect()
    }
}

/// True when a sample counts.
pub fn lit(angles: &Angles, cutoff: f64) -> bool {
    angles.cos_i > cutoff && angles.cos_r > cutoff
}

/// Lights with their drift and the error of their assumed position. Drift has no mean: that would be an error of the
/// albedos, not of the lights.
fn lights(scene: &Scene, seed: u64) -> Vec<StageLight> {
    let mut rng = StdRng::seed_from_u64(seed ^ 0x11_6475);
    let mut lights: Vec<StageLight> = scene.azimuths_deg.iter().map(|&azimuth| StageLight::sound(azimuth)).collect();
    let mut drifts = Vec::new();
    for light in &mut lights {
        let normal: f64 = StandardNormal.sample(&mut rng);
        let direction: [f64; 3] = UnitSphere.sample(&mut rng);
        drifts.push(scene.drift * normal);
        light.assumed += scene.light_error_mm * Vector3::from(direction);
    }
    let mean = drifts.iter().sum::<f64>() / drifts.len().max(1) as f64;
    for (light, drift) in lights.iter_mut().zip(drifts) {
        light.gain += drift - mean;
    }
    lights
}

/// Every pixel centre whose ray meets the ball, at a pixel pitch that gives about `wanted` points under the seven lights.
fn ball(wanted: usize) -> Vec<StagePoint> {
    let radius_px = (wanted as f64 / (PI * SEEN_SHARE)).sqrt();
    let outline = RADIUS_MM / (DISTANCE_MM * DISTANCE_MM - RADIUS_MM * RADIUS_MM).sqrt();
    let side = 2 * radius_px.ceil() as usize + 2;
    let ray = |i: usize| (i as f64 + 0.5 - 0.5 * side as f64) / radius_px * outline;
    let points = (0..side * side).filter_map(|pixel| {
        let direction = Vector3::new(ray(pixel % side), ray(pixel / side), 1.0).normalize();
        let along = direction.z * DISTANCE_MM;
        let inside = RADIUS_MM * RADIUS_MM - (DISTANCE_MM * DISTANCE_MM - along * along);
        (inside >= 0.0).then(|| {
            let position = direction * (along - inside.sqrt());
            StagePoint { pixel, position, normal: (position - centre()) / RADIUS_MM, to_view: -direction }
        })
    });
    points.collect()
}
