//! What images cannot tell of shutter times, taken from the times a shutter aims at.
//!
//! With an unknown response, log times s, log radiances x and the curve g may all be multiplied by one exponent a without a trace
//! in the images (Grossberg & Nayar 2003), and shifted by a constant b. Both are chosen such that a s + b comes closest to the
//! expected log times, frames that stand apart not counting.

/// The exponent and shift of a set of log times.
pub struct Gauge {
    /// The factor on the log times.
    pub exponent: f64,
    /// Its standard error.
    pub exponent_sigma: f64,
    /// What is added after it.
    pub shift: f64,
    /// Relative scatter of the times about the expected ones, frames that stand apart not counted.
    pub scatter: f64,
}

/// Tukey's constant: 95 % of the efficiency of least squares.
const TUKEY: f64 = 4.685;
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
        weights = left.iter().map(|r| (1.0 - (r / (TUKEY * scale)).powi(2)).max(0.0).powi(2)).collect();
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
    let freedom = (total - if free_exponent { 2.0 } else { 1.0 }).max(0.5);
    let scatter = (left.iter().zip(&weights).map(|(r, w)| w * r * r).sum::<f64>() / freedom).sqrt();
    let s_mean = log_times.iter().zip(&weights).map(|(s, w)| s * w).sum::<f64>() / total;
    let spread: f64 = log_times.iter().zip(&weights).map(|(s, w)| w * (s - s_mean).powi(2)).sum();
    let exponent_sigma = if free_exponent { scatter / spread.sqrt() } else { 0.0 };
    Some(Gauge { exponent, exponent_sigma, shift, scatter })
}

/// Relative rms of `expected` about `log_times`, all frames counting, after the exponent (if free) and shift that make it least.
pub fn scatter(log_times: &[f64], expected: &[f64], free_exponent: bool) -> f64 {
    let n = log_times.len() as f64;
    let mean = |v: &[f64]| v.iter().sum::<f64>() / n;
    let (s_mean, e_mean) = (mean(log_times), mean(expected));
    let pairs = || log_times.iter().zip(expected).map(|(s, e)| (s - s_mean, e - e_mean));
    let spread: f64 = pairs().map(|(s, _)| s * s).sum();
    let exponent = if free_exponent && spread > 0.0 { pairs().map(|(s, e)| s * e).sum::<f64>() / spread } else { 1.0 };
    let freedom = (n - if free_exponent { 2.0 } else { 1.0 }).max(1.0);
    (pairs().map(|(s, e)| (e - exponent * s).powi(2)).sum::<f64>() / freedom).sqrt()
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
