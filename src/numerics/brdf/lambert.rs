//! Lambert: diffuse only.

use super::Lobe;
use crate::numerics::geometry::Angles;

/// No lobe at all.
pub struct Lambert;

impl Lobe for Lambert {
    fn name(&self) -> &'static str {
        "lambert"
    }

    fn has_lobe(&self) -> bool {
        false
    }

    fn value_and_slope(&self, _: &Angles, _: f64) -> (f64, f64) {
        (0.0, 0.0)
    }
}
