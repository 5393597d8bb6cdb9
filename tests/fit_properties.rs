//! Properties of fits to random observations: whatever the samples, a typed refusal or finite numbers; the unit of radiance
//! and the order of the points are nobody's business.
#![allow(clippy::unwrap_used, missing_docs)]

use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestRng, TestRunner};
use rigd::numerics::brdf::{MODELS, Material, ward::Ward};
use rigd::numerics::fit::objective::Objective;
use rigd::numerics::fit::observations::{Observations, Sample};
use rigd::numerics::fit::solver::SOLVERS;
use rigd::numerics::geometry::Angles;
use rigd::pipeline::fit::{FitError, FitOptions};
use rigd::pipeline::judged::{Judged, fit_observations};
use std::cell::Cell;
use std::f64::consts::PI;
use std::ops::ControlFlow;

/// The same cases at every run.
fn runner(cases: u32) -> TestRunner {
    let config = Config { cases, failure_persistence: None, max_shrink_iters: 200, ..Config::default() };
    TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
}

/// Angles that two directions above a surface can have, and the azimuth of the light.
fn angles() -> impl Strategy<Value = (Angles, f64)> {
    (-2.0..0.0f64, -2.0..0.0f64, -PI..PI).prop_map(|(i, r, azimuth)| {
        let (cos_i, cos_r) = (10f64.powf(i), 10f64.powf(r));
        let sine = |cos: f64| (1.0 - cos * cos).sqrt();
        let cos_iv = sine(cos_i) * sine(cos_r) * azimuth.cos() + cos_i * cos_r;
        let cos_h = ((cos_i + cos_r) / (2.0 + 2.0 * cos_iv).sqrt()).min(1.0);
        (Angles { cos_i, cos_r, tan2_half: (1.0 - cos_h * cos_h) / (cos_h * cos_h), cos_iv }, azimuth)
    })
}

/// How radiances come about.
#[derive(Clone, Copy, Debug)]
enum Radiance {
    /// Over so many decades, each channel for itself.
    Decades(f64),
    /// A material with 2 % noise.
    Material,
    /// The same everywhere.
    Equal,
}

fn radiance() -> impl Strategy<Value = Radiance> {
    prop_oneof![(0.0..11.0f64).prop_map(Radiance::Decades), Just(Radiance::Material), Just(Radiance::Equal)]
}

/// A sample before it is known how radiances come about: angles, azimuth, present, three numbers from 0 to 1.
type Raw = ((Angles, f64), bool, [f64; 3]);

const MATERIAL: Material = Material { rho_d: [0.5, 0.4, 0.3], rho_s: [0.05, 0.06, 0.04], beta: 0.2 };

fn raw() -> impl Strategy<Value = Raw> {
    (angles(), prop::bool::weighted(0.85), prop::array::uniform3(0.0..1.0f64))
}

/// 1 to 40 points under 1 to 8 lights.
fn observations() -> impl Strategy<Value = Observations> {
    let points = (1usize..=40, 1usize..=8)
        .prop_flat_map(|(points, lights)| prop::collection::vec(prop::collection::vec(raw(), lights), points));
    let deviation = prop_oneof![Just(0.0), Just(0.05), Just(1e3)];
    (points, radiance(), -6i32..=6, deviation)
        .prop_map(|(points, kind, decade, deviation)| observe(&points, kind, decade, deviation))
}

/// Radiances of a kind times 10^`decade`, whose standard deviations are `deviation` times themselves; the first light always
/// counts.
fn observe(points: &[Vec<Raw>], kind: Radiance, decade: i32, deviation: f64) -> Observations {
    let mut all = Observations::new(points[0].len());
    for (index, row) in points.iter().enumerate() {
        let sample = |(light, ((angles, _), _, random)): (usize, &Raw)| {
            let irradiance = [3.0, 2.8, 2.5].map(|l| l * angles.cos_i);
            let brdf = MATERIAL.brdf(&Ward, angles);
            let radiance: [f64; 3] = std::array::from_fn(|c| {
                10f64.powi(decade)
                    * match kind {
                        Radiance::Decades(decades) => 10f64.powf(decades * (random[c] - 0.5)),
                        Radiance::Material => irradiance[c] * brdf[c] * (1.0 + 0.07 * (random[c] - 0.5)),
                        Radiance::Equal => 1.0,
                    }
            });
            let variance = radiance.map(|i| (deviation * i).powi(2));
            Sample { light, angles: *angles, irradiance, radiance, variance }
        };
        let counts = |(light, raw): &(usize, &Raw)| raw.1 || *light == 0;
        all.push(index, &row.iter().enumerate().filter(counts).map(sample).collect::<Vec<Sample>>());
    }
    all.set_azimuths(|point, sample| points[point][sample.light].0.1);
    all
}

