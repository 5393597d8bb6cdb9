//! The study's own forward model: what a surface really reflects, from vectors. It shares no code with `numerics::brdf`
//! or the fit, so that a mistake there cannot make its own proof.

use nalgebra::Vector3;
use std::f64::consts::PI;

/// The law by which the materials of a scene really reflect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reflectance {
    /// Isotropic Ward as printed in Zheng, Ma, Zeng 2008, Eq. 4.
    Ward,
    /// GGX with Smith's masking and shadowing, alpha = beta (Walter et al. 2007); rho_s is its reflectance, the same at
    /// every angle.
    Ggx,
    /// The same with Schlick's Fresnel term: rho_s is the reflectance at normal incidence (Schlick 1994).
    GgxFresnel,
}

/// True parameters of one material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueMaterial {
    /// Diffuse albedo per channel.
    pub rho_d: [f64; 3],
    /// Specular albedo per channel.
    pub rho_s: [f64; 3],
    /// Roughness.
    pub beta: f64,
}

/// BRDF per channel, 1/sr, for unit vectors `normal`, towards the light, towards the view; zero below the horizon.
pub fn reflect(
    law: Reflectance,
    material: &TrueMaterial,
    normal: &Vector3<f64>,
    to_light: &Vector3<f64>,
    to_view: &Vector3<f64>,
) -> [f64; 3] {
    let (cos_in, cos_out) = (normal.dot(to_light), normal.dot(to_view));
    if cos_in <= 0.0 || cos_out <= 0.0 {
        return [0.0; 3];
    }
    let half = (to_light + to_view).normalize();
    let cos_half = normal.dot(&half).min(1.0);
    let tan_half = normal.cross(&half).norm() / cos_half;
    let beta = material.beta;
    let lobe = match law {
        Reflectance::Ward => (-(tan_half / beta).powi(2)).exp() / ((cos_in * cos_out).sqrt() * 4.0 * PI * beta * beta),
        Reflectance::Ggx | Reflectance::GgxFresnel => {
            let facets = beta * beta / (PI * cos_half.powi(4) * (beta * beta + tan_half * tan_half).powi(2));
            facets * smith(beta, cos_in) * smith(beta, cos_out) / (4.0 * cos_in * cos_out)
        }
    };
    let rise = match law {
        Reflectance::GgxFresnel => (1.0 - half.dot(to_light).clamp(0.0, 1.0)).powi(5),
        Reflectance::Ward | Reflectance::Ggx => 0.0,
    };
    std::array::from_fn(|c| {
        let specular = material.rho_s[c] + (1.0 - material.rho_s[c]) * rise;
        material.rho_d[c] / PI + specular * lobe
    })
}

/// Smith's share of facets that are seen from a direction (Walter et al. 2007, Eq. 34).
fn smith(alpha: f64, cos: f64) -> f64 {
    let tan2 = (1.0 - cos * cos) / (cos * cos);
    2.0 / (1.0 + (1.0 + alpha * alpha * tan2).sqrt())
}
