//! Normals refined as well (after Goldman, Curless, Hertzmann, Seitz, "Shape and spatially-varying BRDFs from photometric
//! stereo", ICCV 2005): BRDF parameters and weights by variable projection, and the normal of every point, in turn.
//!
//! Kept: the alternation, for real shapes deviate from the given one. Changed: the shape is known but for a few degrees, so
//! that Gauss-Newton from the given normal takes the place of the search over a virtual sphere; the BRDF parameters come
//! from a stratified part of the points and the normals of the others follow once; weights are eliminated in both.
//!
//! Added: lights that lie in one plane with the camera, as those of an arm do, leave one tilt of a diffuse point to be
//! traded against its weight, and few samples leave the other noisy. So tilts are held to the given normal by a normal
//! prior, whose variance all points settle together (expectation maximisation, Dempster, Laird, Rubin 1977): where the shape
//! is exact it shrinks, and normals hardly move.

use super::CHUNK;
use super::directions::{Tilt, degrees};
use super::levmar::Stop;
use super::loss::Loss;
use super::observations::{Observations, Sample};
use super::prepared::{Prepared, Recipe};
use super::sampling::stratified;
use super::solver::{Iterate, OnIteration, Refusal, Solution, Solver, Task};
use super::varpro::{AlphaFit, COARSE, degrees_of_freedom, finish, fit_alpha, recipe, search};
use crate::numerics::brdf::Material;
use point::{Pull, Refinement, Turn};
use rayon::prelude::*;

mod point;

/// Most alternations, and the change of cost and of the deviation of the shape, relative, below which they end.
const ROUNDS: (usize, f64) = (25, 3e-3);

/// A shape that deviates by less, standard deviation of a tilt (0.1 degrees), counts as exact.
const EXACT: f64 = 0.00175;

/// Standard deviation of a tilt that the first round supposes (2 degrees).
const FIRST_DEVIATION: f64 = 0.035;

/// When the search of a round stops.
const STOP: Stop = Stop { relative_decrease: 1e-5, iterations: 20 };

/// Variable projection with normals of its own.
pub struct Normals;

impl Solver for Normals {
    fn name(&self) -> &'static str {
        "normals"
    }

    fn needs_azimuths(&self) -> bool {
        true
    }

    fn solve(&self, observations: &Observations, task: &Task, progress: OnIteration<'_>) -> Result<Solution, Refusal> {
        if !observations.has_azimuths() {
            return Err(Refusal::NoAzimuths { solver: self.name() });
        }
        let recipe = recipe(task, observations);
        let some = observations.select(&stratified(observations, task.materials, COARSE.1));
        let mut alpha = fit_alpha(&some, task, &recipe, progress);
        let pull = alternate(&some, task, &recipe, &mut alpha, progress);
        let given = vec![[0.0; 2]; observations.points()];
        let turns = refine(observations, &recipe, &alpha.found.materials, pull, &given);
        let tilts: Vec<Tilt> = turns.into_iter().map(|turn| turn.tilt).collect();
        alpha.notes.push(moved(&tilts));
        Ok(Solution { tilts: Some(tilts.clone()), ..finish(&observations.turned(&tilts), &recipe, alpha) })
    }
}

/// How far the normals moved.
fn moved(tilts: &[Tilt]) -> String {
    let mut angles: Vec<f64> = tilts.iter().map(|&tilt| degrees(tilt)).collect();
    angles.sort_by(f64::total_cmp);
    let at = |index: usize| angles.get(index).copied().unwrap_or(0.0);
    let (median, most) = (at(angles.len() / 2), at(angles.len().saturating_sub(1)));
    format!("normals turned by {median:.2} degrees in the median, {most:.2} at most")
}

