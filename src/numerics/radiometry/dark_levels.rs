//! The dark end of a response, freed of the beat between the camera's counts and the levels.
//!
//! A camera rounds twice, to counts and then to levels. Where a count spans a half or a third of a level, the two grids keep step
//! over a run of levels, and the mean level of any number of pixels stays off the tone curve by as much as half a span: at level
//! 30 of a 12-bit camera 1 % of the exposure. Solving for the curve reproduces it, for it is in the data. But a tone curve bends
//! gently over the logarithm of the level (a power law not at all), the beat within a few levels; so each dark level takes the
//! value there of a parabola over ln level through its neighbours.

use super::response::{LEVELS, level_sigma, slope};

/// Counts from black to saturation: a 12-bit camera's. One that counts finer is smoothed more than it needs.
const COUNTS: f64 = 3500.0;
/// Levels to either side that a parabola is fitted to, for each level that a count spans: a few beats.
const REACH: f64 = 32.0;
/// ... and the most.
const FARTHEST: f64 = 16.0;
/// Fewer levels to a side hold no beat worth smoothing.
const NEAREST: f64 = 6.0;
/// What the beat, a third of a span, is as an error of single samples that would leave the mean of some thousands as uncertain.
const SHARED: f64 = 20.0;

/// Smooths a non-decreasing curve, log exposure by level, where counts are coarse. It stays non-decreasing.
pub(super) fn smooth(curve: &[f64]) -> Vec<f64> {
    let reach = |level: usize| (REACH * span(curve, level)).min(FARTHEST).min(0.4 * level as f64);
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

/// Levels that a count spans.
fn span(curve: &[f64], level: usize) -> f64 {
    let charge = (curve[level] - curve[LEVELS - 1]).exp();
    1.0 / (COUNTS * charge * slope(curve, level as f64)).max(f64::MIN_POSITIVE)
}

/// Standard error of the log exposure that a smoothed curve gives one sample: what [`level_sigma`] says and the beat, which all
/// samples of a level share, so that it weighs as much as hundreds of samples.
pub(super) fn smoothed_sigma(curve: &[f64]) -> impl Fn(f64) -> f64 {
    let sigma = level_sigma(curve);
    move |level| {
        let beat = SHARED * span(curve, level as usize) * slope(curve, level);
        sigma(level).hypot(beat)
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Log exposure of every level, 0 at saturation.
    fn curve(charge: impl Fn(f64) -> f64) -> Vec<f64> {
        (0..LEVELS).map(|level| charge((level as f64).max(0.5)).ln()).collect()
    }

    /// The charge at which the mean of levels rounded from 12-bit counts is `level`: photon and read noise of 80 000 e-, 30 e-.
    fn seen(level: f64, tone: &impl Fn(f64) -> f64) -> f64 {
        let counts = 3564.0;
        let mean = |charge: f64| {
            let sigma = (80_000.0 * charge + 900.0).sqrt() / 80_000.0 * counts;
            let middle = charge * counts;
            let (mut sum, mut total) = (0.0, 0.0);
            for count in (middle - 8.0 * sigma).floor() as i64..=(middle + 8.0 * sigma) as i64 {
                // The part of the noise that is rounded to this count, near enough.
                let share: f64 = (0..10)
                    .map(|i| (-0.5 * ((count as f64 - 0.45 + 0.1 * f64::from(i) - middle) / sigma).powi(2)).exp())
                    .sum();
                sum += share * (255.0 * tone((count as f64 / counts).clamp(0.0, 1.0))).round();
                total += share;
            }
            sum / total
        };
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if mean(middle) < level { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    #[test]
    fn a_power_law_stays_and_a_linear_toe_nearly_does() {
        let power = curve(|level| (level / 255.0).powf(2.3));
        for (made, given) in smooth(&power).iter().zip(&power) {
            assert!((made - given).abs() < 1e-9);
        }
        let srgb = curve(|level| {
            let v = level / 255.0;
            if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        });
        for (level, (made, given)) in smooth(&srgb).iter().zip(&srgb).enumerate() {
            assert!((made - given).abs() < 2e-3, "level {level}: {made} for {given}");
        }
    }

    #[test]
    fn the_beat_of_counts_and_levels_is_taken_out() {
        let worst = |curve: &[f64], truth: &[f64]| {
            let error = |level: usize| ((curve[level] - curve[128]) - (truth[level] - truth[128])).abs();
            (28..=128).map(error).fold(0.0, f64::max)
        };
        for power in [2.2, 2.3, 2.4] {
            let truth = curve(|level| (level / 255.0).powf(power));
            // Below level 10 noise makes levels of nothing; above 200 counts are fine.
            let bent: Vec<f64> = (0..LEVELS)
                .map(|level| match level {
                    10..=200 => seen(level as f64, &|charge| charge.powf(1.0 / power)).ln(),
                    _ => truth[level],
                })
                .collect();
            let (before, after) = (worst(&bent, &truth), worst(&smooth(&bent), &truth));
            println!("power {power}: {before:.4} before, {after:.4} after");
            assert!(before > 0.007 && after < 0.006 && after < 0.75 * before, "{power}: {before} {after}");
        }
    }

    #[test]
    fn a_flat_or_broken_curve_stays_non_decreasing() {
        let mut steps: Vec<f64> = (0..LEVELS).map(|level| (level / 9) as f64 * 0.3 - 8.0).collect();
        steps[..30].fill(-20.0);
        for curve in [vec![0.0; LEVELS], steps] {
            let made = smooth(&curve);
            assert!(made.windows(2).all(|pair| pair[0] <= pair[1]) && made.iter().all(|g| g.is_finite()));
        }
    }
}
