//! What the microfacet models share: masking of V-cavities, Fresnel, and angles kept where every model is finite.

use crate::numerics::geometry::Angles;

/// Least cosine a lobe is evaluated at. A surface seen so nearly edge on sends nothing that a pixel could show; without it
/// 1 / (cos_i cos_r) overflows.
const LEAST_COSINE: f64 = 1e-6;

/// Largest tan^2 of the half angle that cosines of at least [`LEAST_COSINE`] allow: cos_h >= (cos_i + cos_r) / 2.
const LARGEST_TAN2: f64 = 1.0 / (LEAST_COSINE * LEAST_COSINE);

/// Reflectance at normal incidence of a dielectric of index 1.5 (plastic, varnish, polished stone).
const F0: f64 = 0.04;

/// The same angles, moved by at most 1e-6 in each cosine so that every lobe is finite.
pub(super) fn bounded(angles: &Angles) -> Angles {
    Angles {
        cos_i: angles.cos_i.max(LEAST_COSINE),
        cos_r: angles.cos_r.max(LEAST_COSINE),
        tan2_half: angles.tan2_half.clamp(0.0, LARGEST_TAN2),
        cos_iv: angles.cos_iv.clamp(-1.0, 1.0),
    }
}

/// 1 / (4 cos_i cos_r), the Jacobian of reflection over the projected areas (Walter et al. 2007, Eq. 14 and 20).
pub(super) fn jacobian(angles: &Angles) -> f64 {
    0.25 / (angles.cos_i * angles.cos_r)
}

/// Cosine of the half-difference angle: light, or view, against the half vector.
fn cos_difference(angles: &Angles) -> f64 {
    (0.5 * (1.0 + angles.cos_iv)).sqrt()
}

/// Masking and shadowing of symmetric V-shaped cavities, 0 to 1 (Torrance and Sparrow 1967; Cook and Torrance 1982, G):
/// min(1, 2 cos_h cos_i / cos_d, 2 cos_h cos_r / cos_d).
pub(super) fn v_cavity(angles: &Angles) -> f64 {
    let cos_half = 1.0 / (1.0 + angles.tan2_half).sqrt();
    let least = angles.cos_i.min(angles.cos_r);
    // Light and view face to face have no half vector: 0 / 0 is not reached because cos_half and least are positive.
    (2.0 * cos_half * least / cos_difference(angles)).min(1.0)
}

/// Schlick's Fresnel reflectance (Schlick 1994, Eq. 15) with F0 = 0.04, over its value at normal incidence: from 1 to 25.
/// So rho_s stays the albedo at normal incidence, and a true dielectric has rho_s = F0.
pub(super) fn fresnel_gain(angles: &Angles) -> f64 {
    1.0 + (1.0 / F0 - 1.0) * (1.0 - cos_difference(angles)).powi(5)
}
