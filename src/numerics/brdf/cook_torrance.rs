//! Cook and Torrance 1982: Beckmann's distribution, V-cavity masking, Fresnel.

use super::microfacet::{bounded, fresnel_gain, jacobian, v_cavity};
use super::{Family, Fixed, Lobe};
use crate::numerics::geometry::Angles;
use std::f64::consts::FRAC_1_PI;

/// F D G / (4 cos_i cos_r) with Beckmann's D = exp(-tan^2 sigma / beta^2) / (pi beta^2 cos^4 sigma).
///
/// 1982 prints pi where 4 stands here; with 4 and D normalised over the projected hemisphere (Walter et al. 2007, Eq. 4
/// and 25) energy is conserved. F is Schlick's, F0 = 0.04, over its value at normal incidence: rho_s is the albedo at normal
/// incidence, and up to 25 rho_s is reflected at grazing incidence, so rho_s <= 0.04 is physical. Without that gain the
/// albedo of a unit lobe never exceeds 1.
pub struct CookTorrance;

impl Lobe for CookTorrance {
    fn name(&self) -> &'static str {
        "cook-torrance"
    }

    fn family(&self) -> Family {
        Family::Exponential
    }

    fn fixed(&self, angles: &Angles) -> Fixed {
        let angles = bounded(angles);
        let inverse_cos2 = 1.0 + angles.tan2_half;
        let scale =
            FRAC_1_PI * inverse_cos2 * inverse_cos2 * v_cavity(&angles) * fresnel_gain(&angles) * jacobian(&angles);
        Fixed { exponent: angles.tan2_half, scale }
    }
}
