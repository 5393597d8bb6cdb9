//! The lobe that other programs' materials have: Trowbridge and Reitz's (GGX) under a reflectance that is the same at all angles, or
//! rises as Schlick's of a dielectric does.

use crate::numerics::brdf::nearest::{Nearest, Other, ggx_smith, nearest};
use crate::numerics::brdf::{Lobe, Material};
use crate::numerics::geometry::Angles;

/// Reflectance at normal incidence for an index of refraction of 1.5, the default of every format.
pub const DIELECTRIC_F0: f64 = 0.04;

/// A matt surface under such a lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ggx {
    /// Diffuse albedo per channel.
    pub diffuse: [f64; 3],
    /// Width of the lobe; the formats call its square root roughness.
    pub alpha: f64,
    /// Reflectance at normal incidence per channel, 0 to 1.
    pub f0: [f64; 3],
    /// True where it rises towards grazing light as that of a dielectric; else it is the same at all angles.
    pub rises: bool,
}

/// Schlick's (1 - cos)^5: how far a reflectance has risen from normal incidence (0) to grazing light (1).
pub fn rise(angles: &Angles) -> f64 {
    (1.0 - angles.cos_difference()).powi(5)
}

/// The surface that comes nearest to a fitted material.
pub fn closest(lobe: &dyn Lobe, material: &Material) -> Ggx {
    let rising =
        |angles: &Angles, alpha: f64| (1.0 + (1.0 / DIELECTRIC_F0 - 1.0) * rise(angles)) * ggx_smith(angles, alpha);
    let tried: [(&Other, bool); 2] = [(&ggx_smith, false), (&rising, true)];
    let [constant, rising] = tried.map(|(other, rises)| (nearest(material, lobe, other), rises));
    let (Nearest { diffuse, specular, alpha, .. }, rises) =
        if constant.0.error <= rising.0.error { constant } else { rising };
    Ggx { diffuse, alpha, f0: specular.map(|f0| f0.min(1.0)), rises }
}
