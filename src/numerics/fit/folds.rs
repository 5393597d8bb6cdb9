//! Left-out lights: every light is predicted by a fit that did not see it.

use super::kernel::{self, Groups, Sign};
use super::observations::{HIGHLIGHT_HALF_ANGLE, Observations, Row, Sample};
use super::predict;
use super::prepared::{Prepared, Recipe};
use super::twins::twins;
use crate::numerics::brdf::Material;

/// Most groups of lights left out in turn: with many lights, one group holds every so-manieth.
const GROUPS: usize = 7;

/// Lights in fewer places than this are not split.
const LIGHTS: usize = 4;

/// A point needs this many samples under the other lights to be predicted.
const LEAST: usize = 2;

/// Samples without one group of lights, and those of that group.
struct Fold {
    rest: Observations,
    /// Points of `rest` and what they send under the lights left out.
    left_out: Vec<(usize, Sample)>,
}

/// The observations split once for every group of lights.
pub struct Folds {
    folds: Vec<Fold>,
}

/// Errors of predictions under lights the fit never saw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// Mean of |I - model| / I over left-out samples and channels.
    pub overall: f64,
    /// The same over samples with a half angle below 6 degrees; none where there is no such sample.
    pub highlight: Option<f64>,
}

impl Folds {
    /// Splits `observations`; not at all where lights in use stand in fewer than four places, because what is left tells too little.
    pub fn new(observations: &Observations) -> Self {
        let (group_of, groups) = groups(observations);
        if groups < LIGHTS {
            return Self { folds: Vec::new() };
        }
        let fold = |group: usize| {
            let (rest, kept) = observations.filtered(LEAST, |light| group_of[light] != group);
            let of = |(index, &point): (usize, &usize)| {
                let left_out = observations.of(point).filter(|s| group_of[s.light] == group);
                left_out.map(|s| (index, s)).collect::<Vec<_>>()
            };
            let left_out = kept.iter().enumerate().flat_map(of).collect();
            Fold { rest, left_out }
        };
        let mut folds: Vec<Fold> = (0..groups).map(fold).collect();
        folds.retain(|fold| fold.rest.points() > 0 && !fold.left_out.is_empty());
        Self { folds }
    }

    /// The same with the irradiance of the lights a fit sees times their gains; a left-out light's gain is not known.
    pub fn with_gains(&self, gains: &[f64]) -> Self {
        let fold = |fold: &Fold| Fold { rest: fold.rest.with_gains(gains), left_out: fold.left_out.clone() };
        Self { folds: self.folds.iter().map(fold).collect() }
    }
}

/// Per light, the group it is left out with, and the number of groups: as many as places of lights in use, or [`GROUPS`].
/// Lights in one place are left out together, or the fit would see what it is tested on.
fn groups(observations: &Observations) -> (Vec<usize>, usize) {
    let twins = twins(observations);
    let first = |light: usize| twins.iter().find(|(_, again)| *again == light).map(|(first, _)| *first);
    let used = observations.lights_in_use();
    let places = used.iter().filter(|&&light| first(light).is_none()).count();
    let count = places.min(GROUPS);
    let mut group_of = vec![0; observations.lights];
    let mut rank = 0;
    for light in used {
        group_of[light] = match first(light) {
            Some(first) => group_of[first],
            None => {
                rank += 1;
                (rank - 1) % count
            }
        };
    }
    (group_of, count)
}

/// Errors of fixed materials on every light, with the weights that the other lights give each point. None where no light
/// can be left out. `prepared` is made of `observations`.
pub fn left_out_errors<const N: usize>(
    observations: &Observations,
    prepared: &Prepared,
    materials: [&[Material]; N],
) -> Option<[f64; N]> {
    let (group_of, count) = groups(observations);
    let of = |row: &Row| row.light.map(|light| group_of.get(usize::from(light)).map_or(0.0, |&group| group as f32));
    let groups = Groups { of: observations.rows().iter().map(of).collect(), count, least: LEAST };
    let mut errors = [0.0; N];
    for (error, materials) in errors.iter_mut().zip(materials) {
        *error = kernel::left_out(prepared, materials, &groups)?;
    }
    Some(errors)
}

/// Mean over channels of |I - model| / I.
fn relative_error(sample: &Sample, model: [f64; 3]) -> f64 {
    (0..3).map(|c| (sample.radiance[c] - model[c]).abs() / sample.radiance[c]).sum::<f64>() / 3.0
}

/// Error of the materials that `fit` finds without each group of lights, on that group. None where no light can be left
/// out.
pub fn predicted(
    folds: &Folds,
    recipe: &Recipe<'_>,
    mut fit: impl FnMut(&Prepared) -> Vec<Material>,
) -> Option<LeftOut> {
    let (mut sum, mut count, mut bright, mut brights) = (0.0, 0.0, 0.0, 0.0);
    for fold in &folds.folds {
        let prepared = Prepared::new(&fold.rest, recipe);
        let materials = fit(&prepared);
        let (gamma, _) = kernel::weights(&prepared, &materials, Sign::NonNegative);
        for (point, sample) in &fold.left_out {
            let weights = &gamma[point * materials.len()..(point + 1) * materials.len()];
            let model = predict(recipe.lobe, &materials, weights, sample);
            let error = relative_error(sample, model);
            sum += error;
            count += 1.0;
            if sample.angles.half_angle() < HIGHLIGHT_HALF_ANGLE {
                bright += error;
                brights += 1.0;
            }
        }
    }
    (count > 0.0).then(|| LeftOut { overall: sum / count, highlight: (brights > 0.0).then(|| bright / brights) })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::numerics::brdf::ward::Ward;
    use crate::numerics::fit::objective::Objective;
    use crate::numerics::fit::observations::tests::{noisy, synthetic};
    use crate::numerics::fit::weights::{WeightRule, solve_weights};

    /// Lights that were left out before count for nothing: of seven, three are too few, five make five groups.
    #[test]
    fn only_lights_in_use_are_left_out() {
        let (observations, _) = synthetic(120, 1, 81);
        let (three, _) = observations.filtered(1, |light| light < 3);
        assert!(Folds::new(&three).folds.is_empty());
        let (five, _) = observations.filtered(1, |light| light != 1 && light != 4);
        let folds = Folds::new(&five).folds;
        assert_eq!(folds.len(), 5);
        for fold in &folds {
            let light = fold.left_out[0].1.light;
            assert!(fold.left_out.iter().all(|(_, sample)| sample.light == light));
            assert!(fold.rest.all().all(|sample| sample.light != light));
        }
    }

    /// The vector pass against the f64 code: filtered observations, exact weights, one sample after the other.
    #[test]
    fn errors_of_fixed_materials_are_those_of_the_f64_code() {
        let (exact, truth) = synthetic(150, 2, 82);
        let observations = noisy(&exact, 0.05, 82);
        let recipe = Recipe { lobe: &Ward, objective: Objective::NOISE, brightness: 1.0 };
        let prepared = Prepared::new(&observations, &recipe);
        let [found] = left_out_errors(&observations, &prepared, [&truth.materials]).unwrap();
        let (mut sum, mut count) = (0.0, 0.0);
        for fold in &Folds::new(&observations).folds {
            let gamma = solve_weights(&Ward, &truth.materials, recipe.objective, WeightRule::Exact, &fold.rest);
            for (point, sample) in &fold.left_out {
                sum += relative_error(sample, predict(&Ward, &truth.materials, &gamma[2 * point..][..2], sample));
                count += 1.0;
            }
        }
        assert!((found * count / sum - 1.0).abs() < 1e-4, "{found} for {}", sum / count);
    }
}
