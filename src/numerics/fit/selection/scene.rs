//! A candidate tried on the points that decide: fitted, judged by left-out lights and by Bayes' information criterion.

use super::Candidate;
use crate::numerics::brdf::Lobe;
use crate::numerics::fit::Mixture;
use crate::numerics::fit::folds::{Folds, predicted};
use crate::numerics::fit::gains::light_gains;
use crate::numerics::fit::kernel::{self, Sign};
use crate::numerics::fit::levmar::Stop;
use crate::numerics::fit::objective::Objective;
use crate::numerics::fit::observations::Observations;
use crate::numerics::fit::prepared::{Prepared, Recipe, brightness};
use crate::numerics::fit::sampling::stratified;
use crate::numerics::fit::unknowns::Colour;
use crate::numerics::fit::varpro::{multi_start, search};

/// Points that decide: BRDF parameters are settled by far fewer than an image has.
const POINTS: usize = 800;

/// Points of the search for a start.
const START_POINTS: usize = 384;

/// Classes of colour that the deciding points are spread over.
const CLASSES: usize = 3;

/// When the search under all lights stops, and those without a group of them, which start from it.
const STOP: Stop = Stop { relative_decrease: 1e-4, iterations: 40 };
const FOLD_STOP: Stop = Stop { relative_decrease: 1e-4, iterations: 3 };

/// The points that decide.
pub(super) struct Scene {
    pub(super) points: Observations,
    folds: Folds,
    brightness: f64,
    objective: Objective,
}

impl Scene {
    pub(super) fn new(observations: &Observations, objective: Objective) -> Self {
        let points = observations.select(&stratified(observations, CLASSES, POINTS));
        Self { folds: Folds::new(&points), brightness: brightness(&points), points, objective }
    }

    pub(super) fn evaluate(&self, materials: usize, lobe: &'static dyn Lobe, colour: Colour) -> Candidate {
        self.judge(&self.points, &self.folds, materials, lobe, colour, None)
    }

    /// The best candidate once more, on irradiances times the gains found with it.
    pub(super) fn evaluate_with_gains(&self, best: &Candidate) -> Candidate {
        let recipe = self.recipe(best.lobe);
        let mut gains = vec![1.0; self.points.lights];
        for _ in 0..2 {
            let points = self.points.with_gains(&gains);
            let (mixture, _) = self.fit(&points, &recipe, best.materials, best.colour);
            let more = light_gains(best.lobe, &mixture, &points);
            gains.iter_mut().zip(more).for_each(|(gain, more)| *gain *= more);
        }
        let folds = self.folds.with_gains(&gains);
        self.judge(&self.points.with_gains(&gains), &folds, best.materials, best.lobe, best.colour, Some(gains))
    }

    fn judge(
        &self,
        points: &Observations,
        folds: &Folds,
        materials: usize,
        lobe: &'static dyn Lobe,
        colour: Colour,
        gains: Option<Vec<f64>>,
    ) -> Candidate {
        let recipe = self.recipe(lobe);
        let (mixture, cost) = self.fit(points, &recipe, materials, colour);
        let refit = |rest: &Prepared| search(rest, &mixture.materials, colour, Sign::NonNegative, FOLD_STOP).materials;
        let left_out = predicted(folds, &recipe, refit);
        let (channels, residuals) = (points.channels(), points.residuals() as f64);
        let in_use = mixture.gamma.iter().filter(|&&gamma| gamma > 0.0).count();
        let of_materials = materials * (colour.unknowns(channels) - 1);
        let unknowns = in_use + of_materials + gains.as_ref().map_or(0, |g| g.len() - 1);
        let mean_cost = (cost / (3 * points.samples()) as f64).max(f64::MIN_POSITIVE);
        let bic = residuals * mean_cost.ln() + unknowns as f64 * residuals.ln();
        Candidate { materials, lobe, colour, gains, left_out, bic, taken: false, reason: String::new() }
    }

    fn recipe(&self, lobe: &'static dyn Lobe) -> Recipe<'static> {
        Recipe { lobe, objective: self.objective, brightness: self.brightness }
    }

    fn fit(&self, points: &Observations, recipe: &Recipe<'_>, materials: usize, colour: Colour) -> (Mixture, f64) {
        let start = multi_start(&points.subset(START_POINTS), recipe, materials, colour);
        let prepared = Prepared::new(points, recipe);
        let found = search(&prepared, &start.materials, colour, Sign::NonNegative, STOP);
        let (gamma, cost) = kernel::weights(&prepared, &found.materials, Sign::NonNegative);
        (Mixture { materials: found.materials, gamma }, cost)
    }
}
