//! The f32 pass against the f64 code of the alternation, which shares nothing with it but the BRDF models.
#![allow(clippy::unwrap_used)]

use super::*;
use crate::numerics::brdf::{self, Lobe};
use crate::numerics::fit::objective::Objective;
use crate::numerics::fit::observations::Observations;
use crate::numerics::fit::observations::tests::{noisy, synthetic};
use crate::numerics::fit::prepared::{Recipe, brightness};
use crate::numerics::fit::weights::{WeightRule, solve_weights};
use crate::numerics::fit::{Mixture, alpha};

/// Off the truth, so that residuals and gradient are not zero.
fn materials(truth: &[Material]) -> Vec<Material> {
    let off = |m: &Material| Material {
        rho_d: [m.rho_d[0] * 1.1, m.rho_d[1] * 0.95, m.rho_d[2]],
        rho_s: m.rho_s.map(|s| s * 1.2),
        beta: m.beta * 0.9,
    };
    truth.iter().map(off).collect()
}

/// Cost with exact non-negative weights, in f64.
fn reference(lobe: &dyn Lobe, materials: &[Material], objective: Objective, observations: &Observations) -> f64 {
    let gamma = solve_weights(lobe, materials, objective, WeightRule::Exact, observations);
    alpha::cost(lobe, &Mixture { materials: materials.to_vec(), gamma }, objective, observations)
}

fn changed(materials: &[Material], index: usize, step: f64) -> Vec<Material> {
    let mut changed = materials.to_vec();
    let material = &mut changed[index / PER_MATERIAL];
    match index % PER_MATERIAL {
        k @ 0..3 => material.rho_d[k] += step,
        k @ 3..6 => material.rho_s[k - 3] += step,
        _ => material.beta *= step.exp(),
    }
    changed
}

#[test]
fn cost_weights_and_gradient_are_those_of_the_f64_code() {
    for (count, model) in [(1, "ward"), (2, "ward"), (3, "ward"), (2, "ggx"), (2, "blinn-phong")] {
        let lobe = brdf::by_name(model).unwrap();
        let (observations, truth) = synthetic(120, count, 60 + count as u64);
        let materials = materials(&truth.materials);
        for objective in [Objective::ABSOLUTE, Objective::RELATIVE, Objective::NOISE] {
            let recipe = Recipe { lobe, objective, brightness: brightness(&observations) };
            let prepared = Prepared::new(&observations, &recipe);
            let sums = normal(&prepared, &materials, Sign::NonNegative);
            let cost = reference(lobe, &materials, objective, &observations);
            let what = format!("{count} {model} {objective:?}");
            assert!((sums.cost * prepared.unit2 / cost - 1.0).abs() < 1e-4, "{what}: cost {} for {cost}", sums.cost);
            let (gamma, same) = weights(&prepared, &materials, Sign::NonNegative);
            assert!((same / sums.cost - 1.0).abs() < 1e-5, "{what}: two costs");
            let exact = solve_weights(lobe, &materials, objective, WeightRule::Exact, &observations);
            for (found, known) in gamma.iter().zip(&exact) {
                assert!((found - known).abs() < 2e-3, "{what}: weight {found} for {known}");
            }
            for i in 0..PER_MATERIAL * count {
                let h = 1e-4;
                let at = |step: f64| reference(lobe, &changed(&materials, i, step), objective, &observations);
                let numeric = (at(h) - at(-h)) / (4.0 * h);
                let scale = (sums.hessian[triangle(i, i)].abs() * prepared.unit2 * cost).sqrt() + numeric.abs();
                let found = sums.gradient[i] * prepared.unit2;
                assert!((found - numeric).abs() < 2e-3 * scale, "{what}: gradient {i} is {found}, not {numeric}");
            }
        }
    }
}

