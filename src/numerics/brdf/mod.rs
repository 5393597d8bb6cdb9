//! Reflection models, one file each (paper Eq. 4 and its section 5: the model is replaceable).
//!
//! Every model is `rho_d / pi + rho_s * lobe(angles, beta)` with one roughness `beta`. What of the lobe does not depend on
//! the roughness is computed once a sample ([`Lobe::fixed`]); what does depend on it is one of few [`Family`]s, so that a
//! fit can run through millions of samples without knowing the model.

use super::fit::observations::Row;
use super::geometry::Angles;
use super::simd::{LANES, Lane};
use std::f64::consts::FRAC_1_PI;

pub mod blinn_phong;
pub mod cook_torrance;
pub mod ggx;
pub mod lafortune;
pub mod lambert;
mod microfacet;
pub mod nearest;
pub mod torrance_sparrow;
pub mod ward;
pub mod ward_duer;

/// How a lobe depends on its roughness.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// There is no lobe: rho_s and beta are no parameters.
    None,
    /// `scale * exp(-exponent / beta^2) / beta^2`.
    Exponential,
    /// `scale / (beta^2 (1 + exponent / beta^2)^2) * G1(theta_i) G1(theta_r)` with Smith's
    /// `G1(theta) = 2 / (1 + sqrt(1 + beta^2 tan^2 theta))`.
    Ggx,
}

/// What of a lobe does not depend on its roughness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fixed {
    /// What the roughness is compared with, non-negative: tan^2 of the half angle for most models.
    pub exponent: f64,
    /// Factor of the lobe, 1/sr.
    pub scale: f64,
}

/// A specular lobe of unit specular albedo with one roughness parameter.
pub trait Lobe: Send + Sync {
    /// Name in reports and on the command line.
    fn name(&self) -> &'static str;
    /// How it depends on the roughness.
    fn family(&self) -> Family;
    /// What of it does not.
    fn fixed(&self, angles: &Angles) -> Fixed;

    /// [`Lobe::fixed`] of a whole row: one call for many samples.
    fn fixed_lanes(&self, row: &Row, exponent: &mut Lane, scale: &mut Lane) {
        for lane in 0..LANES {
            let fixed = self.fixed(&row.angles(lane));
            exponent[lane] = fixed.exponent as f32;
            scale[lane] = fixed.scale as f32;
        }
    }

    /// False for a model without a lobe: rho_s and beta are then no parameters.
    fn has_lobe(&self) -> bool {
        self.family() != Family::None
    }

    /// Value of the lobe (1/sr) and its derivative by ln(roughness).
    fn value_and_slope(&self, angles: &Angles, roughness: f64) -> (f64, f64) {
        let angles = &microfacet::bounded(angles);
        let Fixed { exponent, scale } = self.fixed(angles);
        let beta2 = roughness * roughness;
        let x = exponent / beta2;
        match self.family() {
            Family::None => (0.0, 0.0),
            Family::Exponential => {
                let value = scale * (-x).exp() / beta2;
                (value, value * (2.0 * x - 2.0))
            }
            Family::Ggx => {
                let root = |cos: f64| (1.0 + beta2 * (1.0 / (cos * cos) - 1.0)).sqrt();
                let (i, r) = (root(angles.cos_i), root(angles.cos_r));
                let value = scale * 4.0 / (beta2 * (1.0 + x) * (1.0 + x) * (1.0 + i) * (1.0 + r));
                (value, value * (4.0 * x / (1.0 + x) - 2.0 - (i - 1.0) / i - (r - 1.0) / r))
            }
        }
    }
}

/// BRDF parameters of one fundamental material (alpha_m of paper Eq. 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Diffuse albedo per channel.
    pub rho_d: [f64; 3],
    /// Specular albedo per channel.
    pub rho_s: [f64; 3],
    /// Roughness beta.
    pub beta: f64,
}

impl Material {
    /// BRDF value per channel, 1/sr (paper Eq. 4 for the Ward lobe).
    pub fn brdf(&self, lobe: &dyn Lobe, angles: &Angles) -> [f64; 3] {
        let (value, _) = lobe.value_and_slope(angles, self.beta);
        std::array::from_fn(|c| self.rho_d[c] * FRAC_1_PI + self.rho_s[c] * value)
    }
}

/// The model of this name, if rigd has it.
pub fn by_name(name: &str) -> Option<&'static dyn Lobe> {
    MODELS.iter().copied().find(|model| model.name() == name)
}

/// Every model that can be selected, simple ones first.
pub const MODELS: &[&dyn Lobe] = &[
    &lambert::Lambert,
    &blinn_phong::BlinnPhong,
    &torrance_sparrow::TorranceSparrow,
    &cook_torrance::CookTorrance,
    &ward::Ward,
    &ward_duer::WardDuer,
    &lafortune::Lafortune,
    &ggx::Ggx,
];

/// Their names.
pub fn names() -> Vec<&'static str> {
    MODELS.iter().map(|model| model.name()).collect()
}
