//! Isotropic Ward (Ward 1992) as printed in paper Eq. 4.

use super::microfacet::bounded;
use super::{Family, Fixed, Lobe};
use crate::numerics::geometry::Angles;
use std::f64::consts::PI;

/// exp(-tan^2 sigma / beta^2) / (sqrt(cos_i cos_r) 4 pi beta^2).
///
/// rho_s is not its albedo: that of a unit lobe falls about as cos_r (beta 0.1: 0.971 at normal view, 0.489 at 60 degrees)
/// and grows without bound in the last degree, where it exceeds energy conservation.
pub struct Ward;

impl Lobe for Ward {
    fn name(&self) -> &'static str {
        "ward"
    }

    fn family(&self) -> Family {
        Family::Exponential
    }

    fn fixed(&self, angles: &Angles) -> Fixed {
        let angles = bounded(angles);
        Fixed { exponent: angles.tan2_half, scale: 1.0 / ((angles.cos_i * angles.cos_r).sqrt() * 4.0 * PI) }
    }
}
