//! Torrance and Sparrow 1967: facets with a Gaussian of the half angle, in V-shaped cavities.

use super::microfacet::{bounded, jacobian, v_cavity};
use super::{Family, Fixed, Lobe};
use crate::numerics::geometry::Angles;
use std::f64::consts::FRAC_1_PI;

/// D G / (4 cos_i cos_r) with D = exp(-sigma^2 / beta^2) / (pi beta^2), sigma the half angle in radians, and the
/// V-cavity masking G.
///
/// The paper leaves its distribution unnormalised (b exp(-c^2 alpha^2)); 1 / (pi beta^2) normalises it up to a factor of
/// about 1 - 2 beta^2 / 3 that never exceeds 1. Its Fresnel factor is taken as constant, a part of rho_s. The albedo of a
/// unit lobe never exceeds 1.
pub struct TorranceSparrow;

impl Lobe for TorranceSparrow {
    fn name(&self) -> &'static str {
        "torrance-sparrow"
    }

    fn family(&self) -> Family {
        Family::Exponential
    }

    fn fixed(&self, angles: &Angles) -> Fixed {
        let angles = bounded(angles);
        let half_angle = angles.half_angle();
        Fixed { exponent: half_angle * half_angle, scale: FRAC_1_PI * v_cavity(&angles) * jacobian(&angles) }
    }
}
