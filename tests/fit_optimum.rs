//! The optimum of variable projection against that of the joint problem, all parameters and all weights at once, found by an
//! independent script in f64 (tests/oracle/varpro.py).
#![allow(clippy::unwrap_used, missing_docs)]

use nalgebra::{DMatrix, DVector};
use rigd::numerics::brdf::{self, Lobe, Material};
use rigd::numerics::fit::kernel::{self, Sign};
use rigd::numerics::fit::levmar::Stop;
use rigd::numerics::fit::objective::{Objective, noise_weights};
use rigd::numerics::fit::observations::{Observations, Sample};
use rigd::numerics::fit::prepared::{Prepared, Recipe, brightness};
use rigd::numerics::fit::unit_radiance;
use rigd::numerics::fit::unknowns::Colour;
use rigd::numerics::fit::varpro::{multi_start, search};
use rigd::numerics::geometry::Angles;
use serde::Deserialize;

/// By how much the cost of the parameters found here may exceed the optimum, relative. The product stops where the linear
/// model promises less than 1e-9; a Gauss-Newton step that gains so little leaves still less, and an order is left to f32.
const EXCESS: f64 = 1e-8;

/// How far a parameter or weight may lie from the optimum, in its own standard errors. Near the optimum the cost exceeds it
/// by s^2 d' C^-1 d for an offset d, a covariance s^2 C and s^2 = cost / freedom, and d' C^-1 d is at least the square of the
/// offset of any one parameter in standard errors. So an excess of 1e-8 lets none lie farther off than
/// sqrt(1e-8 * freedom), 0.004 with the 1 500 degrees of freedom here.
const OFFSET: f64 = 0.005;

/// How far the cost the f32 pass reports may lie from that of the same parameters in f64, relative. A residual is the
/// difference of two numbers near 50 (radiance over its 2 % error) known to some 1e-7 each: off by 5e-6. Twice its product
/// with the residual, summed over n samples with random signs, is 1e-5 sqrt(n) of a cost of n: 3e-7 with n = 1 300.
const REPORTED: f64 = 1e-6;

#[derive(Deserialize)]
struct Scene {
    model: String,
    points: Vec<Vec<Row>>,
    optima: Optima,
}

/// Light; cos theta_i, cos theta_r, tan^2 of the half angle, cosine between light and view; irradiance, radiance, variance.
type Row = (usize, [f64; 4], [f64; 3], [f64; 3], [f64; 3]);

#[derive(Deserialize)]
struct Optima {
    free: Optimum,
    non_negative: Optimum,
}

#[derive(Deserialize)]
struct Optimum {
    cost: f64,
    /// Per material: rho_d and rho_s over the largest rho_d, ln(beta).
    alpha: Vec<[f64; 7]>,
    /// Their standard errors; 0 for what fixes the gauge.
    alpha_error: Vec<[f64; 7]>,
    /// Per point and material, weight times the largest rho_d.
    products: Vec<Vec<f64>>,
    /// Their standard errors; 0 for a weight held at zero.
    products_error: Vec<Vec<f64>>,
}

fn observations(scene: &Scene) -> Observations {
    let mut all = Observations::new(7);
    for (index, rows) in scene.points.iter().enumerate() {
        let sample = |&(light, [cos_i, cos_r, tan2_half, cos_iv], irradiance, radiance, variance): &Row| {
            let angles = Angles { cos_i, cos_r, tan2_half, cos_iv };
            Sample { light, angles, irradiance, radiance, variance }
        };
        all.push(index, &rows.iter().map(sample).collect::<Vec<Sample>>());
    }
    all
}