/// Every solver with every objective and every model.
fn combinations() -> Vec<FitOptions> {
    let mut all = Vec::new();
    for solver in SOLVERS {
        for (objective, _) in Objective::ALL {
            for model in MODELS {
                all.push(FitOptions {
                    solver: solver.name().to_owned(),
                    objective: objective.to_owned(),
                    model: model.name().to_owned(),
                    ..FitOptions::default()
                });
            }
        }
    }
    all
}

fn fit(observations: &Observations, options: &FitOptions) -> Result<Judged, FitError> {
    fit_observations(observations, options, &mut |_| ControlFlow::Continue(()))
}

/// What of a result is not a finite number, or a negative weight; none if all is well.
fn unsound(judged: &Judged, points: usize) -> Option<String> {
    let mixture = &judged.solution.mixture;
    let parameters = |m: &Material| m.rho_d.into_iter().chain(m.rho_s).chain([m.beta]).collect::<Vec<f64>>();
    let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
    let errors = &judged.uncertainty;
    let known: Vec<f64> = errors.alpha.iter().flatten().copied().collect();
    let reported = judged.materials.iter().flat_map(|m| m.rho_d.iter().chain(&m.rho_s).chain(&m.beta));
    let reported: Vec<f64> = reported.flat_map(|p| [p.value, p.standard_error.unwrap_or(0.0)]).collect();
    let quality = &judged.quality;
    let relative = [quality.mean_relative_error, quality.highlight_relative_error.unwrap_or(0.0), quality.chi2];
    let tilts: Vec<f64> = judged.solution.tilts.iter().flatten().flatten().copied().collect();
    let checks = [
        ("number of weights", mixture.gamma.len() == points * judged.task.materials),
        ("albedos and beta", mixture.materials.iter().all(|m| finite(&parameters(m)))),
        ("albedos below 0", mixture.materials.iter().all(|m| parameters(m).iter().all(|v| *v >= 0.0))),
        ("weights", finite(&mixture.gamma) && mixture.gamma.iter().all(|g| *g >= 0.0)),
        ("cost", judged.solution.cost.is_finite()),
        ("standard errors of parameters", finite(&known) && known.iter().all(|s| *s >= 0.0)),
        ("standard errors of weights", finite(&errors.gamma) && errors.gamma.iter().all(|s| *s >= 0.0)),
        ("looseness", errors.loose.iter().all(|l| (-1e-9..=1.0 + 1e-9).contains(l))),
        ("least eigenvalue", errors.least_eigenvalue.is_finite()),
        ("reported parameters", finite(&reported)),
        ("errors on the samples", finite(&relative) && judged.reduced_chi2.is_finite()),
        ("tilts", finite(&tilts)),
    ];
    let failed: Vec<&str> = checks.iter().filter(|(_, sound)| !sound).map(|(what, _)| *what).collect();
    let text = format!("{:?} {:?} {:?} {errors:?}", failed, mixture, judged.solution.cost);
    (!failed.is_empty()).then_some(text)
}

/// Runs `property` over every combination of options in turn, each with as many random observations as `rounds` says.
fn over_all(rounds: usize, property: impl Fn(&Observations, &FitOptions) -> Result<(), TestCaseError>) {
    let combinations = combinations();
    let cases = (rounds * combinations.len()) as u32;
    let (turn, failed) = (Cell::new(0), Cell::new(false));
    let what = (observations(), prop::option::of(1usize..=4), prop::bool::ANY);
    let result = runner(cases).run(&what, |(observations, materials, gains)| {
        let gains = if gains { "auto" } else { "off" }.to_owned();
        let options = FitOptions { materials, gains, ..combinations[turn.get() % combinations.len()].clone() };
        let passed = property(&observations, &options);
        // A failing case is shrunk with the options it failed with.
        failed.set(failed.get() || passed.is_err());
        turn.set(turn.get() + usize::from(!failed.get()));
        passed
    });
    let text: String =
        result.map_or_else(|failure| failure.to_string().chars().take(6000).collect(), |()| String::new());
    assert!(text.is_empty(), "{:?}: {text}", combinations[turn.get() % combinations.len()]);
}