/// Near the truth the Schur complement is half the second derivative of the projected cost: residuals are small there.
#[test]
fn schur_complement_is_the_curvature_at_the_truth() {
    let lobe = brdf::by_name("ward").unwrap();
    let (observations, truth) = synthetic(150, 2, 71);
    let objective = Objective::RELATIVE;
    let recipe = Recipe { lobe, objective, brightness: 1.0 };
    let sums = normal(&Prepared::new(&observations, &recipe), &truth.materials, Sign::NonNegative);
    for i in 0..2 * PER_MATERIAL {
        let h = 1e-3;
        let at = |step: f64| reference(lobe, &changed(&truth.materials, i, step), objective, &observations);
        let curvature = (at(h) + at(-h) - 2.0 * at(0.0)) / (2.0 * h * h);
        let found = sums.hessian[triangle(i, i)];
        assert!((found / curvature - 1.0).abs() < 0.05, "unknown {i}: {found} for {curvature}");
    }
}

/// Cauchy's cost and its slope along a line agree, and an outlier hardly moves a weight.
#[test]
fn cauchy_bounds_the_pull_of_an_outlier() {
    let lobe = brdf::by_name("ward").unwrap();
    let (clean, truth) = synthetic(80, 1, 72);
    let mut first = true;
    let (observations, _) = clean.changed(1, |_, mut sample| {
        if std::mem::take(&mut first) {
            sample.radiance = sample.radiance.map(|i| 3.0 * i);
        }
        Some(sample)
    });
    let weight = |objective: Objective| {
        let recipe = Recipe { lobe, objective, brightness: 1.0 };
        weights(&Prepared::new(&observations, &recipe), &truth.materials, Sign::NonNegative).0[0] / truth.gamma[0]
    };
    let (plain, robust) = (weight(Objective::NOISE), weight(Objective::NOISE_CAUCHY));
    assert!((plain - 1.0).abs() > 5.0 * (robust - 1.0).abs(), "plain {plain}, robust {robust}");
}

/// Noise in proportion to the radiance, 3 % of it: weights by measured radiances come out low by twice its square, those that
/// follow the model do not.
#[test]
fn weights_that_follow_the_model_are_not_low() {
    let lobe = brdf::by_name("ward").unwrap();
    let (exact, truth) = synthetic(1500, 1, 76);
    let observations = noisy(&exact, 0.03, 77);
    let recipe = Recipe { lobe, objective: Objective::NOISE_CAUCHY, brightness: 1.0 };
    let measured = Prepared::empty(&recipe);
    let followed = Prepared::empty(&recipe).following_the_model(recipe.objective);
    let [measured, followed] = [measured, followed].map(|mut prepared| {
        prepared.refill(&observations, &recipe, 0..observations.blocks());
        let (gamma, _) = weights(&prepared, &truth.materials, Sign::NonNegative);
        let ratios = gamma.iter().zip(&truth.gamma).map(|(found, known)| found / known - 1.0);
        ratios.sum::<f64>() / gamma.len() as f64
    });
    // 18 residuals a point, 1500 points: the mean is known to 2e-4.
    assert!((measured + 2.0 * 0.03 * 0.03).abs() < 6e-4, "{measured}");
    assert!(followed.abs() < 6e-4, "{followed}");
}

fn deviations_of_all(prepared: &Prepared, materials: &[Material]) -> Vec<f64> {
    deviations(prepared, materials, Sign::Free)
}

