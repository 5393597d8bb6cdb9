//! The paper's equations against an independent script in another language (tests/oracle/zheng2008.py says how to run it).
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

use rigd::numerics::brdf::{Material, ward::Ward};
use rigd::numerics::fit::Mixture;
use rigd::numerics::fit::initialise::{Diffuse, log_linear, specular, without_highlights};
use rigd::numerics::fit::levmar::Stop;
use rigd::numerics::fit::objective::Objective;
use rigd::numerics::fit::observations::{Observations, Sample};
use rigd::numerics::fit::weights::WeightRule;
use rigd::numerics::fit::zheng2008::alternate;
use rigd::numerics::geometry::{Angles, Vec3};
use serde::Deserialize;

const TOLERANCE: f64 = 1e-6;

#[derive(Deserialize)]
struct Oracle {
    points: Vec<Vec<Seen>>,
    eq4: Vec<Eq4>,
    eq8: Eq8,
    eq9: Eq9,
    start: Vec<Brdf>,
    alternations: Vec<Alternation>,
}

#[derive(Deserialize)]
struct Seen {
    normal: [f64; 3],
    light: [f64; 3],
    view: [f64; 3],
    irradiance: [f64; 3],
    radiance: [f64; 3],
}

#[derive(Deserialize)]
struct Eq4 {
    normal: [f64; 3],
    light: [f64; 3],
    view: [f64; 3],
    rho_d: [f64; 3],
    rho_s: [f64; 3],
    beta: f64,
    brdf: [f64; 3],
}

#[derive(Deserialize)]
struct Eq8 {
    gamma: Vec<f64>,
    rho_d: [f64; 3],
}

#[derive(Deserialize)]
struct Eq9 {
    rho_s: [f64; 3],
    beta: f64,
}

#[derive(Deserialize)]
struct Brdf {
    rho_d: [f64; 3],
    rho_s: [f64; 3],
    beta: f64,
}

#[derive(Deserialize)]
struct Alternation {
    objective: String,
    rule: String,
    gamma: Vec<Vec<f64>>,
    cost: f64,
    materials: Vec<Brdf>,
}

fn oracle() -> Oracle {
    serde_json::from_str(include_str!("oracle/zheng2008.json")).unwrap()
}

fn angles(normal: [f64; 3], light: [f64; 3], view: [f64; 3]) -> Angles {
    Angles::new(&Vec3::from(normal), &Vec3::from(light), &Vec3::from(view))
}

fn observations(oracle: &Oracle) -> Observations {
    let mut all = Observations::new(7);
    for (index, point) in oracle.points.iter().enumerate() {
        let sample = |(light, s): (usize, &Seen)| {
            let angles = angles(s.normal, s.light, s.view);
            let irradiance = s.irradiance.map(|l| l * angles.cos_i);
            Sample { light, angles, irradiance, radiance: s.radiance, variance: [0.0; 3] }
        };
        let samples: Vec<Sample> = point.iter().enumerate().map(sample).collect();
        all.push(index, &samples);
    }
    all
}

#[track_caller]
fn agree(ours: f64, theirs: f64, what: &str) {
    let difference = (ours - theirs).abs() / theirs.abs().max(1e-9);
    assert!(difference <= TOLERANCE, "{what}: {ours} here, {theirs} there, {difference:.1e} apart");
}

fn agree_all(ours: &[f64], theirs: &[f64], what: &str) {
    assert_eq!(ours.len(), theirs.len());
    for (i, (a, b)) in ours.iter().zip(theirs).enumerate() {
        agree(*a, *b, &format!("{what}[{i}]"));
    }
}

#[test]
fn equation_4() {
    for (i, case) in oracle().eq4.iter().enumerate() {
        let material = Material { rho_d: case.rho_d, rho_s: case.rho_s, beta: case.beta };
        let ours = material.brdf(&Ward, &angles(case.normal, case.light, case.view));
        agree_all(&ours, &case.brdf, &format!("case {i}"));
    }
}

fn diffuse(oracle: &Oracle) -> Diffuse {
    let all = observations(oracle);
    let points: Vec<Vec<Sample>> = (0..all.points()).map(|p| without_highlights(all.of(p).collect())).collect();
    log_linear(&points)
}

#[test]
fn equation_8() {
    let oracle = oracle();
    let ours = diffuse(&oracle);
    agree_all(&ours.gamma, &oracle.eq8.gamma, "gamma");
    agree_all(&ours.rho_d, &oracle.eq8.rho_d, "rho_d");
}

#[test]
fn equation_9() {
    let oracle = oracle();
    let all = observations(&oracle);
    let members: Vec<usize> = (0..all.points()).collect();
    let ours = specular(&Ward, &all, &members, &diffuse(&oracle));
    agree_all(&ours.rho_s, &oracle.eq9.rho_s, "rho_s");
    agree(ours.beta, oracle.eq9.beta, "beta");
}

#[test]
fn one_full_alternation_under_every_objective_and_rule() {
    let oracle = oracle();
    let all = observations(&oracle);
    assert_eq!(oracle.alternations.len(), 4);
    for expected in &oracle.alternations {
        let start = |b: &Brdf| Material { rho_d: b.rho_d, rho_s: b.rho_s, beta: b.beta };
        let mut mixture = Mixture { materials: oracle.start.iter().map(start).collect(), gamma: Vec::new() };
        let objective = Objective::by_name(&expected.objective).unwrap();
        let rule = WeightRule::by_name(&expected.rule).unwrap();
        let stop = Stop { relative_decrease: 1e-15, iterations: 500 };
        let cost = alternate(&Ward, &all, &mut mixture, objective, rule, stop);
        let name = format!("{} {}", expected.objective, expected.rule);
        agree(cost, expected.cost, &format!("{name} cost"));
        agree_all(&mixture.gamma, &expected.gamma.concat(), &format!("{name} gamma"));
        for (m, (ours, theirs)) in mixture.materials.iter().zip(&expected.materials).enumerate() {
            agree_all(&ours.rho_d, &theirs.rho_d, &format!("{name} rho_d of {m}"));
            agree_all(&ours.rho_s, &theirs.rho_s, &format!("{name} rho_s of {m}"));
            agree(ours.beta, theirs.beta, &format!("{name} beta of {m}"));
        }
    }
}