#[test]
fn a_refusal_or_finite_numbers() {
    let fitted = Cell::new(0);
    over_all(2, |observations, options| {
        match fit(observations, options) {
            Ok(judged) => {
                fitted.set(fitted.get() + 1);
                let unsound = unsound(&judged, observations.points());
                prop_assert!(unsound.is_none(), "{unsound:?}");
            }
            Err(FitError::Input(reason)) => prop_assert!(reason.len() > 20, "{reason}"),
            Err(other) => prop_assert!(false, "{other}"),
        }
        Ok(())
    });
    println!("{} fitted", fitted.get());
}

/// The observations with radiances times 2^`k` and irradiances times 2^`l`.
fn scaled(observations: &Observations, k: i32, l: i32) -> Observations {
    let times = |v: [f64; 3], factor: f64| v.map(|v| v * factor);
    let (k, l) = (2f64.powi(k), 2f64.powi(l));
    let change = |_, s: Sample| {
        let (radiance, variance) = (times(s.radiance, k), times(s.variance, k * k));
        Some(Sample { radiance, variance, irradiance: times(s.irradiance, l), ..s })
    };
    observations.changed(0, change).0
}

/// A result in numbers whose bits can be compared.
fn numbers(judged: &Judged) -> Vec<u64> {
    let mixture = &judged.solution.mixture;
    let of = |m: &Material| m.rho_d.into_iter().chain(m.rho_s).chain([m.beta]).collect::<Vec<f64>>();
    let errors = judged.uncertainty.alpha.iter().map(|error| error.unwrap_or(-1.0));
    let all = mixture.materials.iter().flat_map(of).chain(mixture.gamma.iter().copied()).chain(errors);
    all.chain(judged.uncertainty.gamma.iter().copied()).map(f64::to_bits).collect()
}

/// Radiance and irradiance in another unit: powers of two change no digit, so not a bit of the result.
#[test]
fn the_unit_of_radiance_does_not_change_a_bit() {
    over_all(1, |observations, options| {
        for k in [-9, 7] {
            // In the other unit a sample may lie beyond what fits can use.
            if let (Ok(here), Ok(there)) = (fit(observations, options), fit(&scaled(observations, k, k), options)) {
                prop_assert_eq!(numbers(&here), numbers(&there), "2^{}", k);
            }
        }
        Ok(())
    });
}

/// One material with noise, seen well: every solver finds the same parameters from any order of the points and, but for the
/// albedos, any brightness. Its search stops where a step promises less than 1e-5 of the cost, that of the alternation at
/// 1e-6 a round; with some 800 degrees of freedom that leaves sqrt(800e-5), a tenth, of a standard error of a weight, which
/// is 0.5 % (2 % over the root of 18 numbers): 5e-4. Twice that, for the two fits.
#[test]
fn neither_order_nor_brightness_of_the_points_matters() {
    let seen =
        |(angles, azimuth): (Angles, f64)| (angles.cos_i > 0.1 && angles.cos_r > 0.1).then_some((angles, azimuth));
    let lit = angles().prop_filter_map("grazing", seen);
    let row = prop::collection::vec((lit, Just(true), prop::array::uniform3(0.0..1.0f64)), 8);
    let points = prop::collection::vec(row, 40).prop_map(|points| observe(&points, Radiance::Material, 0, 0.0));
    let result = runner(3).run(&points, |observations| {
        let order: Vec<usize> = (0..40).map(|i| (i * 11 + 3) % 40).collect();
        for options in combinations().into_iter().filter(|options| options.model == "ward") {
            let options =
                FitOptions { materials: Some(1), gains: "off".to_owned(), lobe: "coloured".to_owned(), ..options };
            let of = |observations: &Observations| fit(observations, &options).unwrap().solution.mixture;
            let (plain, moved) = (of(&observations), of(&observations.select(&order)));
            let bright = of(&scaled(&observations, 2, 0));
            let near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-3;
            let (m, n, b) = (plain.materials[0], moved.materials[0], bright.materials[0]);
            for point in 0..40 {
                let (here, there) = (plain.gamma[order[point]], moved.gamma[point]);
                prop_assert!(near(here, there), "{} {}: {} and {}", options.solver, options.objective, here, there);
                let (here, there) = (plain.gamma[point], bright.gamma[point]);
                prop_assert!(near(here, there), "{} {}: {} and {}", options.solver, options.objective, here, there);
            }
            for c in 0..3 {
                prop_assert!(near(m.rho_d[c], n.rho_d[c]), "{:?}: {:?} and {:?}", options, m, n);
                prop_assert!(near(4.0 * m.rho_d[c], b.rho_d[c]), "{:?}: {:?} and {:?}", options, m, b);
            }
        }
        Ok(())
    });
    let text: String =
        result.map_or_else(|failure| failure.to_string().chars().take(1500).collect(), |()| String::new());
    assert!(text.is_empty(), "{text}");
}
