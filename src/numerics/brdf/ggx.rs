//! GGX (Walter, Marschner, Li and Torrance 2007), the distribution of Trowbridge and Reitz 1975.

use super::microfacet::{bounded, fresnel_gain, jacobian};
use super::{Family, Fixed, Lobe};
use crate::numerics::geometry::Angles;
use std::f64::consts::FRAC_1_PI;

/// F D G / (4 cos_i cos_r) (Eq. 20) with D of Eq. 33 and G = G1(light) G1(view), Smith's, of Eq. 34.
///
/// F is Schlick's, F0 = 0.04, over its value at normal incidence: rho_s is the albedo at normal incidence (less the light
/// that Smith's G masks), and up to 25 rho_s is reflected at grazing incidence, so rho_s <= 0.04 is physical. Without that
/// gain the albedo of a unit lobe never exceeds 1.
pub struct Ggx;

impl Lobe for Ggx {
    fn name(&self) -> &'static str {
        "ggx"
    }

    fn family(&self) -> Family {
        Family::Ggx
    }

    fn fixed(&self, angles: &Angles) -> Fixed {
        let angles = bounded(angles);
        let inverse_cos2 = 1.0 + angles.tan2_half;
        let scale = FRAC_1_PI * inverse_cos2 * inverse_cos2 * fresnel_gain(&angles) * jacobian(&angles);
        Fixed { exponent: angles.tan2_half, scale }
    }
}
