//! Synthetic scenes with known truth: a ball of mixed materials under point lights on an arc, as the rig sees it, with the
//! imperfections of a real one as data.
//!
//! Sphere of 30 mm radius at 1500 mm, 200 mm lens, lights 600 mm from the ball's centre. Radiance is in units of a white
//! Lambert surface that faces a light from 600 mm.

mod expose;
mod stage;
mod texture;

use super::forward::{Reflectance, TrueMaterial};
use crate::numerics::fit::observations::{Observations, Sample};
pub use expose::Clipping;
pub use texture::Texture;

/// Azimuths of the seven lights, degrees about the ball's vertical axis, 0 towards the camera.
pub const LIGHT_AZIMUTHS_DEG: [f64; 7] = [-55.0, -20.0, 15.0, 50.0, 85.0, 115.0, 140.0];

/// Azimuths of the lights that relighting is judged under, degrees; no fit ever sees them.
pub const UNSEEN_AZIMUTHS_DEG: [f64; 4] = [-38.0, -3.0, 32.0, 67.0];

/// Least cosine of incidence and reflection of a sample that relighting is judged on.
pub const UNSEEN_COSINE_CUTOFF: f64 = 0.15;

/// A scene to be generated, and how well the rig sees it. Change fields of [`Scene::marble`] or [`Scene::wood`].
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Points wanted; a grid of pixels comes within a percent of it.
    pub points: usize,
    /// True materials, 1 to 3.
    pub materials: Vec<TrueMaterial>,
    /// How they really reflect.
    pub reflectance: Reflectance,
    /// Where which material lies.
    pub texture: Texture,
    /// Azimuths of the lights, degrees.
    pub azimuths_deg: Vec<f64>,
    /// Least cosine of incidence and reflection of a sample.
    pub cosine_cutoff: f64,
    /// Standard deviation of the multiplicative noise, relative to the radiance.
    pub noise: f64,
    /// Standard deviation of the additive noise (dark floor), relative to the median radiance of the scene.
    pub floor: f64,
    /// True when the samples carry the variance of both noises, as a merge of a bracket would know it; otherwise it is 0.
    pub variance_known: bool,
    /// Where the sensor saturates.
    pub clipping: Option<Clipping>,
    /// Distance between the true and the assumed position of each light, mm, in a random direction.
    pub light_error_mm: f64,
    /// Standard deviation of each light's intensity about the mean of all, relative; the fit assumes the mean.
    pub drift: f64,
    /// True when the fit is told the irradiance at the ball's centre everywhere (Zheng 2008, Eq. 3: no distance term).
    pub distance_ignored: bool,
    /// Share of samples whose radiance is wrong by a factor between 1/3 and 3.
    pub outliers: f64,
}

/// What a solver is given, and what it ought to find.
#[derive(Clone, Debug)]
pub struct Problem {
    /// The samples with all their imperfections.
    pub observations: Observations,
    /// What made them.
    pub truth: Truth,
}

/// What made the observations.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Materials.
    pub materials: Vec<TrueMaterial>,
    /// `gamma[point * materials + m]` of the points of the observations.
    pub gamma: Vec<f64>,
    /// Noise-free samples under the unseen lights, in ascending order of points.
    pub unseen: Vec<Unseen>,
}

/// A point under a light that no fit sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unseen {
    /// The point of the observations.
    pub point: usize,
    /// Angles and irradiance as the fit assumes them, and the true radiance.
    pub sample: Sample,
}

impl Scene {
    /// Light stone with dark veins: 13 067 points, 27 % of them of one material only.
    pub fn marble() -> Self {
        let cream = TrueMaterial { rho_d: [0.70, 0.65, 0.55], rho_s: [0.05, 0.05, 0.05], beta: 0.06 };
        let vein = TrueMaterial { rho_d: [0.12, 0.05, 0.04], rho_s: [0.07, 0.06, 0.06], beta: 0.11 };
        Self::sound(13_067, vec![cream, vein], Texture::Marble)
    }

    /// Wood with rings: 10 997 points, 50 % of them of one material only.
    pub fn wood() -> Self {
        let early = TrueMaterial { rho_d: [0.55, 0.35, 0.18], rho_s: [0.04, 0.04, 0.03], beta: 0.16 };
        let late = TrueMaterial { rho_d: [0.12, 0.05, 0.02], rho_s: [0.06, 0.05, 0.05], beta: 0.23 };
        Self::sound(10_997, vec![early, late], Texture::Wood)
    }

    fn sound(points: usize, materials: Vec<TrueMaterial>, texture: Texture) -> Self {
        Self {
            points,
            materials,
            reflectance: Reflectance::Ward,
            texture,
            azimuths_deg: LIGHT_AZIMUTHS_DEG.to_vec(),
            cosine_cutoff: 0.08,
            noise: 0.02,
            floor: 2e-4,
            variance_known: true,
            clipping: None,
            light_error_mm: 0.0,
            drift: 0.0,
            distance_ignored: false,
            outliers: 0.0,
        }
    }

    /// The problem of this seed. The ball's texture depends on the seed alone, not on the imperfections.
    pub fn generate(&self, seed: u64) -> Problem {
        let stage = stage::Stage::new(self, seed);
        let gamma = texture::weights(self.texture, self.materials.len(), &stage.normals(), seed);
        let (observations, kept) = expose::expose(self, &stage, &gamma, seed);
        let count = self.materials.len();
        let unseen = expose::unseen(self, &stage, &gamma, &kept);
        let gamma = kept.iter().flat_map(|&p| &gamma[p * count..(p + 1) * count]).copied().collect();
        Problem { observations, truth: Truth { materials: self.materials.clone(), gamma, unseen } }
    }
}
