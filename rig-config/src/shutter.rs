//! Shutter speeds: the label a body offers and the time it really opens.

/// A shutter speed of a third-stop body.
#[derive(Clone, Debug, PartialEq)]
pub struct Shutter {
    /// As written on the body: `1/100`, `0.4`, `15`.
    pub label: String,
    /// The label as a number, seconds.
    pub nominal_s: f64,
    /// The time the body aims at, 2^(k/3) seconds: a label of 15 opens for 16 s.
    pub true_s: f64,
}
