//! Results are the same to the bit at any number of threads.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

use rand::{RngExt, SeedableRng, rngs::StdRng};
use rigd::numerics::brdf::{Material, ward::Ward};
use rigd::numerics::fit::objective::Objective;
use rigd::numerics::fit::observations::{Observations, Sample};
use rigd::numerics::fit::predict;
use rigd::numerics::fit::solver::{Iterate, SOLVERS, Solution, Task};
use rigd::numerics::fit::unknowns::Colour;
use rigd::numerics::fit::weights::WeightRule;
use rigd::numerics::geometry::{Angles, Vec3};
use rigd::pipeline::fit::{FitOptions, FitProgress, FitStep};
use rigd::pipeline::judged::fit_observations;
use std::ops::ControlFlow;

/// Points of a ball mixed of two materials, 2 % noise: four chunks of points, for two can be summed in one order only.
fn ball(points: usize) -> Observations {
    let mut rng = StdRng::seed_from_u64(31);
    let materials = [
        Material { rho_d: [0.6, 0.5, 0.4], rho_s: [0.05, 0.06, 0.04], beta: 0.12 },
        Material { rho_d: [0.1, 0.2, 0.35], rho_s: [0.07, 0.05, 0.06], beta: 0.25 },
    ];
    let (mut all, mut azimuths, view) = (Observations::new(7), Vec::new(), -Vec3::z());
    while all.points() < points {
        let (x, y): (f64, f64) = (rng.random_range(-0.8..0.8), rng.random_range(-0.8..0.8));
        if x * x + y * y > 0.8 {
            continue;
        }
        let normal = Vec3::new(x, y, -(1.0 - x * x - y * y).sqrt());
        let first: f64 = rng.random_range(0.0..1.0);
        let (mut samples, mut about) = (Vec::new(), [0.0; 7]);
        for light in 0..7 {
            let station = (-60.0 + 20.0 * light as f64).to_radians();
            let direction = Vec3::new(station.sin(), 0.1, -station.cos()).normalize();
            let angles = Angles::new(&normal, &direction, &view);
            about[light] = rigd::numerics::fit::directions::azimuth(&normal, &direction, &view);
            if angles.cos_i > 0.1 && angles.cos_r > 0.1 {
                let irradiance = [3.0, 2.8, 2.5].map(|l| l * angles.cos_i);
                let sample = Sample { light, angles, irradiance, radiance: [0.0; 3], variance: [0.0; 3] };
                let exact = predict(&Ward, &materials, &[first, 1.0 - first], &sample);
                let radiance = exact.map(|i| i * (1.0 + 0.07 * rng.random_range(-0.5..0.5)));
                samples.push(Sample { radiance, ..sample });
            }
        }
        if samples.len() >= 4 {
            all.push(azimuths.len(), &samples);
            azimuths.push(about);
        }
    }
    all.set_azimuths(|point, sample| azimuths[point][sample.light]);
    all
}

fn bits(solution: &Solution) -> Vec<u64> {
    let mixture = &solution.mixture;
    let of = |m: &Material| m.rho_d.into_iter().chain(m.rho_s).chain([m.beta]).collect::<Vec<f64>>();
    let tilts = solution.tilts.iter().flatten().flatten().copied();
    let all = mixture.materials.iter().flat_map(of).chain(mixture.gamma.iter().copied()).chain(tilts);
    all.chain([solution.cost, solution.iterations as f64]).map(f64::to_bits).collect()
}

#[test]
fn one_two_or_three_threads() {
    let observations = ball(800);
    for solver in SOLVERS {
        for objective in [Objective::NOISE_CAUCHY, Objective::ABSOLUTE] {
            let task = Task { lobe: &Ward, objective, materials: 2, colour: Colour::Coloured, rule: WeightRule::Exact };
            let run = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let go_on = &mut |_: Iterate<'_>| ControlFlow::Continue(());
                let solution = pool.install(|| solver.solve(&observations, &task, go_on).unwrap());
                bits(&solution)
            };
            let one = run(1);
            for threads in [2, 3] {
                assert!(run(threads) == one, "{} {} at {threads} threads", solver.name(), objective.name());
            }
        }
    }
}

/// Who asks for everything a fit can tell, maps of every iteration included, gets the same fit as who hears of nothing.
#[test]
fn whether_anybody_looks_on_or_not() {
    let observations = ball(400);
    for solver in SOLVERS {
        let options = FitOptions {
            solver: solver.name().to_owned(),
            materials: Some(2),
            model: "ward".to_owned(),
            lobe: "coloured".to_owned(),
            gains: "off".to_owned(),
            ..FitOptions::default()
        };
        let alone = fit_observations(&observations, &options, &mut |_| ControlFlow::Continue(())).unwrap();
        let (mut steps, mut numbers, mut maps, mut tried) = (Vec::new(), Vec::new(), 0, 0);
        let mut look = |event: FitProgress<'_>| {
            match event {
                FitProgress::Step(step) => steps.push(step),
                FitProgress::Tried(..) => tried += 1,
                FitProgress::Iteration(at, map_it) => {
                    assert!(at.cost.is_finite() && at.rms.is_finite() && at.points > 0);
                    numbers.push(at.iteration);
                    maps += usize::from(map_it(20).is_some());
                }
                FitProgress::Judged(_, map_it) => maps += usize::from(map_it(20).is_some()),
                FitProgress::Observed { .. } => panic!("these observations were gathered here"),
            }
            ControlFlow::Continue(())
        };
        let watched = fit_observations(&observations, &options, &mut look).unwrap();
        let name = solver.name();
        assert!(bits(&alone.solution) == bits(&watched.solution), "{name}");
        assert_eq!((&alone.materials, &alone.warnings), (&watched.materials, &watched.warnings), "{name}");
        assert_eq!(alone.reduced_chi2.to_bits(), watched.reduced_chi2.to_bits(), "{name}");
        assert_eq!(steps, [FitStep::Choose, FitStep::Fit, FitStep::Uncertainty], "{name}");
        assert_eq!((maps, tried), (numbers.len() + 1, watched.candidates.len()), "{name}");
        assert!(numbers.is_sorted() && *numbers.last().unwrap() <= watched.solution.iterations, "{name}: {numbers:?}");
    }
}
