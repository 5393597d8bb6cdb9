//! One fit against its truth: cost above the optimum, errors over standard errors and over the Cramer-Rao bound.

use crate::numerics::brdf::{Material, ward::Ward};
use crate::numerics::fit::kernel::{self, PER_MATERIAL, Sign};
use crate::numerics::fit::levmar::Stop;
use crate::numerics::fit::objective::{Objective, noise_weights};
use crate::numerics::fit::observations::Observations;
use crate::numerics::fit::prepared::{Prepared, Recipe};
use crate::numerics::fit::unit_radiance;
use crate::numerics::fit::unknowns::{Colour, Unknowns};
use crate::numerics::fit::varpro::{multi_start, search};
use crate::pipeline::fit::FitOptions;
use crate::pipeline::judged::fit_observations;
use crate::pipeline::report::{Identified, MaterialReport, Parameter};
use crate::study::forward::TrueMaterial;
use crate::study::scene::Scene;
use crate::study::score::score;
use nalgebra::{DMatrix, DVector};
use std::ops::ControlFlow;

const FINE: Stop = Stop { relative_decrease: 1e-10, iterations: 200 };

/// What one seed showed.
pub struct Measured {
    /// Cost from the solver's start over that from the truth, less 1; weights free and solved in f64.
    pub excess: f64,
    /// Mean |beta error|, relative.
    pub beta: f64,
    /// Relight error, relative.
    pub relight: f64,
    /// Per parameter, error over standard error where it is called identified.
    pub pulls: Vec<Option<f64>>,
    /// Per parameter, error over the Cramer-Rao bound.
    pub scatter: Vec<Option<f64>>,
}

/// Options of a fit of so many Ward materials.
pub fn asked(materials: usize) -> FitOptions {
    FitOptions {
        materials: Some(materials),
        model: "ward".to_owned(),
        lobe: "coloured".to_owned(),
        gains: "off".to_owned(),
        ..FitOptions::default()
    }
}

/// Fits one seed of a scene.
pub fn measure(scene: &Scene, seed: u64) -> Option<Measured> {
    let problem = scene.generate(seed);
    let known: Vec<Material> = problem.truth.materials.iter().map(material).collect();
    let count = known.len();
    let fitted = fit_observations(&problem.observations, &asked(count), &mut |_| ControlFlow::Continue(())).ok()?;
    let scored = score(&Ward, &problem, &fitted.solution.mixture);
    let order = order(&fitted.solution.mixture.materials, &known);
    let bounds = bounds(scene, seed, &known);
    let (mut pulls, mut scatter) = (Vec::new(), Vec::new());
    for m in 0..count {
        let report = &fitted.materials[order[m]];
        let gauge = pinned(&known[m]);
        let factor = known[m].rho_d[gauge] / report.rho_d[gauge].value;
        for k in 0..PER_MATERIAL {
            let Some(parameter) = parameter(report, k).filter(|_| k != gauge) else {
                pulls.push(None);
                scatter.push(None);
                continue;
            };
            let (error, sigma) = error(parameter, &known[m], k, factor);
            pulls.push(sigma.filter(|_| parameter.identified == Identified::Identified).map(|sigma| error / sigma));
            scatter.push(bounds[m * PER_MATERIAL + k].map(|bound| error / bound));
        }
    }
    let excess = excess(&problem.observations, &known);
    Some(Measured { excess, beta: scored.parameters?.beta, relight: scored.relight, pulls, scatter })
}

/// What a place among the pulls stands for.
pub fn name(index: usize) -> String {
    const NAMES: [&str; PER_MATERIAL] =
        ["rho_d red", "rho_d green", "rho_d blue", "rho_s red", "rho_s green", "rho_s blue", "ln beta"];
    format!("{} {}", NAMES[index % PER_MATERIAL], index / PER_MATERIAL + 1)
}

fn material(known: &TrueMaterial) -> Material {
    Material { rho_d: known.rho_d, rho_s: known.rho_s, beta: known.beta }
}

fn pinned(material: &Material) -> usize {
    (0..3).fold(0, |best, c| if material.rho_d[c] > material.rho_d[best] { c } else { best })
}

fn parameter(report: &MaterialReport, k: usize) -> Option<&Parameter> {
    match k {
        0..3 => report.rho_d.get(k),
        3..6 => report.rho_s.get(k - 3),
        _ => report.beta.as_ref(),
    }
}

