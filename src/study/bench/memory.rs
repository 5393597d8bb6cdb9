//! Memory that large fits need, and that there is.

use super::BenchError;
use crate::numerics::fit::observations::{Observations, Row};
use crate::numerics::fit::prepared::ReadyRow;
use crate::numerics::simd::LANES;
use crate::store::memory;
use std::path::Path;

/// What is kept a point: its pixel and number of samples, and its share of the table of blocks.
const POINT_BYTES: f64 = 8.0 + 2.0 + 8.0 / LANES as f64;

/// Times the weights of a point are in memory at once: as found by the parts of a pass, and joined.
const WEIGHT_COPIES: f64 = 2.0;

/// Room for what is small beside samples and weights.
const ROOM: f64 = 1.1;

/// Too little memory for a size.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("not measured: needs {:.1} GB of memory, {:.1} GB are available", needed_bytes * 1e-9, available_bytes * 1e-9)]
pub struct Shortage {
    /// What the fit needs.
    pub needed_bytes: f64,
    /// What the machine has left.
    pub available_bytes: f64,
}

/// How much of the samples a fit makes ready at a time.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Ready {
    /// All of them.
    All,
    /// A small part.
    Part,
}

/// Bytes that a fit of `points` like those of `source` needs, the observations included.
pub fn needed_bytes(source: &Observations, points: usize, materials: usize, ready: Ready) -> f64 {
    // Points side by side take as many rows as the one with most samples.
    let slots = (source.rows().len() * LANES) as f64 / source.points() as f64;
    let lane = |row: usize| row as f64 / LANES as f64;
    let made_ready = if ready == Ready::All { lane(size_of::<ReadyRow>()) } else { 0.0 };
    let weights = WEIGHT_COPIES * (materials * size_of::<f64>()) as f64;
    ROOM * points as f64 * (slots * (lane(size_of::<Row>()) + made_ready) + POINT_BYTES + weights)
}

/// Nothing when so much memory can be had.
pub fn check(needed_bytes: f64, available_bytes: f64) -> Result<(), Shortage> {
    if needed_bytes <= available_bytes { Ok(()) } else { Err(Shortage { needed_bytes, available_bytes }) }
}

/// Memory that can be had without swapping, bytes.
pub fn available_bytes() -> Result<f64, BenchError> {
    memory::available(Path::new("/proc"))
        .map(|bytes| bytes as f64)
        .map_err(|error| BenchError::Memory(format!(": {error}")))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::study::scene::Scene;

    #[test]
    fn need_is_that_of_rows_and_weights_and_a_shortage_says_both_figures() {
        let source = Scene { points: 300, ..Scene::marble() }.generate(0).observations;
        let need = |points, ready| needed_bytes(&source, points, 2, ready);
        let rows = size_of_val(source.rows()) as f64;
        assert!((rows..1.5 * rows).contains(&need(source.points(), Ready::Part)));
        assert!(need(1000, Ready::All) > 1.5 * need(1000, Ready::Part));
        assert!(check(9e9, 9e9).is_ok());
        let refusal = check(11e9, 8.04e9).unwrap_err().to_string();
        assert_eq!(refusal, "not measured: needs 11.0 GB of memory, 8.0 GB are available");
    }
}
