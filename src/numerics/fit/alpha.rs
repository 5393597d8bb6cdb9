//! BRDF parameters of all materials for fixed weights (the second half-step of paper 3.6).

use super::levmar::{self, Bounds, Normal, Outcome, Problem, Stop};
use super::objective::Objective;
use super::observations::{Observations, Sample};
use super::{BETA_RANGE, CHUNK, MAX_MATERIALS, Mixture};
use crate::numerics::brdf::{Lobe, Material};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::f64::consts::FRAC_1_PI;

/// Where each parameter of a material stands in the vector of unknowns: rho_d, then, for a model with a lobe, rho_s and
/// ln(beta), material after material.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// Materials.
    pub materials: usize,
    /// Unknowns per material: 3 without a lobe, 7 with one.
    pub per_material: usize,
}

/// Parameters of a material that change one channel: rho_d, rho_s of that channel, and ln(beta).
pub(crate) const PER_CHANNEL: usize = 3;

impl Layout {
    /// Layout of `materials` materials of a model.
    pub fn new(lobe: &dyn Lobe, materials: usize) -> Self {
        Self { materials, per_material: if lobe.has_lobe() { 7 } else { 3 } }
    }

    /// Unknowns in all.
    pub fn unknowns(&self) -> usize {
        self.materials * self.per_material
    }

    /// Per channel, the unknowns that change it, three a material; those the model lacks are left out.
    pub(crate) fn of_channel(&self, material: usize, channel: usize) -> [Option<usize>; PER_CHANNEL] {
        let base = material * self.per_material;
        let lobe = self.per_material == 7;
        [Some(base + channel), lobe.then_some(base + 3 + channel), lobe.then_some(base + 6)]
    }

    /// Materials to unknowns.
    pub fn pack(&self, materials: &[Material]) -> DVector<f64> {
        let mut x = DVector::zeros(self.unknowns());
        for (m, material) in materials.iter().enumerate() {
            let base = m * self.per_material;
            x.rows_mut(base, 3).copy_from_slice(&material.rho_d);
            if self.per_material == 7 {
                x.rows_mut(base + 3, 3).copy_from_slice(&material.rho_s);
                x[base + 6] = material.beta.ln();
            }
        }
        x
    }

    /// Unknowns to materials.
    pub fn unpack(&self, x: &DVector<f64>) -> Vec<Material> {
        (0..self.materials)
            .map(|m| {
                let at = |i: usize| x[m * self.per_material + i];
                if self.per_material == 7 {
                    Material { rho_d: [at(0), at(1), at(2)], rho_s: [at(3), at(4), at(5)], beta: at(6).exp() }
                } else {
                    Material { rho_d: [at(0), at(1), at(2)], rho_s: [0.0; 3], beta: 1.0 }
                }
            })
            .collect()
    }

    /// Non-negative albedos, beta in [`BETA_RANGE`], steps of ln(beta) of at most 0.7; specular albedos have a cap
    /// ([`specular_cap`]), without which a needle lobe can swallow the fit.
    pub(crate) fn bounds(&self, start: &[Material]) -> Bounds {
        let n = self.unknowns();
        let mut bounds = Bounds {
            lower: DVector::zeros(n),
            upper: DVector::from_element(n, f64::INFINITY),
            step: DVector::from_element(n, f64::INFINITY),
        };
        if self.per_material == 7 {
            for (m, material) in start.iter().enumerate() {
                let base = m * 7;
                let cap = specular_cap(material);
                bounds.upper.rows_mut(base + 3, 3).fill(cap);
                bounds.lower[base + 6] = BETA_RANGE[0].ln();
                bounds.upper[base + 6] = BETA_RANGE[1].ln();
                bounds.step[base + 6] = 0.7;
            }
        }
        bounds
    }
}

/// Greatest rho_s of a material: rho_s <= 1 where the gauge makes rho_d a true albedo (largest channel 1 at most), and in
/// the same proportion to rho_d in any other gauge; never below 1.
pub(crate) fn specular_cap(material: &Material) -> f64 {
    material.rho_d.iter().copied().fold(1.0, f64::max)
}

