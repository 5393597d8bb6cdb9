//! What images cannot tell of shutter times, taken from the times a shutter aims at.
//!
//! With an unknown response, log times s, log radiances x and the curve g may all be multiplied by one exponent a without a trace
//! in the images (Grossberg & Nayar 2003), and shifted by a constant b. Both are chosen such that a s + b comes closest to the
//! expected log times, frames that stand apart not counting.

/// The exponent and shift of a set of log times.
pub struct Gauge {
    /// The factor on the log times.
    pub exponent: f64,
    /// Its standard error: half-width of the interval that holds the truth in 68 % of all brackets.
    pub exponent_sigma: f64,
    /// True if that comes from the frames' own scatter; false if too few agree to show any, and it rests on [`SHUTTER`].
    pub exponent_told: bool,
    /// What is added after it.
    pub shift: f64,
    /// Relative scatter of the times about the expected ones, frames that stand apart not counted.
    pub scatter: f64,
}

/// How far a shutter is from what it aims at or its dial says, relative: dials are up to 7 % off.
pub const SHUTTER: f64 = 0.03;
/// Frames beyond the two that make a line, of which a scatter can be told: a single one may lie on it by chance.
const TELLING: f64 = 2.0;
/// Frames that scatter by less than this about their expected times agree, relative.
const AGREE: f64 = 0.05;
/// Exponents that a wrong time may be blamed for: beyond, no tone curve explains the other frames.
const EXPONENTS: std::ops::RangeInclusive<f64> = 0.5..=2.0;
/// Frames farther outside the others, in standard errors of the line through them, are not judged by it.
const REACH: f64 = 5.0;
/// A frame this many times as far off as the frames are in the middle (median, scaled to a standard deviation) does not count.
/// With ten frames and Gaussian scatter the standard error of the exponent then holds within 10 %.
const APART: f64 = 7.0;
const ROUNDS: usize = 30;
/// Scatter below which nothing stands apart, relative.
const LEAST_SCATTER: f64 = 5e-4;

/// Regresses `expected` on `log_times`, robustly; with `free_exponent` false only the shift is sought. Needs two frames for a
/// shift and three different ones for an exponent; none otherwise.
pub fn gauge(log_times: &[f64], expected: &[f64], free_exponent: bool) -> Option<Gauge> {
    let n = log_times.len();
    if n < if free_exponent { 3 } else { 1 } {
        return None;
    }
    let mut exponent = if free_exponent { median_slope(log_times, expected)? } else { 1.0 };
    let residuals =
        |a: f64, b: f64| -> Vec<f64> { log_times.iter().zip(expected).map(|(s, e)| e - a * s - b).collect() };
    let mut shift = median(residuals(exponent, 0.0));
    let mut weights = vec![1.0; n];
    for _ in 0..ROUNDS {
        let left = residuals(exponent, shift);
        let scale = (1.4826 * median(left.iter().map(|r| r.abs()).collect())).max(LEAST_SCATTER);
        weights = left.iter().map(|r| f64::from(u8::from(r.abs() <= APART * scale))).collect();
        let total: f64 = weights.iter().sum();
        let mean = |v: &[f64]| v.iter().zip(&weights).map(|(v, w)| v * w).sum::<f64>() / total;
        let (s_mean, e_mean) = (mean(log_times), mean(expected));
        if free_exponent {
            let sum = |f: &dyn Fn(usize) -> f64| (0..n).map(|i| weights[i] * f(i)).sum::<f64>();
            let spread = sum(&|i| (log_times[i] - s_mean).powi(2));
            if spread <= 0.0 {
                return None;
            }
            exponent = sum(&|i| (log_times[i] - s_mean) * (expected[i] - e_mean)) / spread;
        }
        shift = e_mean - exponent * s_mean;
    }
    let left = residuals(exponent, shift);
    let total: f64 = weights.iter().sum();
    let freedom = total - if free_exponent { 2.0 } else { 1.0 };
    let scatter = (left.iter().zip(&weights).map(|(r, w)| w * r * r).sum::<f64>() / freedom.max(0.5)).sqrt();
    let s_mean = log_times.iter().zip(&weights).map(|(s, w)| s * w).sum::<f64>() / total;
    let spread: f64 = log_times.iter().zip(&weights).map(|(s, w)| w * (s - s_mean).powi(2)).sum();
    let exponent_told = !free_exponent || freedom >= TELLING;
    let exponent_sigma = match (free_exponent, exponent_told) {
        (false, _) => 0.0,
        (true, true) => student(freedom) * scatter / spread.sqrt(),
        (true, false) => SHUTTER.max(scatter) / spread.sqrt(),
    };
    Some(Gauge { exponent, exponent_sigma, exponent_told, shift, scatter })
}

