//! One physical world: what light reaches every sensor pixel for where the arm and its lamp really are.

use super::pose::Pose;
use super::scene::Scene;
use crate::numerics::brdf::ward::Ward;
use crate::numerics::geometry::{Angles, Light, Projection, Sphere, SurfacePoint, Vec3};
use crate::numerics::image::Image;
use rayon::prelude::*;
use rig_config::{Rig, Simulation};

/// Rays per pixel and axis: edges and lobes are integrated over the pixel's area.
const SUPERSAMPLING: usize = 3;

/// The sphere in a black enclosure under one small lamp on an arm, before a pinhole camera with lens distortion.
#[derive(Clone, Debug)]
pub struct World {
    width: usize,
    height: usize,
    projection: Projection,
    sphere: Sphere,
    scene: Scene,
    lamp: rig_config::Lamp,
}

impl World {
    /// The world the rig file describes, with the object of `simulation`.
    pub fn new(rig: &Rig, simulation: &Simulation) -> Self {
        let camera = &rig.camera;
        Self {
            width: camera.width,
            height: camera.height,
            projection: Projection::Pinhole {
                focal_px: camera.focal_px,
                principal_px: camera.principal_px,
                distortion: camera.distortion,
            },
            sphere: Sphere { center: Vec3::from(rig.object.center_mm), radius: rig.object.radius_mm },
            scene: Scene::new(simulation.scene, simulation.seed),
            lamp: rig.lamp.clone(),
        }
    }

    /// The object's surface: the truth of a fit.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Noise-free radiance of every sensor pixel, in the unit in which radiance x seconds = 1 gives level 128.
    /// The lamp gives the rig file's intensity at the rig file's level, and proportionally less below.
    pub fn radiance(&self, pose: Pose) -> Image<[f64; 3]> {
        let level = f64::from(pose.lamp_permille) / f64::from(self.lamp.level_permille.max(1));
        let light = Light::Point {
            position: Vec3::from(self.lamp.position_mm(pose.angle_deg)),
            intensity: self.lamp.intensity.map(|i| i * level),
        };
        let mut image = Image::filled(self.width, self.height, [0.0; 3]);
        if pose.lamp_permille > 0 {
            image.pixels.par_chunks_mut(self.width).enumerate().for_each(|(y, row)| {
                for (x, pixel) in row.iter_mut().enumerate() {
                    *pixel = self.pixel(x, y, &light);
                }
            });
        }
        image
    }

    /// Mean radiance over the area of a pixel.
    fn pixel(&self, x: usize, y: usize, light: &Light) -> [f64; 3] {
        let part = |i: usize| (i as f64 + 0.5) / SUPERSAMPLING as f64;
        let mut sum = [0.0; 3];
        for j in 0..SUPERSAMPLING {
            for i in 0..SUPERSAMPLING {
                let ray = self.projection.ray(x as f64 + part(i), y as f64 + part(j));
                if let Some(point) = self.sphere.intersect(&ray) {
                    let radiance = self.shade(&point, light);
                    sum = std::array::from_fn(|c| sum[c] + radiance[c]);
                }
            }
        }
        sum.map(|s| s / (SUPERSAMPLING * SUPERSAMPLING) as f64)
    }

    /// Paper Eq. 1 and 3 with fall-off; black where the sphere itself hides the lamp.
    fn shade(&self, point: &SurfacePoint, light: &Light) -> [f64; 3] {
        let (direction, irradiance) = light.at(&point.position);
        let angles = Angles::new(&point.normal, &direction, &point.view);
        if angles.cos_i <= 0.0 || angles.cos_r <= 0.0 {
            return [0.0; 3];
        }
        let weights = self.scene.weights(&point.normal);
        let brdf = self.scene.materials().map(|material| material.brdf(&Ward, &angles));
        std::array::from_fn(|c| irradiance[c] * angles.cos_i * (weights[0] * brdf[0][c] + weights[1] * brdf[1][c]))
    }
}