/// Error and standard error in the gauge of the truth; those of beta are of its logarithm.
fn error(found: &Parameter, known: &Material, k: usize, factor: f64) -> (f64, Option<f64>) {
    let albedo = |truth: f64| (found.value * factor - truth, found.standard_error.map(|sigma| sigma * factor));
    match k {
        0..3 => albedo(known.rho_d[k]),
        3..6 => albedo(known.rho_s[k - 3]),
        _ => ((found.value / known.beta).ln(), found.standard_error.map(|sigma| sigma / found.value)),
    }
}

/// For each true material, the free found one whose colour is nearest.
fn order(found: &[Material], known: &[Material]) -> Vec<usize> {
    let hue = |m: &Material| {
        let sum: f64 = m.rho_d.iter().sum();
        m.rho_d.map(|albedo| albedo / sum)
    };
    let distance = |a: &Material, b: &Material| {
        let (a, b) = (hue(a), hue(b));
        (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>()
    };
    let mut free: Vec<usize> = (0..found.len()).collect();
    let nearest = |truth: &Material| {
        let at = (0..free.len())
            .min_by(|&a, &b| distance(&found[free[a]], truth).total_cmp(&distance(&found[free[b]], truth)));
        at.map_or(0, |at| free.swap_remove(at))
    };
    known.iter().map(nearest).collect()
}

/// Cramer-Rao bounds at the truth: without noise the samples are weighted by the 2 % of the scene's noise.
fn bounds(scene: &Scene, seed: u64, known: &[Material]) -> Vec<Option<f64>> {
    let clean = Scene { noise: 0.0, floor: 0.0, ..scene.clone() }.generate(seed).observations;
    let recipe = Recipe { lobe: &Ward, objective: Objective::NOISE, brightness: 1.0 };
    let unknowns = Unknowns::new(known, Colour::Coloured);
    let normal = unknowns.reduce(&kernel::normal(&Prepared::new(&clean, &recipe), known, Sign::Free));
    let inverse = normal.hessian.try_inverse();
    let bound = |i: usize| {
        let place = unknowns.place(i / PER_MATERIAL, i % PER_MATERIAL)?;
        inverse.as_ref().map(|inverse| inverse[(place, place)].sqrt())
    };
    (0..PER_MATERIAL * known.len()).map(bound).collect()
}

/// True when the Cramer-Rao bound of every parameter is below the part `share` of it.
pub fn determined(scene: &Scene, seed: u64, share: f64) -> bool {
    let known: Vec<Material> = scene.materials.iter().map(material).collect();
    let value = |i: usize| {
        let (m, k) = (&known[i / PER_MATERIAL], i % PER_MATERIAL);
        match k {
            0..3 => m.rho_d[k],
            3..6 => m.rho_s[k - 3],
            _ => 1.0,
        }
    };
    let bounds = bounds(scene, seed, &known);
    bounds.iter().enumerate().all(|(i, bound)| bound.is_none_or(|bound| bound < share * value(i)))
}

/// Cost found from the solver's start over that found from the truth, less 1.
fn excess(observations: &Observations, known: &[Material]) -> f64 {
    let recipe = Recipe { lobe: &Ward, objective: Objective::NOISE, brightness: 1.0 };
    let prepared = Prepared::new(observations, &recipe);
    let start = multi_start(&observations.subset(384), &recipe, known.len(), Colour::Coloured);
    let from = |start: &[Material]| {
        cost(observations, &search(&prepared, start, Colour::Coloured, Sign::Free, FINE).materials)
    };
    from(&start.materials) / from(known) - 1.0
}

/// Noise-weighted cost with the free weights of every point solved in f64.
fn cost(observations: &Observations, materials: &[Material]) -> f64 {
    let of_point = |point: usize| {
        let (mut rows, mut radiance) = (Vec::new(), Vec::new());
        for sample in observations.of(point) {
            let weights = noise_weights(&sample).map(f64::sqrt);
            let units: Vec<[f64; 3]> = materials.iter().map(|m| unit_radiance(&Ward, m, &sample)).collect();
            for c in 0..3 {
                rows.extend(units.iter().map(|unit| unit[c] * weights[c]));
                radiance.push(sample.radiance[c] * weights[c]);
            }
        }
        let matrix = DMatrix::from_row_slice(radiance.len(), materials.len(), &rows);
        let wanted = DVector::from_vec(radiance);
        let q = matrix.qr().q();
        wanted.norm_squared() - (q.transpose() * &wanted).norm_squared()
    };
    (0..observations.points()).map(of_point).sum()
}
