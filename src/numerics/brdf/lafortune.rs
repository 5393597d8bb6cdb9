//! Lafortune, Foo, Torrance and Greenberg 1997, restricted to one isotropic lobe about the mirror direction.

use super::microfacet::bounded;
use super::{Family, Fixed, Lobe};
use crate::numerics::geometry::Angles;
use std::f64::consts::FRAC_1_PI;

/// Where the cosine to the mirror direction is this or less there is no lobe.
const LEAST_COSINE: f64 = 1e-4;

/// (n + 2) / (2 pi) cos_m^n, n = 2 / beta^2 - 2, with cos_m between view and mirrored light: C_x = C_y = -C_z in Eq. 8 of
/// 1997, normalised as in Lafortune and Willems 1994.
///
/// A restriction: the full model fits C_xy, C_z and n of several lobes and thereby bends them (off-specular peaks,
/// retro-reflection); one roughness cannot. What is left is Phong's lobe (1975) made reciprocal. Near the mirror direction
/// cos_m falls as the half vector turns by half the angle, so a highlight needs twice the beta it has in the
/// half-vector models. The albedo of a unit lobe is 1 at normal incidence and falls towards grazing.
pub struct Lafortune;

impl Lobe for Lafortune {
    fn name(&self) -> &'static str {
        "lafortune"
    }

    fn family(&self) -> Family {
        Family::Exponential
    }

    fn fixed(&self, angles: &Angles) -> Fixed {
        let angles = bounded(angles);
        let cos_mirror = 2.0 * angles.cos_i * angles.cos_r - angles.cos_iv;
        if cos_mirror <= LEAST_COSINE {
            return Fixed { exponent: 0.0, scale: 0.0 };
        }
        // cos_m^n = exp(-(-2 ln cos_m) / beta^2) / cos_m^2; rounding may leave cos_m a little above 1.
        let cos_mirror = cos_mirror.min(1.0);
        Fixed { exponent: -2.0 * cos_mirror.ln(), scale: FRAC_1_PI / (cos_mirror * cos_mirror) }
    }
}
