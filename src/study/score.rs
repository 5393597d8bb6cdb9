//! How good a found mixture is, against the truth that made the observations.

use super::scene::{Problem, Truth};
use crate::numerics::brdf::{Lobe, Material};
use crate::numerics::fit::observations::{HIGHLIGHT_HALF_ANGLE, Sample};
use crate::numerics::fit::{Mixture, predict};

/// Relight error that the true BRDF parameters leave on the undisturbed scenes (marble 0.60 %, wood 0.58 %): the noise of
/// each point's own weights.
pub const BEST_RELIGHT: f64 = 0.006;

/// A fit has failed when its relight error exceeds this many times [`BEST_RELIGHT`].
pub const FAILURE_FACTOR: f64 = 3.0;

/// Errors of a mixture, all relative (0.01 is 1 %) except that of the weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// Mean of |I - model| / I over the samples and channels fitted to (Zheng 2008, Eq. 11).
    pub fit: f64,
    /// The same over noise-free samples under the unseen lights; infinite when a parameter is not finite.
    pub relight: f64,
    /// Of those, the samples with a half angle below 6 degrees.
    pub relight_highlight: Option<f64>,
    /// Errors of the parameters; none when the numbers of materials differ.
    pub parameters: Option<ParameterErrors>,
    /// True when the relight error is above its limit or a parameter is not finite.
    pub failed: bool,
}

impl Score {
    /// A fit that gave nothing usable.
    pub const FAILURE: Self =
        Self { fit: f64::INFINITY, relight: f64::INFINITY, relight_highlight: None, parameters: None, failed: true };
}

/// Errors of the parameters once the gauge is removed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterErrors {
    /// Mean over materials of |beta / true - 1|.
    pub beta: f64,
    /// Mean over materials and channels of |rho_s / true - 1|.
    pub rho_s: f64,
    /// Root mean square error of gamma over points and materials.
    pub gamma: f64,
}

/// Scores `mixture`, found for `problem` with the model `lobe`.
pub fn score(lobe: &dyn Lobe, problem: &Problem, mixture: &Mixture) -> Score {
    if !is_finite(mixture) || problem.truth.unseen.is_empty() {
        return Score::FAILURE;
    }
    let of = |point: usize, sample: &Sample| deviation(lobe, mixture, point, sample);
    let unseen = || problem.truth.unseen.iter().map(|u| (of(u.point, &u.sample), u.sample.angles.half_angle()));
    let relight = mean(unseen().map(|(error, _)| error)).filter(|error| error.is_finite());
    let Some(relight) = relight else { return Score::FAILURE };
    let mut fit = Vec::new();
    for point in 0..problem.observations.points() {
        for sample in problem.observations.of(point) {
            fit.push(of(point, &sample));
        }
    }
    Score {
        fit: mean(fit.into_iter()).unwrap_or(f64::INFINITY),
        relight,
        relight_highlight: mean(unseen().filter(|(_, half)| *half < HIGHLIGHT_HALF_ANGLE).map(|(error, _)| error)),
        parameters: parameter_errors(&problem.truth, mixture),
        failed: relight > FAILURE_FACTOR * BEST_RELIGHT,
    }
}

fn is_finite(mixture: &Mixture) -> bool {
    let material = |m: &Material| m.rho_d.iter().chain(&m.rho_s).all(|v| v.is_finite()) && m.beta.is_finite();
    mixture.materials.iter().all(material) && mixture.gamma.iter().all(|g| g.is_finite())
}

/// Mean over channels of |I - model| / I.
fn deviation(lobe: &dyn Lobe, mixture: &Mixture, point: usize, sample: &Sample) -> f64 {
    let model = predict(lobe, &mixture.materials, mixture.weights_of(point), sample);
    (0..3).map(|c| (sample.radiance[c] - model[c]).abs() / sample.radiance[c]).sum::<f64>() / 3.0
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

/// Pairs found with true materials so that the weights agree best, each found one scaled to fit the true weights.
fn parameter_errors(truth: &Truth, mixture: &Mixture) -> Option<ParameterErrors> {
    let count = truth.materials.len();
    if mixture.materials.len() != count {
        return None;
    }
    let orders = orders(count);
    let errors = orders.iter().map(|order| errors_in_order(truth, mixture, order));
    errors.min_by(|a, b| a.gamma.total_cmp(&b.gamma))
}

fn errors_in_order(truth: &Truth, mixture: &Mixture, order: &[usize]) -> ParameterErrors {
    let count = order.len();
    let (mut beta, mut rho_s, mut squares) = (0.0, 0.0, 0.0);
    for (m, &found) in order.iter().enumerate() {
        let pairs = || {
            let points = mixture.gamma.chunks_exact(count).zip(truth.gamma.chunks_exact(count));
            points.map(|(a, b)| (a[found], b[m]))
        };
        let square: f64 = pairs().map(|(a, _)| a * a).sum();
        let gauge = pairs().map(|(a, b)| a * b).sum::<f64>() / square.max(f64::MIN_POSITIVE);
        squares += pairs().map(|(a, b)| (gauge * a - b).powi(2)).sum::<f64>();
        let (material, known) = (&mixture.materials[found], &truth.materials[m]);
        beta += (material.beta / known.beta - 1.0).abs();
        for c in 0..3 {
            rho_s += (material.rho_s[c] / gauge / known.rho_s[c] - 1.0).abs() / 3.0;
        }
    }
    let count = count as f64;
    ParameterErrors { beta: beta / count, rho_s: rho_s / count, gamma: (squares / truth.gamma.len() as f64).sqrt() }
}

/// Every order of `count` things.
fn orders(count: usize) -> Vec<Vec<usize>> {
    let mut all = vec![Vec::new()];
    for _ in 0..count {
        let longer = |order: &Vec<usize>| {
            let order = order.clone();
            (0..count).filter(move |m| !order.contains(m)).collect::<Vec<_>>()
        };
        all = all.iter().flat_map(|o| longer(o).into_iter().map(move |m| [&o[..], &[m]].concat())).collect();
    }
    all
}