/// Normals, then BRDF parameters, in turn, until nothing more is gained.
fn alternate(
    observations: &Observations,
    task: &Task,
    recipe: &Recipe<'_>,
    alpha: &mut AlphaFit,
    progress: OnIteration<'_>,
) -> Pull {
    let freedom = degrees_of_freedom(observations, task.materials);
    let mut tilts = vec![[0.0; 2]; observations.points()];
    let mut iterations = alpha.found.iterations;
    let mut variance = FIRST_DEVIATION * FIRST_DEVIATION;
    let unit2 = Prepared::empty(recipe).unit2;
    let mut pull = pull_of(alpha.found.cost * unit2 / freedom, variance);
    alpha.found.converged = false;
    for _ in 0..ROUNDS.0 {
        if alpha.cancelled || alpha.found.converged {
            break;
        }
        let turns = refine(observations, recipe, &alpha.found.materials, pull, &tilts);
        tilts = turns.iter().map(|turn| turn.tilt).collect();
        let prepared = Prepared::new(&observations.turned(&tilts), recipe);
        let before = (alpha.found.cost, variance.sqrt());
        alpha.found = search(&prepared, &alpha.found.materials, task.colour, alpha.sign, STOP);
        iterations += alpha.found.iterations;
        let at = Iterate::new(iterations, alpha.found.cost * unit2, observations, &alpha.found.materials);
        alpha.cancelled = progress(at).is_break();
        variance = variance_of(&turns).unwrap_or(variance);
        pull = pull_of(alpha.found.cost * unit2 / freedom, variance);
        let near = |now: f64, before: f64| (now - before).abs() <= ROUNDS.1 * before;
        let settled = variance.sqrt() < EXACT || near(variance.sqrt(), before.1);
        alpha.found.converged = near(alpha.found.cost, before.0) && settled;
    }
    alpha.found.iterations = iterations;
    pull
}

fn pull_of(residual: f64, variance: f64) -> Pull {
    Pull { strength: residual / variance.max(f64::MIN_POSITIVE), residual }
}

/// Variance of a tilt by all points that have a say; none where no point has.
fn variance_of(turns: &[Turn]) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for turn in turns {
        if let Some(uncertainty) = turn.uncertainty {
            sum += turn.tilt[0].powi(2) + turn.tilt[1].powi(2) + uncertainty;
            count += 2.0;
        }
    }
    (count > 0.0).then(|| sum / count)
}