/// Cost of a point under its best weights, in f64: those of least squares, or, of all least squares over some of the materials
/// without a negative weight, the cheapest.
fn best_cost(lobe: &dyn Lobe, materials: &[Material], samples: &[Sample], sign: Sign) -> f64 {
    let rows = 3 * samples.len();
    let root = |k: usize| noise_weights(&samples[k / 3])[k % 3].sqrt();
    let b = DVector::from_fn(rows, |k, _| samples[k / 3].radiance[k % 3] * root(k));
    let some = |support: &[usize]| {
        let unit = |k: usize, m: usize| unit_radiance(lobe, &materials[support[m]], &samples[k / 3])[k % 3];
        let a = DMatrix::from_fn(rows, support.len(), |k, m| unit(k, m) * root(k));
        let gamma = a.clone().svd(true, true).solve(&b, 0.0).unwrap();
        let allowed = sign == Sign::Free || gamma.iter().all(|&weight| weight >= 0.0);
        if allowed { (&b - a * gamma).norm_squared() } else { f64::INFINITY }
    };
    match sign {
        Sign::Free => some(&[0, 1]),
        Sign::NonNegative => [some(&[0, 1]), some(&[0]), some(&[1])].into_iter().fold(f64::INFINITY, f64::min),
    }
}

/// Offset in standard errors; what has none is fixed.
#[track_caller]
fn agree(found: f64, known: f64, error: f64, what: &str) -> f64 {
    let offset = (found - known).abs() / error.max(1e-9);
    assert!(offset < OFFSET, "{what}: {found} here, {known} there, {offset:.1e} standard errors apart");
    offset
}

fn compare(scene: &Scene, sign: Sign) {
    let known = match sign {
        Sign::Free => &scene.optima.free,
        Sign::NonNegative => &scene.optima.non_negative,
    };
    let (lobe, observations) = (brdf::by_name(&scene.model).unwrap(), observations(scene));
    let recipe = Recipe { lobe, objective: Objective::NOISE, brightness: brightness(&observations) };
    let prepared = Prepared::new(&observations, &recipe);
    let start = multi_start(&observations, &recipe, 2, Colour::Coloured);
    let stop = Stop { relative_decrease: 1e-8, iterations: 200 };
    let found = search(&prepared, &start.materials, Colour::Coloured, sign, stop);
    let what = format!("{} {sign:?}", scene.model);
    assert!(found.converged, "{what}");

    let samples = |point| observations.of(point).collect::<Vec<Sample>>();
    let cost: f64 = (0..observations.points()).map(|p| best_cost(lobe, &found.materials, &samples(p), sign)).sum();
    let excess = cost / known.cost - 1.0;
    // No parameters at all cost less than the optimum, but for rounding in f64.
    assert!((-1e-12..EXCESS).contains(&excess), "{what}: excess of the cost {excess:.1e}");
    let reported = found.cost / cost - 1.0;
    assert!(reported.abs() < REPORTED, "{what}: reported cost off by {reported:.1e}");

    let (gamma, _) = kernel::weights(&prepared, &found.materials, sign);
    let largest: Vec<f64> = found.materials.iter().map(|m| m.rho_d.iter().copied().fold(0.0, f64::max)).collect();
    // Classes may come in another order than the materials of the scene, which differ in roughness.
    let same = (found.materials[0].beta < found.materials[1].beta) == (known.alpha[0][6] < known.alpha[1][6]);
    let mut most = [0.0_f64; 2];
    for there in 0..2 {
        let here = if same { there } else { 1 - there };
        let material = &found.materials[here];
        let ratios = material.rho_d.iter().chain(&material.rho_s).map(|rho| rho / largest[here]);
        for (k, value) in ratios.chain([material.beta.ln()]).enumerate() {
            let what = format!("{what}: parameter {k} of material {there}");
            most[0] = most[0].max(agree(value, known.alpha[there][k], known.alpha_error[there][k], &what));
        }
        for point in 0..observations.points() {
            let product = gamma[2 * point + here] * largest[here];
            let what = format!("{what}: weight {there} of point {point}");
            let (value, error) = (known.products[point][there], known.products_error[point][there]);
            most[1] = most[1].max(agree(product, value, error, &what));
        }
    }
    println!(
        "{what}: {} steps, excess {excess:.1e}, reported {reported:.1e}, parameters within {:.1e}, weights within {:.1e}",
        found.iterations, most[0], most[1]
    );
}

fn scenes() -> Vec<Scene> {
    serde_json::from_str(include_str!("oracle/varpro.json")).unwrap()
}

#[test]
fn free_weights_reach_the_joint_optimum() {
    scenes().iter().for_each(|scene| compare(scene, Sign::Free));
}

#[test]
fn non_negative_weights_reach_the_joint_optimum() {
    scenes().iter().for_each(|scene| compare(scene, Sign::NonNegative));
}