/// The value of a material at a sample with what its derivatives need.
#[derive(Clone, Copy, Default)]
pub(crate) struct Basis {
    pub(crate) lobe: f64,
    pub(crate) slope: f64,
}

/// Derivatives of the radiance of `channel` by the unknowns of `material` that change it, per unit weight.
pub(crate) fn derivatives(material: &Material, basis: &Basis, irradiance: f64, channel: usize) -> [f64; PER_CHANNEL] {
    [irradiance * FRAC_1_PI, irradiance * basis.lobe, irradiance * material.rho_s[channel] * basis.slope]
}

/// Fixed weights, free BRDF parameters.
struct AlphaProblem<'a> {
    lobe: &'a dyn Lobe,
    layout: Layout,
    objective: Objective,
    observations: &'a Observations,
    gamma: &'a [f64],
}

/// Sums of one chunk: upper triangle per channel, so that nothing is spent on the zeros between channels.
struct Partial {
    cost: f64,
    gradient: [[f64; PER_CHANNEL * MAX_MATERIALS]; 3],
    hessian: Vec<[[f64; PER_CHANNEL * MAX_MATERIALS]; PER_CHANNEL * MAX_MATERIALS]>,
}

impl AlphaProblem<'_> {
    fn chunks<T: Send>(&self, work: impl Fn(std::ops::Range<usize>) -> T + Sync + Send) -> Vec<T> {
        let points = self.observations.points();
        (0..points.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| work(chunk * CHUNK..((chunk + 1) * CHUNK).min(points)))
            .collect()
    }

    fn weights_of(&self, point: usize) -> &[f64] {
        &self.gamma[point * self.layout.materials..(point + 1) * self.layout.materials]
    }

    fn bases(&self, materials: &[Material], sample: &Sample) -> [Basis; MAX_MATERIALS] {
        let mut bases = [Basis::default(); MAX_MATERIALS];
        for (basis, material) in bases.iter_mut().zip(materials) {
            (basis.lobe, basis.slope) = self.lobe.value_and_slope(&sample.angles, material.beta);
        }
        bases
    }

    fn accumulate(&self, materials: &[Material], points: std::ops::Range<usize>) -> Partial {
        const WIDE: usize = PER_CHANNEL * MAX_MATERIALS;
        let mut partial = Partial { cost: 0.0, gradient: [[0.0; WIDE]; 3], hessian: vec![[[0.0; WIDE]; WIDE]; 3] };
        let wide = PER_CHANNEL * materials.len();
        for point in points {
            let gamma = self.weights_of(point);
            for sample in self.observations.of(point) {
                let bases = self.bases(materials, &sample);
                let w = self.objective.weights(&sample);
                for c in 0..3 {
                    let mut row = [0.0; WIDE];
                    let mut model = 0.0;
                    for (m, material) in materials.iter().enumerate() {
                        let d = derivatives(material, &bases[m], sample.irradiance[c], c);
                        model += gamma[m] * (d[0] * material.rho_d[c] + d[1] * material.rho_s[c]);
                        for k in 0..PER_CHANNEL {
                            row[m * PER_CHANNEL + k] = gamma[m] * d[k];
                        }
                    }
                    let residual = model - sample.radiance[c];
                    partial.cost += w[c] * residual * residual;
                    for i in 0..wide {
                        let weighted = w[c] * row[i];
                        partial.gradient[c][i] += weighted * residual;
                        for j in 0..=i {
                            partial.hessian[c][i][j] += weighted * row[j];
                        }
                    }
                }
            }
        }
        partial
    }

    fn scatter(&self, partial: &Partial, normal: &mut Normal) {
        normal.cost += partial.cost;
        let wide = PER_CHANNEL * self.layout.materials;
        for c in 0..3 {
            let index: Vec<Option<usize>> =
                (0..self.layout.materials).flat_map(|m| self.layout.of_channel(m, c)).collect();
            for i in 0..wide {
                let Some(p) = index[i] else { continue };
                normal.gradient[p] += partial.gradient[c][i];
                for j in 0..=i {
                    let Some(q) = index[j] else { continue };
                    normal.hessian[(p, q)] += partial.hessian[c][i][j];
                    if p != q {
                        normal.hessian[(q, p)] += partial.hessian[c][i][j];
                    }
                }
            }
        }
    }
}

