//! The studies: what the generator makes, what the scores say of the truth, and what ends up in the tables.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use rigd::numerics::brdf::{Material, ward::Ward};
use rigd::numerics::fit::Mixture;
use rigd::numerics::fit::kernel::Sign;
use rigd::numerics::fit::objective::Objective;
use rigd::numerics::fit::observations::{Observations, Sample};
use rigd::numerics::fit::solver::{OnIteration, Refusal, Solution, Solver, Task, Termination};
use rigd::numerics::fit::varpro::Subset;
use rigd::study::forward::{Reflectance, TrueMaterial, reflect};
use rigd::study::method::Method;
use rigd::study::scene::{Clipping, Problem, Scene};
use rigd::study::score::{BEST_RELIGHT, score};
use rigd::study::{speed, stability};
use std::collections::HashSet;

fn small() -> Scene {
    Scene { points: 600, ..Scene::marble() }
}

/// A quantity of every sample and channel.
fn channels(observations: &Observations, of: fn(&Sample) -> [f64; 3]) -> Vec<f64> {
    let mut all = Vec::new();
    for point in 0..observations.points() {
        for sample in observations.of(point) {
            all.extend(of(&sample));
        }
    }
    all
}

fn radiances(observations: &Observations) -> Vec<f64> {
    channels(observations, |sample| sample.radiance)
}

fn samples(observations: &Observations) -> usize {
    radiances(observations).len() / 3
}

fn truth(problem: &Problem) -> Mixture {
    let material = |m: &TrueMaterial| Material { rho_d: m.rho_d, rho_s: m.rho_s, beta: m.beta };
    Mixture { materials: problem.truth.materials.iter().map(material).collect(), gamma: problem.truth.gamma.clone() }
}

fn near(found: f64, wanted: f64, relative: f64) {
    assert!((found / wanted - 1.0).abs() <= relative, "{found} instead of {wanted} within {relative}");
}

/// Points and samples of the geometry of Zheng 2008 as an independent script counted them.
#[test]
fn the_scenes_have_the_size_of_the_paper() {
    for (scene, points, count) in [(Scene::marble(), 13_067.0, 54_990.0), (Scene::wood(), 10_997.0, 46_301.0)] {
        let observations = scene.generate(0).observations;
        near(observations.points() as f64, points, 0.01);
        near(samples(&observations) as f64, count, 0.01);
        for point in 0..observations.points() {
            let mut lights = HashSet::new();
            for sample in observations.of(point) {
                lights.insert(sample.light);
            }
            assert!((3..=6).contains(&lights.len()), "point {point} is seen by {} lights", lights.len());
        }
    }
}

#[test]
fn radiance_spans_three_decades_and_weights_are_often_zero() {
    for (scene, pure) in [(Scene::marble(), 0.27), (Scene::wood(), 0.50)] {
        let problem = scene.generate(1);
        let all = radiances(&problem.observations);
        let range = all.iter().copied().fold(0.0, f64::max) / all.iter().copied().fold(f64::INFINITY, f64::min);
        assert!((500.0..3000.0).contains(&range), "the brightest sample is {range} times the darkest");
        let gamma = &problem.truth.gamma;
        let zeros = gamma.chunks(2).filter(|pair| pair.contains(&0.0)).count() as f64 / (gamma.len() / 2) as f64;
        assert!((zeros - pure).abs() < 0.005, "{zeros} of the points are of one material");
        assert!(gamma.chunks(2).all(|pair| pair[0] >= 0.0 && pair[1] >= 0.0 && pair[0] + pair[1] <= 1.0 + 1e-12));
    }
}

/// Mean |n| of a normal variable is sqrt(2 / pi) standard deviations: 2 % noise is 1.60 % on average.
#[test]
fn noise_is_two_percent_and_its_variance_is_told() {
    let noisy = Scene::marble().generate(2).observations;
    let clean = Scene { noise: 0.0, floor: 0.0, ..Scene::marble() }.generate(2).observations;
    let (noisy_values, clean_values) = (radiances(&noisy), radiances(&clean));
    assert_eq!(noisy_values.len(), clean_values.len());
    let pairs = || noisy_values.iter().zip(&clean_values);
    let mean = pairs().map(|(n, c)| (n / c - 1.0).abs()).sum::<f64>() / clean_values.len() as f64;
    near(mean, 0.0160, 0.01);
    let variances = channels(&noisy, |sample| sample.variance);
    let chi2: f64 = pairs().zip(&variances).map(|((n, c), variance)| (n - c).powi(2) / variance).sum();
    near(chi2 / clean_values.len() as f64, 1.0, 0.02);
}

