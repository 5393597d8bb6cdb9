//! Camera response g: pixel level to log exposure (Debevec & Malik 1997), kept monotone.

/// Level whose exposure is the unit: g(REFERENCE_LEVEL) = 0 in every channel, as Debevec & Malik fix the scale.
/// A pixel of radiance 1 reaches this level after 1 s.
pub const REFERENCE_LEVEL: usize = 128;

/// A recovered response: natural logarithm of exposure (radiance x seconds) per channel and 8-bit level.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    /// `log_exposure[channel][level]`, non-decreasing in level.
    pub log_exposure: [Vec<f64>; 3],
}
