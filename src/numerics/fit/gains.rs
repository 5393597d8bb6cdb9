//! Light gains: how much brighter each light was than its stated intensity says (lamp drift).

use super::observations::Observations;
use super::{Mixture, predict};
use crate::numerics::brdf::Lobe;

/// Per light, the median of measured over predicted radiance, over all samples and channels; their geometric mean is 1,
/// because a common factor is part of the weights. 1 for a light without samples.
pub fn light_gains(lobe: &dyn Lobe, mixture: &Mixture, observations: &Observations) -> Vec<f64> {
    let mut ratios: Vec<Vec<f64>> = vec![Vec::new(); observations.lights];
    for point in 0..observations.points() {
        for sample in observations.of(point) {
            let model = predict(lobe, &mixture.materials, mixture.weights_of(point), &sample);
            let ratio = (0..3).map(|c| sample.radiance[c] / model[c]).filter(|r| r.is_finite() && *r > 0.0);
            ratios[sample.light].extend(ratio);
        }
    }
    let logs: Vec<Option<f64>> = ratios.iter_mut().map(|list| median(list).map(f64::ln)).collect();
    let known: Vec<f64> = logs.iter().copied().flatten().collect();
    let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
    logs.iter().map(|log| log.map_or(1.0, |log| (log - mean).exp())).collect()
}

fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::brdf::ward::Ward;
    use crate::numerics::fit::observations::{Sample, tests::synthetic};

    #[test]
    fn known_drift_is_found_under_the_true_mixture() {
        let (clean, truth) = synthetic(200, 2, 51);
        let drift = [1.04, 0.97, 1.0, 1.02, 0.95, 1.01, 1.0];
        let drifted = |s: Sample| Sample { radiance: s.radiance.map(|i| i * drift[s.light]), ..s };
        let (observations, _) = clean.changed(1, |_, sample| Some(drifted(sample)));
        let mean = drift.iter().map(|d: &f64| d.ln()).sum::<f64>() / 7.0;
        for (found, known) in light_gains(&Ward, &truth, &observations).iter().zip(drift) {
            assert!((found / (known.ln() - mean).exp() - 1.0).abs() < 1e-6, "{found} for {known}");
        }
    }
}
