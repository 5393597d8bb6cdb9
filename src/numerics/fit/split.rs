//! Materials by splitting (after Lensch, Kautz, Goesele, Heidrich, Seidel, "Image-based reconstruction of spatial
//! appearance and geometric detail", ACM Transactions on Graphics 2003): one material is fitted to all points; the one
//! with the largest error is split in two along the direction in which its parameters vary most; points go to the material
//! that explains them best, materials are fitted to their points, and so on up to the number asked for.
//!
//! Kept: that loop, and in the end every point a non-negative mixture of all materials. Changed:
//! - A material explains a point up to a weight, as everywhere here: brightness alone makes no second material.
//! - The paper takes the covariance of the fit (the inverse of its normal matrix), which says what the data leave
//!   uncertain. Here it is the covariance of what the points ask of the parameters, measured by the normal matrix: along its
//!   largest axis the points disagree most, and moving both ways along it lowers the cost most. Points are parted by
//!   which of the two ways lowers their cost.
//! - The paper keeps the materials of the clusters. Where materials mix within a point no cluster is pure, so a last search
//!   fits all materials at once with the weights eliminated.

use super::alpha::{Basis, derivatives};
use super::kernel::{self, PER_MATERIAL, Sign};
use super::loss::Loss;
use super::observations::{Observations, Sample};
use super::prepared::{Prepared, Recipe};
use super::sampling::stratified;
use super::solver::{OnIteration, Refusal, Solution, Solver, Task};
use super::unknowns::{Colour, Unknowns};
use super::varpro::{COARSE, COARSE_STOP, Found, descend, finish, multi_start, recipe, search};
use crate::numerics::brdf::Material;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Most rounds of sorting points to materials and fitting these after a split.
const ROUNDS: usize = 10;

/// Added to the scaled normal matrix: parameters that no sample determines must not become the direction of a split.
const RIDGE: f64 = 1e-6;

/// Splits, sorts and fits.
pub struct Split;

impl Solver for Split {
    fn name(&self) -> &'static str {
        "split"
    }

    fn solve(&self, observations: &Observations, task: &Task, progress: OnIteration<'_>) -> Result<Solution, Refusal> {
        let recipe = recipe(task, observations);
        let some = observations.select(&stratified(observations, 1, COARSE.1));
        let start = Splitting::new(&some, &recipe, task.colour).grow(task.materials);
        let alpha = descend(observations, &some, start, task, &recipe, progress);
        Ok(finish(observations, &recipe, alpha))
    }
}

/// Points sorted to materials.
struct Splitting<'a> {
    observations: &'a Observations,
    recipe: &'a Recipe<'a>,
    loss: Loss<'a>,
    colour: Colour,
    materials: Vec<Material>,
    /// Per point, its material.
    class: Vec<usize>,
    iterations: usize,
}

impl<'a> Splitting<'a> {
    fn new(observations: &'a Observations, recipe: &'a Recipe<'a>, colour: Colour) -> Self {
        let one = multi_start(&observations.subset(COARSE.0), recipe, 1, colour);
        Self {
            observations,
            recipe,
            loss: Loss::new(recipe.lobe, recipe.objective, recipe.brightness),
            colour,
            iterations: one.iterations,
            materials: one.materials,
            class: vec![0; observations.points()],
        }
    }

    fn grow(mut self, count: usize) -> Found {
        self.fit(0);
        while self.materials.len() < count {
            self.split();
            self.settle();
        }
        let costs = self.costs();
        let cost = self.class.iter().zip(&costs).map(|(&class, of)| of[class]).sum();
        Found { materials: self.materials, cost, iterations: self.iterations, converged: true }
    }

    /// Points of a material.
    fn members(&self, material: usize) -> Vec<usize> {
        (0..self.class.len()).filter(|&point| self.class[point] == material).collect()
    }

