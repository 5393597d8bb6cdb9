//! One physical world: what light reaches every sensor pixel for where the arm and its lamp really are.

use super::lens;
use super::pose::Pose;
use super::scene::Scene;
use super::stage::{Balls, Flat, Patch, Placed, Print};
use super::truth::Truth;
use crate::numerics::brdf::ward::Ward;
use crate::numerics::geometry::{Angles, Light, SurfacePoint, Vec3};
use crate::numerics::image::Image;
use rayon::prelude::*;
use rig_config::{Rig, Simulation};

/// Rays per pixel and axis on the sample: edges and lobes are integrated over the pixel's area.
const SUPERSAMPLING: usize = 3;

/// What stands in a black enclosure under one small lamp on an arm, before a pinhole camera with lens distortion.
#[derive(Clone, Debug)]
pub struct World {
    size: (usize, usize),
    truth: Truth,
    /// Middle of the stage as the rig file says: where an operator puts things.
    stage: Vec3,
    scene: Scene,
    /// Stands beside the sample.
    patch: Option<Patch>,
    level_permille: u16,
}

impl World {
    /// The world of a rig, with the object of `simulation`.
    pub fn new(rig: &Rig, simulation: &Simulation) -> Self {
        Self {
            size: (rig.camera.width, rig.camera.height),
            truth: Truth::new(rig, simulation),
            stage: Vec3::from(rig.object.center_mm),
            scene: Scene::new(simulation.scene, simulation.seed),
            patch: rig.reference_patch.as_ref().map(Patch::new),
            level_permille: rig.lamp.level_permille,
        }
    }

    /// What the rig is really like.
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// The object's surface: the truth of a fit.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The lamp as a light: at the rig file's level of its own intensity, and proportionally less below.
    pub fn light(&self, pose: Pose) -> Light {
        let level = f64::from(pose.lamp_permille) / f64::from(self.level_permille.max(1));
        Light::Point {
            position: self.truth.lamp.position(pose.angle_deg),
            intensity: self.truth.lamp.intensity.map(|i| i * level),
        }
    }

    /// The chessboard, or the card that lies on it, as held for a view.
    pub fn flat(&self, print: Print, view: usize) -> Flat {
        Flat::view(print, view, self.stage.z, &self.truth.projection, self.size)
    }

    /// The calibration balls.
    pub fn balls(&self) -> Balls {
        Balls::new(&self.stage)
    }

    /// Noise-free radiance of every sensor pixel with the sample on the stage, in the unit in which radiance x seconds = 1 gives
    /// level 128.
    pub fn radiance(&self, pose: Pose) -> Image<[f64; 3]> {
        self.radiance_of(Placed::Sample, pose)
    }

    /// The same with anything on the stage.
    pub fn radiance_of(&self, placed: Placed, pose: Pose) -> Image<[f64; 3]> {
        if pose.lamp_permille == 0 {
            return Image::filled(self.size.0, self.size.1, [0.0; 3]);
        }
        let light = self.light(pose);
        let (size, projection) = (self.size, &self.truth.projection);
        let flat = |print, view| {
            let flat = self.flat(print, view);
            let bounds = self.bounds(flat.outline());
            lens::gather(projection, size, bounds, |ray| flat.radiance(ray, &light))
        };
        let sharp = match placed {
            Placed::Sample => self.with_patch(self.sample(&light), &light),
            Placed::Board { view } => flat(Print::Chessboard, view),
            Placed::Card { on } => flat(Print::Grey, on),
            Placed::Balls => {
                let balls = self.balls();
                let bounds = self.bounds(balls.spheres().iter().flat_map(|s| around(&s.center, s.radius)));
                lens::gather(projection, size, bounds, |ray| balls.radiance(ray, &light))
            }
        };
        lens::blur(sharp, self.truth.blur_px)
    }

    /// Pixels that may show something of a thing inside `points`: left, top, right, bottom.
    fn bounds(&self, points: impl IntoIterator<Item = Vec3>) -> [usize; 4] {
        let (mut low, mut high) = ([f64::INFINITY; 2], [0.0_f64; 2]);
        for point in points {
            let pixel = self.truth.projection.project(&point);
            low = std::array::from_fn(|i| low[i].min(pixel[i]));
            high = std::array::from_fn(|i| high[i].max(pixel[i]));
        }
        let upper = |value: f64, most: usize| (value.ceil() as usize + 2).min(most);
        let lower = |value: f64| (value - 2.0).max(0.0) as usize;
        [lower(low[0]), lower(low[1]), upper(high[0], self.size.0), upper(high[1], self.size.1)]
    }

    /// The part of the picture with the reference patch: left, top, right, bottom.
    pub(super) fn patch_bounds(&self) -> Option<[usize; 4]> {
        self.patch.as_ref().map(|patch| self.bounds(patch.outline()))
    }

    /// Nothing of the patch is before the sample or behind it.
    fn with_patch(&self, mut image: Image<[f64; 3]>, light: &Light) -> Image<[f64; 3]> {
        let Some(patch) = &self.patch else { return image };
        let (bounds, sample) = (self.bounds(patch.outline()), &self.truth.object);
        let seen = lens::gather(&self.truth.projection, self.size, bounds, |ray| patch.radiance(ray, light, sample));
        for (pixel, more) in image.pixels.iter_mut().zip(&seen.pixels) {
            *pixel = std::array::from_fn(|c| pixel[c] + more[c]);
        }
        image
    }

    fn sample(&self, light: &Light) -> Image<[f64; 3]> {
        let mut image = Image::filled(self.size.0, self.size.1, [0.0; 3]);
        let [left, top, right, bottom] = self.bounds(around(&self.truth.object.center, self.truth.object.radius));
        let rows = image.pixels.par_chunks_mut(self.size.0).enumerate().skip(top).take(bottom.saturating_sub(top));
        rows.for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate().take(right).skip(left) {
                *pixel = self.pixel(x, y, light);
            }
        });
        image
    }

    /// Mean radiance of the sample over the area of a pixel.
    fn pixel(&self, x: usize, y: usize, light: &Light) -> [f64; 3] {
        let part = |i: usize| (i as f64 + 0.5) / SUPERSAMPLING as f64;
        let mut sum = [0.0; 3];
        for j in 0..SUPERSAMPLING {
            for i in 0..SUPERSAMPLING {
                let ray = self.truth.projection.ray(x as f64 + part(i), y as f64 + part(j));
                if let Some(point) = self.truth.object.intersect(&ray) {
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

/// Corners of a box whose image holds that of a sphere.
pub(super) fn around(center: &Vec3, radius: f64) -> [Vec3; 8] {
    std::array::from_fn(|i| {
        let side = |bit: usize| if i >> bit & 1 == 0 { -radius } else { radius };
        center + Vec3::new(side(0), side(1), side(2))
    })
}
