//! Isotropic Ward (Ward 1992) as printed in paper Eq. 4.

use super::{Family, Fixed, Lobe};
use crate::numerics::geometry::Angles;
use std::f64::consts::PI;

/// exp(-tan^2 sigma / beta^2) / (sqrt(cos_i cos_r) 4 pi beta^2).
pub struct Ward;

impl Lobe for Ward {
    fn name(&self) -> &'static str {
        "ward"
    }

    fn family(&self) -> Family {
        Family::Exponential
    }

    fn fixed(&self, angles: &Angles) -> Fixed {
        Fixed { exponent: angles.tan2_half, scale: 1.0 / ((angles.cos_i * angles.cos_r).sqrt() * 4.0 * PI) }
    }
}