    /// Fits a material to its points.
    fn fit(&mut self, material: usize) {
        let members = self.members(material);
        if members.is_empty() {
            return;
        }
        let prepared = Prepared::new(&self.observations.select(&members), self.recipe);
        let start = &self.materials[material..=material];
        let found = search(&prepared, start, self.colour, Sign::NonNegative, COARSE_STOP);
        self.iterations += found.iterations;
        self.materials[material] = found.materials[0];
    }

    /// Per point, the cost of explaining it by each material alone.
    fn costs(&self) -> Vec<Vec<f64>> {
        let cost = |point: usize, material: &Material| {
            let samples: Vec<Sample> = self.observations.of(point).collect();
            let one = std::slice::from_ref(material);
            self.loss.of(one, &self.loss.weights(one, &samples)[..1], samples)
        };
        let of_point = |point| self.materials.iter().map(|material| cost(point, material)).collect();
        (0..self.observations.points()).into_par_iter().map(of_point).collect()
    }

    /// Splits the material with the largest error.
    fn split(&mut self) {
        let mut error = vec![0.0; self.materials.len()];
        for (&class, costs) in self.class.iter().zip(self.costs()) {
            error[class] += costs[class];
        }
        let worst = (0..error.len()).fold(0, |best, m| if error[m] > error[best] { m } else { best });
        let new = self.materials.len();
        self.materials.push(self.materials[worst]);
        let members = self.members(worst);
        for (&point, other) in members.iter().zip(self.sides(&members, worst)) {
            if other {
                self.class[point] = new;
            }
        }
        self.fit(worst);
        self.fit(new);
    }

    /// Sorts points to the material that explains them best and fits the materials, until nothing changes.
    fn settle(&mut self) {
        for _ in 0..ROUNDS {
            let best = |costs: &Vec<f64>| (0..costs.len()).fold(0, |b, m| if costs[m] < costs[b] { m } else { b });
            let class: Vec<usize> = self.costs().iter().map(best).collect();
            if class == self.class {
                return;
            }
            self.class = class;
            (0..self.materials.len()).for_each(|material| self.fit(material));
        }
    }

    /// Of some points of a material, which go the one way along the direction of largest variance of its parameters.
    fn sides(&self, members: &[usize], material: usize) -> Vec<bool> {
        let material = self.materials[material];
        let unknowns = Unknowns::new(&[material], self.colour);
        let prepared = Prepared::new(&self.observations.select(members), self.recipe);
        let sums = kernel::normal(&prepared, &[material], Sign::NonNegative);
        let normal = unknowns.reduce(&sums).hessian;
        let pulls: Vec<DVector<f64>> = members.par_iter().map(|&p| self.pull(p, &material, &unknowns)).collect();
        let Some(direction) = most_disputed(&normal, &pulls) else { return vec![false; members.len()] };
        pulls.iter().map(|pull| pull.dot(&direction) > 0.0).collect()
    }

    /// Half the gradient of a point's cost by the unknowns; its weight is optimal and adds nothing.
    fn pull(&self, point: usize, material: &Material, unknowns: &Unknowns) -> DVector<f64> {
        let samples: Vec<Sample> = self.observations.of(point).collect();
        let gamma = self.loss.weights(&[*material], &samples)[0];
        let mut pull = DVector::zeros(unknowns.pack().len());
        for sample in &samples {
            let scaled = self.loss.scaled(&[*material], &[gamma], sample);
            let (lobe, slope) = self.recipe.lobe.value_and_slope(&sample.angles, material.beta);
            for c in 0..3 {
                let d = derivatives(material, &Basis { lobe, slope }, scaled.irradiance[c], c);
                let residual = gamma * (d[0] * material.rho_d[c] + d[1] * material.rho_s[c]) - scaled.radiance[c];
                for (k, d) in [c, 3 + c, PER_MATERIAL - 1].into_iter().zip(d) {
                    if let Some(place) = unknowns.place(0, k) {
                        pull[place] += gamma * d * residual;
                    }
                }
            }
        }
        pull
    }
}