#[test]
fn a_seed_gives_the_same_scene_and_another_seed_another() {
    let (one, again, other) = (small().generate(3), small().generate(3), small().generate(4));
    assert_eq!(radiances(&one.observations), radiances(&again.observations));
    assert_eq!(one.truth.gamma, again.truth.gamma);
    assert_ne!(radiances(&one.observations), radiances(&other.observations));
}

/// Imperfections do not move the texture: the same ball is captured well and badly.
#[test]
fn imperfections_leave_the_ball_alone() {
    let sound = small().generate(5);
    let bad = Scene { drift: 0.05, outliers: 0.05, noise: 0.05, ..small() }.generate(5);
    assert_eq!(sound.truth.gamma, bad.truth.gamma);
    assert_ne!(radiances(&sound.observations), radiances(&bad.observations));
}

#[test]
fn clipped_samples_are_kept_at_the_limit_or_counted_as_lost_highlights() {
    let clip = |kept| Scene { clipping: Some(Clipping { at_medians: 1.5, kept }), ..small() };
    let (kept, dropped) = (clip(true).generate(6).observations, clip(false).generate(6).observations);
    let limit = radiances(&kept).into_iter().fold(0.0, f64::max);
    let lost = radiances(&kept).chunks(3).filter(|values| values.contains(&limit)).count();
    assert!(lost > 50, "only {lost} samples are clipped");
    assert_eq!(kept.unusable, 0);
    assert_eq!(dropped.unusable, lost);
    assert!(dropped.unusable_highlight > 0 && dropped.unusable_highlight < lost);
    assert!(radiances(&dropped).iter().all(|&value| value <= limit));
}

/// The forward model against closed forms: energy of GGX facets, peak of the Ward lobe, Fresnel at grazing incidence.
#[test]
fn the_forward_model_has_the_closed_forms_of_its_laws() {
    use nalgebra::Vector3;
    let material = TrueMaterial { rho_d: [0.0; 3], rho_s: [0.04; 3], beta: 0.1 };
    let normal = Vector3::z();
    let peak = reflect(Reflectance::Ward, &material, &normal, &normal, &normal)[0];
    near(peak, 0.04 / (4.0 * std::f64::consts::PI * 0.01), 1e-12);
    near(reflect(Reflectance::Ggx, &material, &normal, &normal, &normal)[0], peak, 1e-12);
    let at = |degrees: f64, side: f64| {
        let angle = degrees.to_radians();
        Vector3::new(side * angle.sin(), 0.0, angle.cos())
    };
    let ratio = |degrees: f64| {
        let of = |law| reflect(law, &material, &normal, &at(degrees, 1.0), &at(degrees, -1.0))[0];
        of(Reflectance::GgxFresnel) / of(Reflectance::Ggx)
    };
    near(ratio(0.0), 1.0, 1e-12);
    near(ratio(60.0), (0.04 + 0.96 * 0.5f64.powi(5)) / 0.04, 1e-9);
    assert_eq!(reflect(Reflectance::Ward, &material, &normal, &at(91.0, 1.0), &normal), [0.0; 3]);
}

/// The truth relights without error, which also pins the fit's Ward model to the study's own; it fits as well as the noise
/// permits, and one weight too large by 10 % shows.
#[test]
fn the_truth_scores_the_noise_floor() {
    let problem = Scene::wood().generate(7);
    let perfect = score(&Ward, &problem, &truth(&problem));
    assert!(perfect.relight < 1e-12 && !perfect.failed);
    near(perfect.fit, 0.0160, 0.02);
    let parameters = perfect.parameters.unwrap();
    assert!(parameters.beta < 1e-12 && parameters.rho_s < 1e-9 && parameters.gamma < 1e-9);
    let mut worse = truth(&problem);
    worse.materials[0].beta *= 1.1;
    let worse = score(&Ward, &problem, &worse);
    near(worse.parameters.unwrap().beta, 0.05, 1e-9);
    assert!(worse.relight > 1e-3 && worse.relight_highlight.unwrap() > worse.relight);
}