/// Student's quantile that holds 68.3 % with so many degrees of freedom, two or more, to 0.2 %.
fn student(freedom: f64) -> f64 {
    1.0 + 0.5 / freedom + 0.28 / freedom.powi(2)
}

/// By how much (natural logarithm) the `expected` time of each frame is off, if the others agree with theirs without it: every way
/// in which a single wrong time explains the `log_times` seen, by the frame.
pub fn single_faults(log_times: &[f64], expected: &[f64]) -> Vec<(usize, f64)> {
    let without = |values: &[f64], i: usize| -> Vec<f64> {
        values.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, v)| *v).collect()
    };
    let fault = |i: usize| {
        let line = Line::through(&without(log_times, i), &without(expected, i), true);
        let told = line.error_at(log_times[i]) <= REACH;
        let agree = told && line.scatter <= AGREE && EXPONENTS.contains(&line.exponent);
        agree.then(|| (i, expected[i] - line.at(log_times[i])))
    };
    if log_times.len() < 3 { Vec::new() } else { (0..log_times.len()).filter_map(fault).collect() }
}

/// Relative rms of `expected` about `log_times`, all frames counting, after the exponent (if free) and shift that make it least.
pub fn scatter(log_times: &[f64], expected: &[f64], free_exponent: bool) -> f64 {
    Line::through(log_times, expected, free_exponent).scatter
}

/// Least squares, all frames counting.
struct Line {
    frames: f64,
    exponent: f64,
    means: (f64, f64),
    spread: f64,
    scatter: f64,
}

impl Line {
    fn through(log_times: &[f64], expected: &[f64], free_exponent: bool) -> Self {
        let n = log_times.len() as f64;
        let mean = |v: &[f64]| v.iter().sum::<f64>() / n;
        let means @ (s_mean, e_mean) = (mean(log_times), mean(expected));
        let pairs = || log_times.iter().zip(expected).map(|(s, e)| (s - s_mean, e - e_mean));
        let spread: f64 = pairs().map(|(s, _)| s * s).sum();
        let exponent =
            if free_exponent && spread > 0.0 { pairs().map(|(s, e)| s * e).sum::<f64>() / spread } else { 1.0 };
        let freedom = (n - if free_exponent { 2.0 } else { 1.0 }).max(1.0);
        let scatter = (pairs().map(|(s, e)| (e - exponent * s).powi(2)).sum::<f64>() / freedom).sqrt();
        Self { frames: n, exponent, means, spread, scatter }
    }

    fn at(&self, log_time: f64) -> f64 {
        self.means.1 + self.exponent * (log_time - self.means.0)
    }

    /// Standard error of [`Line::at`] if the frames scatter by 1.
    fn error_at(&self, log_time: f64) -> f64 {
        (1.0 / self.frames + (log_time - self.means.0).powi(2) / self.spread).sqrt()
    }
}