/// The step of the parameters along which the pulls vary most, as the normal matrix measures steps. None where they do not.
fn most_disputed(normal: &DMatrix<f64>, pulls: &[DVector<f64>]) -> Option<DVector<f64>> {
    let n = normal.nrows();
    let scale = DVector::from_fn(n, |i, _| normal[(i, i)].sqrt().max(f64::MIN_POSITIVE));
    let scaled =
        DMatrix::from_fn(n, n, |i, j| normal[(i, j)] / (scale[i] * scale[j]) + if i == j { RIDGE } else { 0.0 });
    let lower = scaled.cholesky()?.l();
    let mut spread = DMatrix::zeros(n, n);
    for pull in pulls {
        let whitened = lower.solve_lower_triangular(&pull.component_div(&scale))?;
        spread += &whitened * whitened.transpose();
    }
    // The iteration for eigenvalues does not end on what is not a number.
    if spread.iter().any(|value: &f64| !value.is_finite()) {
        return None;
    }
    let axes = spread.symmetric_eigen();
    let largest = axes.eigenvalues.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?.0;
    let step = lower.tr_solve_lower_triangular(&axes.eigenvectors.column(largest).into_owned())?;
    Some(step.component_div(&scale))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::numerics::fit::gauge;
    use crate::numerics::fit::objective::Objective;
    use crate::numerics::fit::observations::tests::{noisy, synthetic};
    use crate::numerics::fit::quality::judge_all;
    use crate::numerics::fit::solver::tests::{go_on, task};

    /// Two of two and three of three materials, exact data and data with 2 % noise: roughness, and the error against the
    /// exact radiance.
    #[test]
    fn finds_as_many_materials_as_there_are() {
        for (count, noise, most_beta, most_error) in
            [(2, 0.0, 0.005, 1e-3), (2, 0.02, 0.03, 0.013), (3, 0.0, 0.02, 2e-3), (3, 0.02, 0.08, 0.016)]
        {
            let (exact, mut truth) = synthetic(1500, count, 31);
            gauge::normalise(&mut truth);
            let observations = if noise > 0.0 { noisy(&exact, noise, 31) } else { exact.clone() };
            let task = task(count, Objective::NOISE);
            let solution = Split.solve(&observations, &task, &mut go_on).unwrap();
            for (found, known) in solution.mixture.materials.iter().zip(&truth.materials) {
                let off = (found.beta / known.beta - 1.0).abs();
                assert!(off < most_beta, "{count} materials, noise {noise}: {found:?} instead of {known:?}");
            }
            let error = judge_all(task.lobe, &solution.mixture, &exact).unwrap().mean_relative_error;
            assert!(error < most_error, "{count} materials, noise {noise}: error {error}");
        }
    }

    /// Points of two materials of one diffuse colour that mix nowhere: hue cannot tell them apart, the lobes do.
    #[test]
    fn parts_materials_of_equal_colour_by_their_lobes() {
        let (exact, _) = synthetic(1500, 1, 32);
        let known = [0.08, 0.3].map(|beta| Material { rho_d: [0.3, 0.3, 0.3], rho_s: [0.2; 3], beta });
        let paint = |point: usize, mut sample: Sample| {
            let material = known[usize::from(point.is_multiple_of(3))];
            sample.radiance =
                crate::numerics::fit::unit_radiance(&crate::numerics::brdf::ward::Ward, &material, &sample);
            Some(sample)
        };
        let observations = exact.changed(1, paint).0;
        let task = task(2, Objective::NOISE);
        let recipe = recipe(&task, &observations);
        let splitting = Splitting::new(&observations, &recipe, Colour::Coloured);
        let found = splitting.grow(2);
        let mut betas: Vec<f64> = found.materials.iter().map(|m| m.beta).collect();
        betas.sort_by(f64::total_cmp);
        assert!((betas[0] / 0.08 - 1.0).abs() < 0.05 && (betas[1] / 0.3 - 1.0).abs() < 0.05, "{betas:?}");
    }
}