/// The gauge and the order of the materials do not matter.
#[test]
fn scores_do_not_depend_on_the_gauge() {
    let problem = small().generate(8);
    let mut other = truth(&problem);
    other.materials.swap(0, 1);
    for pair in other.gamma.chunks_mut(2) {
        pair.copy_from_slice(&[0.5 * pair[1], 4.0 * pair[0]]);
    }
    for (material, factor) in other.materials.iter_mut().zip([2.0, 0.25]) {
        material.rho_d = material.rho_d.map(|v| v * factor);
        material.rho_s = material.rho_s.map(|v| v * factor);
    }
    let parameters = score(&Ward, &problem, &other).parameters.unwrap();
    assert!(parameters.beta < 1e-12 && parameters.rho_s < 1e-9 && parameters.gamma < 1e-9, "{parameters:?}");
}

/// A solver that gives the same bad answer to everything.
struct Broken {
    rho_d: f64,
    gamma: f64,
}

impl Solver for Broken {
    fn name(&self) -> &'static str {
        "broken"
    }

    fn solve(&self, observations: &Observations, task: &Task, _: OnIteration<'_>) -> Result<Solution, Refusal> {
        let material = Material { rho_d: [self.rho_d; 3], rho_s: [0.0; 3], beta: 0.1 };
        let mixture = Mixture {
            materials: vec![material; task.materials],
            gamma: vec![self.gamma; observations.points() * task.materials],
        };
        let termination = Termination::Converged;
        Ok(Solution {
            mixture,
            cost: 0.0,
            iterations: 1,
            termination,
            sign: Sign::NonNegative,
            tilts: None,
            notes: Vec::new(),
        })
    }
}

static SUBSETS: [Subset; 1] = [Subset(60)];

fn method(solver: &'static dyn Solver) -> Method {
    Method { solver, objective: Objective::RELATIVE, points: None, automatic: false, rounds: None }
}

static NOT_A_NUMBER: Broken = Broken { rho_d: f64::NAN, gamma: 0.5 };
static INFINITE_WEIGHTS: Broken = Broken { rho_d: 0.5, gamma: f64::INFINITY };
static WRONG: Broken = Broken { rho_d: 0.5, gamma: 0.4 };