/// Median of the slopes through all pairs (Theil & Sen): up to 29 % of the frames may be wrong.
fn median_slope(s: &[f64], e: &[f64]) -> Option<f64> {
    let pairs = (0..s.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    let slopes: Vec<f64> = pairs.filter(|&(i, j)| s[i] != s[j]).map(|(i, j)| (e[i] - e[j]) / (s[i] - s[j])).collect();
    (!slopes.is_empty()).then(|| median(slopes)).filter(|slope| *slope > 0.0)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    if n == 0 { 0.0 } else { 0.5 * (values[(n - 1) / 2] + values[n / 2]) }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use rand::SeedableRng;
    use rand::rngs::Xoshiro256PlusPlus;
    use rand_distr::{Distribution, StandardNormal};

    const EXPECTED: [f64; 8] = [-4.6, -3.2, -1.8, -0.9, 0.0, 0.7, 1.4, 2.8];

    #[test]
    fn exponent_and_shift_are_found_in_spite_of_wrong_frames() {
        let mut times = EXPECTED.map(|e| (e - 0.3) / 1.02);
        times[2] += 0.5;
        times[6] -= 0.1;
        let found = gauge(&times, &EXPECTED, true).unwrap();
        assert!((found.exponent - 1.02).abs() < 1e-9 && (found.shift - 0.3).abs() < 1e-9);
        assert!(found.scatter < 1e-9 && found.exponent_sigma < 1e-9);
        let found = gauge(&EXPECTED.map(|e| e - 0.25), &EXPECTED, false).unwrap();
        assert!((found.exponent, (found.shift - 0.25).abs() < 1e-12) == (1.0, true));
    }

    #[test]
    fn the_exponents_standard_error_is_that_of_a_regression() {
        // Residuals +-1e-3 orthogonal to level and slope: sigma^2 = sum r^2 / (n - 2), its slope's error sigma / sqrt(sum s^2).
        let times = [-3.0, -1.0, 1.0, 3.0];
        let found = gauge(&times, &[-3.001, -0.997, 0.997, 3.001], true).unwrap();
        let rms = (found.scatter / (2.0e-6_f64 * 10.0 / 2.0).sqrt()).ln().abs();
        assert!(rms < 0.7, "{}", found.scatter);
        assert!((found.exponent_sigma / (1.32 * found.scatter / 20.0_f64.sqrt()) - 1.0).abs() < 0.3);
    }

    /// Student's 0.8413 quantiles from tables.
    #[test]
    fn few_frames_widen_the_interval_as_student_says() {
        for (freedom, quantile) in [(2.0, 1.3213), (3.0, 1.1969), (4.0, 1.1416), (6.0, 1.0906), (8.0, 1.0671)] {
            assert!((student(freedom) / quantile - 1.0).abs() < 2e-3, "{freedom}: {}", student(freedom));
        }
    }

    #[test]
    fn the_standard_error_of_the_exponent_holds_for_any_number_of_frames() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
        for n in [4, 5, 6, 8, 10] {
            let expected: Vec<f64> = (0..n).map(|k| 0.7 * f64::from(k)).collect();
            let (mut told, mut inside) = (0.0, 0.0);
            for _ in 0..1500 {
                let mut shutter = |e: &f64| e + 0.004 * Distribution::<f64>::sample(&StandardNormal, &mut random);
                let times: Vec<f64> = expected.iter().map(&mut shutter).collect();
                let found = gauge(&times, &expected, true).unwrap();
                told += f64::from(u8::from(found.exponent_told));
                let hit = found.exponent_told && (found.exponent - 1.0).abs() < found.exponent_sigma;
                inside += f64::from(u8::from(hit));
            }
            assert!(told > 1200.0, "{n} frames: told in {told} of 1500");
            assert!((0.58..0.74).contains(&(inside / told)), "{n} frames: {} inside", inside / told);
        }
    }

    #[test]
    fn three_frames_do_not_tell_the_exponent_however_well_they_lie() {
        for times in [[0.0, 0.7, 1.4], [0.0, 0.9, 1.4], [0.0, 0.7, 2.0]] {
            let found = gauge(&times, &[0.0, 0.7, 1.4], true).unwrap();
            assert!(!found.exponent_told && found.exponent_sigma > 0.02, "{times:?}: {}", found.exponent_sigma);
        }
    }

    #[test]
    fn a_wrong_time_is_found_among_four_and_shared_by_three() {
        let expected = [0.0, 1.0, 2.0, 3.0];
        let faults = single_faults(&[0.0, 1.0, 2.0, 3.5], &expected);
        assert!(matches!(faults[..], [(3, off)] if (off + 0.5).abs() < 1e-9), "{faults:?}");
        let faults = single_faults(&[0.0, 1.0, 2.5], &expected[..3]);
        assert_eq!(faults.iter().map(|(i, _)| *i).collect::<Vec<_>>(), [0, 1, 2]);
    }

    #[test]
    fn scatter_counts_every_frame() {
        let mut times = EXPECTED;
        times[3] += 0.1;
        assert!(scatter(&times, &EXPECTED, true) > 0.03);
        assert!(scatter(&EXPECTED.map(|e| 0.9 * e + 4.0), &EXPECTED, true) < 1e-12);
        assert!(scatter(&EXPECTED.map(|e| 0.9 * e), &EXPECTED, false) > 0.1);
    }

    #[test]
    fn too_few_frames_have_no_exponent() {
        assert!(gauge(&[0.0, 1.0], &[0.0, 1.0], true).is_none());
        assert!(gauge(&[1.0, 1.0, 1.0], &[0.0, 1.0, 2.0], true).is_none());
    }
}