/// With slack no weight is below its floor, the cost lies between those of the other signs, and the gradient is that of the
/// cost.
#[test]
fn slack_holds_weights_at_their_floors() {
    let lobe = brdf::by_name("ward").unwrap();
    let (exact, truth) = synthetic(300, 3, 74);
    let observations = noisy(&exact, 0.3, 75);
    let two = &materials(&truth.materials)[..2];
    let recipe = Recipe { lobe, objective: Objective::NOISE, brightness: 1.0 };
    let mut prepared = Prepared::new(&observations, &recipe);
    let sigma = deviations_of_all(&prepared, two);
    let variance = 4.0;
    prepared.loosen(&sigma, 2, variance);
    let (gamma, cost) = weights(&prepared, two, Sign::Slack);
    let floors: Vec<f64> = sigma.iter().map(|sigma| -2.75 * variance.sqrt() * sigma).collect();
    let above = |(&weight, &floor): (&f64, &f64)| weight >= floor * (1.0 + 1e-5);
    assert!(gamma.iter().zip(&floors).all(above));
    let at = |(&weight, &floor): (&f64, &f64)| (weight / floor - 1.0).abs() < 1e-5;
    let held = gamma.iter().zip(&floors).filter(|&pair| at(pair)).count();
    let below = gamma.iter().filter(|weight| **weight < 0.0).count();
    assert!(held > 3 && below > held, "{held} at their floors, {below} below zero");
    let of = |sign| weights(&prepared, two, sign).1;
    assert!(of(Sign::Free) < cost && cost < of(Sign::NonNegative), "{cost}");
    let sums = normal(&prepared, two, Sign::Slack);
    assert!((sums.cost / cost - 1.0).abs() < 1e-5);
    for i in 0..2 * PER_MATERIAL {
        let h = 2e-3;
        let at = |step: f64| weights(&prepared, &changed(two, i, step), Sign::Slack).1;
        let numeric = (at(h) - at(-h)) / (4.0 * h);
        let scale = (sums.hessian[triangle(i, i)].abs() * cost).sqrt() + numeric.abs();
        assert!((sums.gradient[i] - numeric).abs() < 2e-3 * scale, "{i}: {} for {numeric}", sums.gradient[i]);
    }
}

/// [`deviations`] of the first chunk with a given instruction set.
fn deviations_at(level: Level, prepared: &Prepared, materials: &[Material], sign: Sign) -> Vec<f64> {
    let mut sigma = vec![0.0; CHUNK * materials.len()];
    let blocks = 0..prepared.blocks().min(BLOCKS);
    level.run(Pass { prepared, materials, sign, blocks, out: Out::Deviations(&mut sigma) });
    sigma
}

/// Every number of every pass is the same to the bit with every instruction set.
#[test]
fn instruction_sets_do_not_change_a_bit() {
    let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<u64>>();
    // More than a chunk, and lanes left over.
    let (exact, truth) = synthetic(CHUNK + 45, 3, 73);
    let observations = noisy(&exact, 0.2, 73);
    let mut four = materials(&truth.materials);
    four.push(Material { rho_d: [0.2, 0.3, 0.1], rho_s: [0.04, 0.02, 0.0], beta: 0.4 });
    let mut negative = false;
    for model in ["ward", "ggx", "lambert"] {
        let lobe = brdf::by_name(model).unwrap();
        for objective in [Objective::NOISE, Objective::NOISE_CAUCHY] {
            let recipe = Recipe { lobe, objective, brightness: brightness(&observations) };
            let mut prepared = Prepared::new(&observations, &recipe);
            let signs = [Sign::NonNegative, Sign::Slack, Sign::Free];
            for (count, sign) in (1..=4).flat_map(|count| signs.map(|sign| (count, sign))) {
                let sigma = deviations_of_all(&prepared, &four[..count]);
                prepared.loosen(&sigma, count, 1.0);
                let followed = prepared.clone().following_the_model(objective);
                let run = |level| {
                    let sums = normal_at(level, &prepared, &four[..count], sign);
                    let (gamma, cost) = weights_at(level, &prepared, &four[..count], sign);
                    let (follow, _) = weights_at(level, &followed, &four[..count], sign);
                    let sigma = deviations_at(level, &prepared, &four[..count], sign);
                    [vec![sums.cost, cost], sums.gradient, sums.hessian, gamma, follow, sigma]
                };
                let scalar = run(Level::Scalar);
                negative |= scalar[3].iter().any(|weight| *weight < 0.0);
                assert!(
                    scalar.iter().flatten().all(|value| value.is_finite()),
                    "{model} {objective:?} {count} {sign:?}"
                );
                for level in Level::available() {
                    for (k, (wide, narrow)) in run(level).iter().zip(&scalar).enumerate() {
                        let what = format!("{level:?} {model} {objective:?} {count} {sign:?}, result {k}");
                        assert!(bits(wide) == bits(narrow), "{what}");
                    }
                }
            }
        }
    }
    assert!(negative, "free weights were never negative: the two signs were not told apart");
}
