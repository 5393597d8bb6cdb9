//! Lambert: diffuse only.

use super::{Family, Fixed, Lobe};
use crate::numerics::geometry::Angles;

/// No lobe at all.
pub struct Lambert;

impl Lobe for Lambert {
    fn name(&self) -> &'static str {
        "lambert"
    }

    fn family(&self) -> Family {
        Family::None
    }

    fn fixed(&self, _: &Angles) -> Fixed {
        Fixed { exponent: 0.0, scale: 0.0 }
    }
}
