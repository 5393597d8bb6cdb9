//! Isotropic Ward (Ward 1992) as printed in paper Eq. 4.

use super::Lobe;
use crate::numerics::geometry::Angles;
use std::f64::consts::PI;

/// exp(-tan^2 sigma / beta^2) / (sqrt(cos_i cos_r) 4 pi beta^2).
pub struct Ward;

impl Lobe for Ward {
    fn name(&self) -> &'static str {
        "ward"
    }

    fn has_lobe(&self) -> bool {
        true
    }

    fn value_and_slope(&self, angles: &Angles, beta: f64) -> (f64, f64) {
        let beta2 = beta * beta;
        let exponent = angles.tan2_half / beta2;
        let value = (-exponent).exp() / ((angles.cos_i * angles.cos_r).sqrt() * 4.0 * PI * beta2);
        (value, value * (2.0 * exponent - 2.0))
    }
}