fn broken_plan(warnings: stability::Warnings<'_>) -> stability::Plan<'_> {
    let mut rows = stability::rows(false);
    rows.truncate(2);
    for row in &mut rows {
        row.scene.points = 150;
    }
    let columns = [&NOT_A_NUMBER, &INFINITE_WEIGHTS, &WRONG].map(|solver| method(solver)).to_vec();
    stability::Plan { rows, columns, seeds: 3, warnings }
}

#[test]
fn a_failing_solver_is_scored_as_failure_also_when_it_warned() {
    let silent = stability::run(&broken_plan(&|_, _, _| Vec::new()), &|_, _| {});
    assert_eq!(silent.len(), 2);
    for cell in silent.iter().flatten() {
        assert_eq!((cell.failures, cell.silent_failures), (1.0, 1.0));
        assert!(cell.relight > 3.0 * BEST_RELIGHT);
    }
    assert!(silent[0][0].relight.is_infinite() && silent[0][1].relight.is_infinite());
    assert!(silent[0][2].relight.is_finite());
    let loud = stability::run(&broken_plan(&|_, _, _| vec!["a".to_owned(), "b".to_owned()]), &|_, _| {});
    assert!(loud.iter().flatten().all(|cell| (cell.failures, cell.silent_failures, cell.warnings) == (1.0, 0.0, 2.0)));
}

/// The fields of a table, with quotes undone.
fn parse(text: &str) -> Vec<Vec<String>> {
    let field = |line: &str| {
        let mut fields = vec![String::new()];
        let (mut quoted, mut signs) = (false, line.chars().peekable());
        while let Some(sign) = signs.next() {
            match sign {
                '"' if quoted && signs.peek() == Some(&'"') => fields.last_mut().unwrap().push(signs.next().unwrap()),
                '"' => quoted = !quoted,
                ',' if !quoted => fields.push(String::new()),
                _ => fields.last_mut().unwrap().push(sign),
            }
        }
        fields
    };
    text.lines().map(field).collect()
}

#[test]
fn the_stability_table_reads_back_and_is_the_same_at_any_number_of_threads() {
    let mut plan = broken_plan(&|_, _, _| Vec::new());
    plan.columns = stability::columns(Objective::RELATIVE, false);
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let cells = pool(1).install(|| stability::run(&plan, &|_, _| {}));
    assert_eq!(cells, pool(3).install(|| stability::run(&plan, &|_, _| {})));
    let directory = tempfile::tempdir().unwrap();
    stability::write(directory.path(), &plan, &cells).unwrap();
    let table = parse(&std::fs::read_to_string(directory.path().join("stability.csv")).unwrap());
    assert_eq!(table[0], stability::COLUMNS);
    assert_eq!(table.len(), 1 + cells.len() * plan.columns.len());
    let value = |row: usize, name: &str| table[row][table[0].iter().position(|column| column == name).unwrap()].clone();
    assert_eq!(value(1, "regime"), "undisturbed wood");
    assert_eq!(value(1, "relight_median_pct").parse::<f64>().unwrap(), 100.0 * cells[0][0].relight);
    assert_eq!(value(1, "failure_rate").parse::<f64>().unwrap(), cells[0][0].failures);
    for chart in ["stability-relight", "stability-failures"] {
        check_chart(directory.path(), chart);
    }
}

#[test]
fn the_speed_table_holds_every_fit_with_its_seed() {
    let scenes = vec![("a, \"quoted\" ball".to_owned(), Scene { points: 150, ..Scene::wood() })];
    let photographs = speed::Photographs {
        name: "photographs".to_owned(),
        observations: small().generate(9).observations,
        materials: 2,
    };
    let plan = speed::Plan { scenes, seeds: 2, subsets: &SUBSETS, to_the_end: false, photographs: Some(photographs) };
    let measured = speed::run(&plan, &mut |done, total| assert!(done <= total)).unwrap();
    let directory = tempfile::tempdir().unwrap();
    speed::write(directory.path(), &measured).unwrap();
    let table = parse(&std::fs::read_to_string(directory.path().join("speed.csv")).unwrap());
    assert_eq!(table[0], speed::COLUMNS);
    assert_eq!(table.len(), 1 + measured.len());
    for (row, one) in table[1..].iter().zip(&measured) {
        assert_eq!(row.len(), speed::COLUMNS.len());
        assert_eq!(row[0], one.scene);
        assert_eq!(row[2].parse().ok(), one.seed);
        assert_eq!(row[3].parse().ok(), one.left_out);
        assert_eq!(row[8].parse::<f64>().unwrap(), one.cpu_s);
        assert_eq!(row[10].parse::<f64>().unwrap(), 100.0 * one.outcome.unseen_error());
        assert!(one.cpu_s > 0.0, "{row:?}");
        // Comparators may be poor, as absolute residuals may in the dark; the project's own solver may not.
        if row[4] == "varpro" && !row[5].starts_with("absolute") {
            assert!(one.outcome.unseen_error() < 0.1, "{row:?}");
        }
    }
    assert_eq!(measured.iter().filter_map(|one| one.seed).collect::<HashSet<_>>().len(), 2);
    assert_eq!(measured.iter().filter_map(|one| one.left_out).collect::<HashSet<_>>().len(), 4);
    check_chart(directory.path(), "speed");
}

/// The SVG is text-free (it needs no font), and the PNG is a picture of it with ink on white.
fn check_chart(directory: &std::path::Path, stem: &str) {
    let svg = std::fs::read_to_string(directory.join(format!("{stem}.svg"))).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("aria-label=\"") && !svg.contains("<text"));
    let png = image::open(directory.join(format!("{stem}.png"))).unwrap().to_luma8();
    let dark = png.pixels().filter(|pixel| pixel.0[0] < 100).count();
    assert!(dark > 2000, "{stem}.png has {dark} dark pixels");
    assert_eq!(png.get_pixel(0, 0).0[0], 255);
}