/// Refined tilts of all points.
fn refine(
    observations: &Observations,
    recipe: &Recipe<'_>,
    materials: &[Material],
    pull: Pull,
    from: &[Tilt],
) -> Vec<Turn> {
    let loss = Loss::new(recipe.lobe, recipe.objective, recipe.brightness);
    let of_point = |(point, &tilt): (usize, &Tilt)| {
        let azimuth = |sample: &Sample| observations.azimuth_of(point, sample.light).unwrap_or(0.0);
        let samples = observations.of(point).map(|sample| (sample, azimuth(&sample))).collect();
        Refinement { recipe, materials, loss, pull, samples }.best(tilt)
    };
    from.par_iter().enumerate().with_min_len(CHUNK).map(of_point).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::numerics::brdf::ward::Ward;
    use crate::numerics::fit::directions::{azimuth, x_axis};
    use crate::numerics::fit::objective::Objective;
    use crate::numerics::fit::observations::tests::{noisy, synthetic};
    use crate::numerics::fit::predict;
    use crate::numerics::fit::solver::tests::{go_on, task};
    use crate::numerics::geometry::{Angles, Vec3};
    use rand::{RngExt, SeedableRng, rngs::StdRng};

    /// A ball given as smooth whose true normals are turned by `degrees` to random sides, under nine lights from all sides;
    /// and, per point, given normal, view and true normal.
    fn rough_ball(points: usize, degrees: f64) -> (Observations, Vec<[Vec3; 3]>) {
        let (_, truth) = synthetic(1, 2, 51);
        let mut rng = StdRng::seed_from_u64(51);
        let (mut observations, mut normals, view) = (Observations::new(9), Vec::new(), -Vec3::z());
        let lights: Vec<Vec3> = (0..9)
            .map(|k| {
                let (around, away) = (f64::from(k) * 2.4, 0.25 + 0.08 * f64::from(k));
                Vec3::new(away.sin() * around.cos(), away.sin() * around.sin(), -away.cos())
            })
            .collect();
        while observations.points() < points {
            let (x, y): (f64, f64) = (rng.random_range(-0.8..0.8), rng.random_range(-0.8..0.8));
            if x * x + y * y > 0.7 {
                continue;
            }
            let given = Vec3::new(x, y, -(1.0 - x * x - y * y).sqrt());
            let side = given.cross(&Vec3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), 0.3));
            let turned = (given + side.normalize() * degrees.to_radians().tan()).normalize();
            let first = rng.random_range(0.0..1.0);
            let mut samples = Vec::new();
            for (light, direction) in lights.iter().enumerate() {
                let (angles, about) = (Angles::new(&given, direction, &view), Angles::new(&turned, direction, &view));
                if angles.cos_i < 0.15 || angles.cos_r < 0.15 || about.cos_i < 0.05 || about.cos_r < 0.05 {
                    continue;
                }
                let at = |angles: Angles| {
                    let irradiance = [3.0 * angles.cos_i; 3];
                    Sample { light, angles, irradiance, radiance: [0.0; 3], variance: [0.0; 3] }
                };
                let radiance = predict(&Ward, &truth.materials, &[first, 1.0 - first], &at(about));
                samples.push(Sample { radiance, ..at(angles) });
            }
            if samples.len() >= 4 {
                observations.push(observations.points(), &samples);
                normals.push([given, view, turned]);
            }
        }
        observations.set_azimuths(|point, sample| azimuth(&normals[point][0], &lights[sample.light], &view));
        (observations, normals)
    }

    /// Median angle between the refined and the true normals, degrees.
    fn median_error(tilts: &[Tilt], normals: &[[Vec3; 3]]) -> f64 {
        let error = |(tilt, [given, view, turned]): (&Tilt, &[Vec3; 3])| {
            let x = x_axis(given, view);
            let found = given + x * tilt[0] + given.cross(&x) * tilt[1];
            found.angle(turned).to_degrees()
        };
        let mut errors: Vec<f64> = tilts.iter().zip(normals).map(error).collect();
        errors.sort_by(f64::total_cmp);
        errors[errors.len() / 2]
    }

    #[test]
    fn recovers_normals_turned_by_two_degrees() {
        let (exact, normals) = rough_ball(800, 2.0);
        for (noise, most) in [(0.0, 0.2), (0.02, 0.9)] {
            let observations = if noise > 0.0 { noisy(&exact, noise, 52) } else { exact.clone() };
            let solution = Normals.solve(&observations, &task(2, Objective::NOISE), &mut go_on).unwrap();
            let error = median_error(&solution.tilts.unwrap(), &normals);
            assert!(error < most, "noise {noise}: {error} degrees instead of 2 without a refinement");
            assert!(solution.notes.iter().any(|note| note.starts_with("normals turned by")), "{:?}", solution.notes);
        }
    }

    #[test]
    fn leaves_exact_normals_alone() {
        let (exact, normals) = rough_ball(800, 0.0);
        for noise in [0.0, 0.02] {
            let observations = if noise > 0.0 { noisy(&exact, noise, 53) } else { exact.clone() };
            let solution = Normals.solve(&observations, &task(2, Objective::NOISE_CAUCHY), &mut go_on).unwrap();
            let error = median_error(&solution.tilts.unwrap(), &normals);
            assert!(error < 0.15, "noise {noise}: normals moved by {error} degrees in the median");
        }
    }

    #[test]
    fn refuses_observations_without_azimuths() {
        let (with, _) = synthetic(30, 1, 54);
        let mut without = Observations::new(with.lights);
        for point in 0..with.points() {
            without.push(point, &with.of(point).collect::<Vec<_>>());
        }
        let refusal = Normals.solve(&without, &task(1, Objective::NOISE), &mut go_on).unwrap_err();
        assert_eq!(refusal, Refusal::NoAzimuths { solver: "normals" });
    }
}
