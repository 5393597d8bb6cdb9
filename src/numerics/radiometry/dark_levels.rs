//! The dark end of a response, freed of the beat between the camera's counts and the levels.
//!
//! A camera rounds twice, to counts and then to levels. Where a count spans a half or a third of a level, the two grids keep step
//! over a run of levels, and the mean level of any number of pixels stays off the tone curve by as much as half a span: at level
//! 30 of a 12-bit camera 1 % of the exposure. Solving for the curve reproduces it, for it is in the data. But a tone curve bends
//! gently over the logarithm of the level (a power law not at all), the beat within a few levels; so each dark level takes the
//! value there of a parabola over ln level through its neighbours.

use super::response::{LEVELS, slope};

/// Counts from black to saturation: a 12-bit camera's. One that counts finer is smoothed more than it needs.
const COUNTS: f64 = 3500.0;
/// Levels to either side that a parabola is fitted to, for each level that a count spans: a few beats.
const REACH: f64 = 32.0;
/// ... and the most.
const FARTHEST: f64 = 16.0;
/// Fewer levels to a side hold no beat worth smoothing.
const NEAREST: f64 = 6.0;

/// Smooths a non-decreasing curve, log exposure by level, where counts are coarse. It stays non-decreasing.
pub(super) fn smooth(curve: &[f64]) -> Vec<f64> {
    let reach = |level: usize| {
        let charge = (curve[level] - curve[LEVELS - 1]).exp();
        let span = 1.0 / (COUNTS * charge * slope(curve, level as f64)).max(f64::MIN_POSITIVE);
        (REACH * span).min(FARTHEST).min(0.4 * level as f64)
    };
    let mut smoothed: Vec<f64> = (0..LEVELS)
        .map(|level| {
            let reach = reach(level);
            if reach < NEAREST { curve[level] } else { parabola(curve, level, reach).unwrap_or(curve[level]) }
        })
        .collect();
    for level in 1..LEVELS {
        smoothed[level] = smoothed[level].max(smoothed[level - 1]);
    }
    smoothed
}

/// The value at `level` of the parabola over ln level that fits the levels within `reach` best, near ones above all.
fn parabola(curve: &[f64], level: usize, reach: f64) -> Option<f64> {
    let mut moments = [0.0; 5];
    let mut sums = nalgebra::Vector3::zeros();
    let first = (level as f64 - reach).ceil().max(1.0) as usize;
    for z in first..LEVELS.min((level as f64 + reach) as usize + 1) {
        let weight = (1.0 - ((z as f64 - level as f64) / reach).powi(2)).max(0.0);
        let u = (z as f64 / level as f64).ln();
        let mut power = weight;
        for (k, moment) in moments.iter_mut().enumerate() {
            *moment += power;
            if let Some(sum) = sums.get_mut(k) {
                *sum += power * curve[z];
            }
            power *= u;
        }
    }
    let normal = nalgebra::Matrix3::from_fn(|i, j| moments[i + j]);
    Some(normal.cholesky()?.solve(&sums)[0])
}