impl Problem for AlphaProblem<'_> {
    fn normal(&self, x: &DVector<f64>) -> Normal {
        let materials = self.layout.unpack(x);
        let n = self.layout.unknowns();
        let mut normal = Normal { cost: 0.0, gradient: DVector::zeros(n), hessian: DMatrix::zeros(n, n) };
        for partial in self.chunks(|points| self.accumulate(&materials, points)) {
            self.scatter(&partial, &mut normal);
        }
        normal
    }
}

/// Cost of a whole mixture.
pub fn cost(lobe: &dyn Lobe, mixture: &Mixture, objective: Objective, observations: &Observations) -> f64 {
    let layout = Layout::new(lobe, mixture.materials.len());
    let problem = AlphaProblem { lobe, layout, objective, observations, gamma: &mixture.gamma };
    problem.normal(&layout.pack(&mixture.materials)).cost
}

/// Minimises the objective over the BRDF parameters of all materials, weights fixed; replaces `mixture.materials`.
pub fn solve_alpha(
    lobe: &dyn Lobe,
    mixture: &mut Mixture,
    objective: Objective,
    observations: &Observations,
    stop: Stop,
) -> Outcome {
    let layout = Layout::new(lobe, mixture.materials.len());
    let problem = AlphaProblem { lobe, layout, objective, observations, gamma: &mixture.gamma };
    let outcome =
        levmar::minimise(&problem, &layout.pack(&mixture.materials), &layout.bounds(&mixture.materials), stop);
    mixture.materials = layout.unpack(&outcome.x);
    outcome
}

/// Minimises the objective over rho_s and beta of a single material whose rho_d and weights are fixed (paper Eq. 9).
pub fn solve_specular(
    lobe: &dyn Lobe,
    start: Material,
    gamma: &[f64],
    objective: Objective,
    observations: &Observations,
    stop: Stop,
) -> Material {
    let layout = Layout::new(lobe, 1);
    let problem = AlphaProblem { lobe, layout, objective, observations, gamma };
    let mut bounds = layout.bounds(&[start]);
    for c in 0..3 {
        bounds.lower[c] = start.rho_d[c];
        bounds.upper[c] = start.rho_d[c];
    }
    let outcome = levmar::minimise(&problem, &layout.pack(&[start]), &bounds, stop);
    layout.unpack(&outcome.x)[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::brdf::ward::Ward;
    use crate::numerics::fit::observations::tests::synthetic;

    /// Every analytic derivative against central differences of the cost.
    #[test]
    fn gradient_matches_numeric_differences() {
        let (observations, mixture) = synthetic(40, 2, 3);
        let layout = Layout::new(&Ward, 2);
        for objective in [Objective::ABSOLUTE, Objective::RELATIVE, Objective::NOISE] {
            let problem =
                AlphaProblem { lobe: &Ward, layout, objective, observations: &observations, gamma: &mixture.gamma };
            let x = layout.pack(&mixture.materials) * 1.07;
            let normal = problem.normal(&x);
            for i in 0..x.len() {
                let h = 1e-5 * x[i].abs();
                let (mut up, mut down) = (x.clone(), x.clone());
                up[i] += h;
                down[i] -= h;
                let numeric = (problem.normal(&up).cost - problem.normal(&down).cost) / (4.0 * h);
                let scale = (normal.hessian[(i, i)] * normal.cost).sqrt();
                assert!((numeric - normal.gradient[i]).abs() < 1e-6 * scale, "{objective:?} unknown {i}");
            }
        }
    }
}
