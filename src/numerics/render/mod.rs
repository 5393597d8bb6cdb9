//! Rendering a mesh with a captured material (paper 3.7): its weight map as texture, its BRDF parameters as fitted, one light,
//! one camera, shadows.
//!
//! A pixel is the radiance along rays of sight: `I = sum_m gamma_m l_c cos(theta_i) BRDF(alpha_m)` (paper Eq. 1-4) where light
//! arrives, and zero where it does not. Light that is reflected twice is not followed. Pixels do not depend on each other, so
//! the picture is the same to the bit at any number of threads.

pub mod camera;
pub mod mesh;
pub mod patch;
pub mod seam;
pub mod shapes;
pub mod tile;
pub mod tree;

use super::brdf::{Lobe, Material};
use super::geometry::{Angles, Light, Ray, Vec3};
use super::image::Image;
use camera::Camera;
use mesh::{Mesh, Met};
use rayon::prelude::*;
use tile::{Tile, Weights};
use tree::{FAR, Tree};

/// Least distance of what casts a shadow, in parts of the mesh's radius: what lies nearer is the surface itself.
const CONTACT: f64 = 1e-7;

/// How sharply the three projections of a mesh without texture coordinates pass into each other.
const BLEND: i32 = 4;

/// What is rendered.
#[derive(Clone, Copy)]
pub struct Scene<'a> {
    /// The surface.
    pub mesh: &'a Mesh,
    /// The tree over it.
    pub tree: &'a Tree,
    /// Where which material lies.
    pub tile: &'a Tile,
    /// Tiles along one unit of texture coordinate, or along the mesh's longest side where it has no texture coordinates.
    pub repeats: f64,
    /// The reflection model.
    pub lobe: &'a dyn Lobe,
    /// Its parameters, one set a material.
    pub materials: &'a [Material],
    /// The light, in the mesh's frame; irradiance as [`Light::at`] says it.
    pub light: &'a Light,
}

/// A rendered picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Mean radiance of each pixel; zero where nothing is seen.
    pub radiance: Image<[f32; 3]>,
    /// True where a ray of the pixel met the mesh.
    pub seen: Image<bool>,
}

/// Renders a scene with `samples` x `samples` rays a pixel, spread evenly.
pub fn render(scene: &Scene<'_>, camera: &Camera, samples: usize) -> Picture {
    let (width, height) = camera.size();
    let row = |y: usize| -> Vec<([f32; 3], bool)> { (0..width).map(|x| pixel(scene, camera, samples, x, y)).collect() };
    let rows: Vec<_> = (0..height).into_par_iter().map(row).collect();
    let (radiance, seen) = rows.into_iter().flatten().unzip();
    Picture { radiance: Image { width, height, pixels: radiance }, seen: Image { width, height, pixels: seen } }
}

fn pixel(scene: &Scene<'_>, camera: &Camera, samples: usize, x: usize, y: usize) -> ([f32; 3], bool) {
    let place = |pixel: usize, i: usize| pixel as f64 + (i as f64 + 0.5) / samples as f64;
    let (mut sum, mut seen) = ([0.0; 3], false);
    for j in 0..samples {
        for i in 0..samples {
            if let Some(radiance) = scene.radiance(&camera.ray(place(x, i), place(y, j))) {
                seen = true;
                sum = std::array::from_fn(|c| sum[c] + radiance[c]);
            }
        }
    }
    (sum.map(|s| (s / (samples * samples) as f64) as f32), seen)
}

/// A lit point of the surface, as a ray of sight sees it.
#[derive(Clone, Copy, Debug)]
pub struct Lit {
    /// The point.
    pub met: Met,
    /// Under which angles it is lit and seen.
    pub angles: Angles,
    /// Irradiance on a surface that faces the light, per channel.
    pub irradiance: [f64; 3],
}

impl Scene<'_> {
    /// Radiance that comes against a ray of unit direction; none where it meets nothing.
    pub fn radiance(&self, ray: &Ray) -> Option<[f64; 3]> {
        let Some(lit) = self.lit(ray)? else { return Some([0.0; 3]) };
        let brdf = self.brdf(&lit);
        Some(std::array::from_fn(|c| lit.irradiance[c] * lit.angles.cos_i * brdf[c]))
    }

    /// Where a ray meets the surface: none where it meets nothing, none in it where no light arrives.
    pub fn lit(&self, ray: &Ray) -> Option<Option<Lit>> {
        let hit = self.tree.nearest(ray)?;
        let met = self.mesh.at(&hit, &ray.direction);
        let (to_light, irradiance) = self.light.at(&met.position);
        let angles = Angles::new(&met.normal, &to_light, &-ray.direction);
        // Not a number where the light stands in the surface: nothing arrives there either.
        let faces = angles.cos_i > 0.0 && angles.cos_r > 0.0 && met.face_normal.dot(&to_light) > 0.0;
        if !faces || self.is_shadowed(&met.position, &to_light, hit.triangle) {
            return Some(None);
        }
        Some(Some(Lit { met, angles, irradiance }))
    }

    /// BRDF of a lit point per channel, 1/sr: that of the materials by their weights there.
    pub fn brdf(&self, lit: &Lit) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (material, weight) in self.materials.iter().zip(self.weights(&lit.met)) {
            let brdf = material.brdf(self.lobe, &lit.angles);
            for c in 0..3 {
                sum[c] += weight * brdf[c];
            }
        }
        sum
    }

    fn is_shadowed(&self, point: &Vec3, to_light: &Vec3, triangle: usize) -> bool {
        let most = match self.light {
            Light::Point { position, .. } => (position - point).norm(),
            Light::Distant { .. } => FAR,
        };
        let ray = Ray { origin: *point, direction: *to_light };
        self.tree.is_blocked(&ray, triangle, CONTACT * self.mesh.radius(), most)
    }

    /// Weights of a point: by its texture coordinates, or else projected along x, y and z, each by the fourth power of the
    /// normal's component there.
    fn weights(&self, met: &Met) -> Weights {
        if let Some([u, v]) = met.uv {
            return self.tile.at(self.repeats * u, self.repeats * v);
        }
        let place = self.repeats / self.mesh.extent() * (met.position - self.mesh.middle());
        let parts = met.normal.map(|component| component.powi(BLEND));
        let total = parts.sum();
        let mut weights = Weights::default();
        for (axis, [u, v]) in [[place.z, place.y], [place.x, place.z], [place.x, place.y]].into_iter().enumerate() {
            // Pictures stand upright: v runs down, y up.
            let there = self.tile.at(u, -v);
            for (weight, value) in weights.iter_mut().zip(there) {
                *weight += parts[axis] / total * value;
            }
        }
        weights
    }
}
