//! Blinn-Phong (Blinn 1977): a cosine lobe about the half vector.

use super::microfacet::{bounded, jacobian};
use super::{Family, Fixed, Lobe};
use crate::numerics::geometry::Angles;
use std::f64::consts::FRAC_1_PI;

/// D / (4 cos_i cos_r) with D = (n + 2) / (2 pi) cos_h^n, n = 2 / beta^2 - 2 (Walter et al. 2007, Eq. 30 and their
/// alpha_p = 2 / alpha_b^2 - 2, which makes beta comparable with Beckmann's and Ward's).
///
/// The microfacet factor 1 / (4 cos_i cos_r) was taken, not the bare lobe of 1977: only with it is rho_s the albedo at
/// normal incidence, as in the other models, because D is then a normalised distribution of facets. Without masking it
/// can exceed energy conservation: the albedo of a unit lobe grows without bound at grazing view (beta 0.3: 1.00 at normal
/// view, 0.96 at 60 degrees, 1.11 at 80, 5.5 at 89).
pub struct BlinnPhong;

impl Lobe for BlinnPhong {
    fn name(&self) -> &'static str {
        "blinn-phong"
    }

    fn family(&self) -> Family {
        Family::Exponential
    }

    fn fixed(&self, angles: &Angles) -> Fixed {
        let angles = bounded(angles);
        // cos_h^n = exp(-(-2 ln cos_h) / beta^2) / cos_h^2, and -2 ln cos_h = ln(1 + tan^2).
        let scale = FRAC_1_PI * (1.0 + angles.tan2_half) * jacobian(&angles);
        Fixed { exponent: angles.tan2_half.ln_1p(), scale }
    }
}
