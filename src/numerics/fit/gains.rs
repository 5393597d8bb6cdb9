//! Light gains: how much brighter each light was than its stated intensity says (lamp drift).

use super::observations::Observations;
use super::{Mixture, predict};
use crate::numerics::brdf::Lobe;

/// A light whose gain departs from the median by more than this (relative, and in scaled median deviations) was stated wrongly: it
/// has no say in what the others' gains mean.
const MISSTATED: (f64, f64) = (0.02, 6.0);

/// Per light, the median of measured over predicted radiance, over all samples and channels. The geometric mean of those that
/// drift alone explains is 1, because a common factor is part of the weights. 1 for a light without samples.
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
    let mean = centre(logs.iter().copied().flatten().collect());
    logs.iter().map(|log| log.map_or(1.0, |log| (log - mean).exp())).collect()
}

/// Mean of the values that lie near their median.
fn centre(mut values: Vec<f64>) -> f64 {
    let Some(middle) = median(&mut values) else { return 0.0 };
    let mut departures: Vec<f64> = values.iter().map(|value| (value - middle).abs()).collect();
    let spread = 1.4826 * median(&mut departures).unwrap_or(0.0);
    let near = |value: &&f64| (*value - middle).abs() <= MISSTATED.0.max(MISSTATED.1 * spread);
    let (sum, count) = values.iter().filter(near).fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    sum / f64::from(count.max(1))
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

    /// One intensity that was stated wrong does not become everybody's.
    #[test]
    fn a_misstated_light_leaves_the_others_alone() {
        let (clean, truth) = synthetic(200, 1, 52);
        let brighter = |s: &Sample| if s.light == 2 { s.radiance.map(|i| 1.3 * i) } else { s.radiance };
        let (observations, _) = clean.changed(1, |_, s| Some(Sample { radiance: brighter(&s), ..s }));
        for (light, gain) in light_gains(&Ward, &truth, &observations).iter().enumerate() {
            let known = if light == 2 { 1.3 } else { 1.0 };
            assert!((gain / known - 1.0).abs() < 1e-6, "{gain} for {known}");
        }
    }
}
