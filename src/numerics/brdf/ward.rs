//! Isotropic Ward (Ward 1992) as printed in paper Eq. 4.

use super::microfacet::bounded;
use super::{Family, Fixed, Lobe};
use crate::numerics::fit::observations::Row;
use crate::numerics::geometry::Angles;
use crate::numerics::simd::{LANES, Lane};
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

    // The default model has millions of samples to get ready: without f64 the loop becomes vector instructions.
    fn fixed_lanes(&self, row: &Row, exponent: &mut Lane, scale: &mut Lane) {
        *exponent = row.tan2_half;
        for lane in 0..LANES {
            scale[lane] = 1.0 / ((row.cos_i[lane] * row.cos_r[lane]).sqrt() * (4.0 * std::f32::consts::PI));
        }
    }
}
