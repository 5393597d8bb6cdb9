//! Reflection models, one file each (paper Eq. 4 and its section 5: the model is replaceable).

use super::geometry::Angles;

pub mod lambert;
pub mod ward;

/// A specular lobe of unit specular albedo with one roughness parameter.
pub trait Lobe: Send + Sync {
    /// Name in reports and on the command line.
    fn name(&self) -> &'static str;
    /// False for a model without a lobe: rho_s and beta are then no parameters.
    fn has_lobe(&self) -> bool;
    /// Value of the lobe (1/sr) and its derivative by ln(roughness).
    fn value_and_slope(&self, angles: &Angles, roughness: f64) -> (f64, f64);
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
        std::array::from_fn(|c| self.rho_d[c] * std::f64::consts::FRAC_1_PI + self.rho_s[c] * value)
    }
}

/// The model of this name, if rigd has it.
pub fn by_name(name: &str) -> Option<&'static dyn Lobe> {
    MODELS.iter().copied().find(|model| model.name() == name)
}

/// Every model that can be selected.
pub const MODELS: &[&dyn Lobe] = &[&lambert::Lambert, &ward::Ward];
