//! Accuracy of exposure ratios and response curves on simulated EOS 5D brackets. The long form, over 8 seeds, prints the table of
//! docs/calibrate-response.md: `cargo test --release --test response_accuracy -- --ignored --nocapture`.
#![allow(clippy::unwrap_used)]

mod response_camera;

use response_camera::{COUNTS, FULL_WELL_E, READ_NOISE_E, Shoot, Shot, THIRDS, TONES, Tone};
use rigd::numerics::radiometry::bracket::Bracket;
use rigd::numerics::radiometry::noise::SensorNoise;
use rigd::numerics::radiometry::response::{REFERENCE_LEVEL, Response, recover};
use rigd::numerics::radiometry::robertson::robertson;
use rigd::numerics::radiometry::times::{LinearSamples, MeasuredTimes};

const NOISE: SensorNoise = SensorNoise { full_well_e: FULL_WELL_E, read_noise_e: READ_NOISE_E };

/// Relative error of every time, both sets scaled to agree at the reference.
fn errors(measured: &MeasuredTimes, truth: &[f64]) -> Vec<f64> {
    let reference = measured.reference;
    let ratio = |i: usize| measured.frames[i].time_s / measured.frames[reference].time_s * truth[reference] / truth[i];
    (0..truth.len()).map(|i| ratio(i) - 1.0).collect()
}

fn worst(errors: &[f64]) -> f64 {
    errors.iter().fold(0.0, |a, e| a.max(e.abs()))
}

/// Squares of error over standard error.
fn pulls(measured: &MeasuredTimes, truth: &[f64]) -> Vec<f64> {
    let errors = errors(measured, truth);
    let of = |i: usize| measured.frames[i].sigma.filter(|s| *s > 0.0).map(|s| (errors[i] / s).powi(2));
    (0..truth.len()).filter_map(of).collect()
}

/// Greatest relative error of a response over levels `range(channel)`.
fn curve_error(response: &Response, tone: Tone, lowest: impl Fn(usize) -> usize, highest: usize) -> f64 {
    let error = |c: usize, z: usize| {
        let truth = tone.charge(z as f64, c) / tone.charge(REFERENCE_LEVEL as f64, c);
        (response.log_exposure[c][z].exp() / truth - 1.0).abs()
    };
    (0..3).flat_map(|c| (lowest(c)..=highest).map(move |z| (c, z))).map(|(c, z)| error(c, z)).fold(0.0, f64::max)
}

fn with_times(bracket: &Bracket, measured: &MeasuredTimes) -> Bracket {
    bracket.clone().with_times(&measured.seconds()).unwrap()
}

/// What one bracket gives.
struct Trial {
    linear: MeasuredTimes,
    unknown: MeasuredTimes,
    known: MeasuredTimes,
    debevec: f64,
    robertson: f64,
    debevec_all: f64,
    robertson_all: f64,
    truth: Vec<f64>,
}

fn trial(shot: &Shot, tone: Tone) -> Trial {
    let aimed: Vec<f64> = THIRDS.iter().map(|k| 2_f64.powf(f64::from(*k) / 3.0)).collect();
    let linear = MeasuredTimes::linear(&LinearSamples { signals: shot.linear() }, &aimed, &NOISE, None).unwrap();
    let bracket = shot.bracket(tone);
    let unknown = MeasuredTimes::without_response(&bracket, &aimed).unwrap();
    let timed = with_times(&bracket, &unknown);
    let debevec = recover(&timed).unwrap().response;
    let robertson = robertson(&timed).unwrap().response;
    let known = MeasuredTimes::with_response(&bracket, &aimed, (&debevec, unknown.exponent_sigma), None).unwrap();
    let used = |response: &Response| curve_error(response, tone, |c| tone.lowest_used(c), 245);
    let all = |response: &Response| curve_error(response, tone, |_| 10, 245);
    Trial {
        linear,
        unknown,
        known,
        debevec: used(&debevec),
        robertson: used(&robertson),
        debevec_all: all(&debevec),
        robertson_all: all(&robertson),
        truth: shot.times_s.clone(),
    }
}

/// Error of the curve over the used range if the camera counts sixteen times finer: then what a count spans of the dark levels does
/// not bend the curve.
fn fine_curve(shoot: &Shoot, tone: Tone) -> f64 {
    let fine = Shoot { counts: 16.0 * COUNTS, times_s: shoot.times_s.clone(), ..*shoot };
    let bracket = fine.shot().bracket(tone);
    let measured = MeasuredTimes::without_response(&bracket, &bracket.times_s()).unwrap();
    let found = recover(&bracket.with_times(&measured.seconds()).unwrap()).unwrap();
    curve_error(&found.response, tone, |c| tone.lowest_used(c), 245)
}

fn table(seeds: u64, jitter: f64) {
    println!(
        "\nshutter scatter {} %, {seeds} seeds, % (ratios: rms / greatest over frames; curves: greatest over levels)\n",
        100.0 * jitter
    );
    println!(
        "| curve | used from | linear | 8 bit, curve just measured | 8 bit, curve unknown | pulls | Debevec used, used with 16 bits, 10-245 | Robertson used, 10-245 |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for tone in TONES {
        let shoot = |seed| Shoot { jitter, size: (480, 320), ..Shoot::new(seed) };
        let trials: Vec<Trial> = (0..seeds).map(|seed| trial(&shoot(seed).shot(), tone)).collect();
        let fine = (0..seeds).map(|seed| fine_curve(&shoot(seed), tone)).fold(0.0, f64::max);
        let max = |f: &dyn Fn(&Trial) -> f64| 100.0 * trials.iter().map(f).fold(0.0, f64::max);
        let rms = |f: &dyn Fn(&Trial) -> Vec<f64>| {
            let all: Vec<f64> = trials.iter().flat_map(f).collect();
            (all.iter().sum::<f64>() / all.len() as f64).sqrt()
        };
        let ratios = |of: &dyn Fn(&Trial) -> &MeasuredTimes| {
            let squares = |t: &Trial| errors(of(t), &t.truth).iter().map(|e| e * e).collect();
            format!("{:.3} / {:.3}", 100.0 * rms(&squares), max(&|t| worst(&errors(of(t), &t.truth))))
        };
        println!(
            "| {tone:?} | {:?} | {} | {} | {} | {:.2} {:.2} {:.2} | {:.2}, {:.2}, {:.1} | {:.2}, {:.1} |",
            [0, 1, 2].map(|c| tone.lowest_used(c)),
            ratios(&|t| &t.linear),
            ratios(&|t| &t.known),
            ratios(&|t| &t.unknown),
            rms(&|t| pulls(&t.linear, &t.truth)),
            rms(&|t| pulls(&t.known, &t.truth)),
            rms(&|t| pulls(&t.unknown, &t.truth)),
            max(&|t| t.debevec),
            100.0 * fine,
            max(&|t| t.debevec_all),
            max(&|t| t.robertson),
            max(&|t| t.robertson_all),
        );
    }
}

#[test]
#[ignore = "minutes long, by hand: cargo test --release --test response_accuracy -- --ignored --nocapture prints the table of docs/calibrate-response.md"]
fn accuracy_over_seeds() {
    for jitter in [0.0, 0.003, 0.01] {
        table(8, jitter);
    }
}

/// The bars, on one bracket of each curve: ratios to 0.2 %, response within 1 % over the used range.
#[test]
fn ratios_are_right_to_two_parts_in_a_thousand_and_curves_to_one_percent() {
    for (seed, tone) in (100..).zip(TONES) {
        let found = trial(&Shoot::new(seed).shot(), tone);
        for (name, measured) in [("linear", &found.linear), ("known", &found.known), ("unknown", &found.unknown)] {
            let worst = worst(&errors(measured, &found.truth));
            assert!(worst < 0.002, "{tone:?}, {name}: {worst}");
        }
        assert!(found.debevec < 0.01, "{tone:?}: {}", found.debevec);
        // Robertson's is for comparison: it looks pixels up at their noisy levels.
        assert!(found.robertson < 0.04, "{tone:?}: {}", found.robertson);
    }
}

/// A count of the 12-bit camera spans half a level near level 30: what that does to mean levels must not come into the curve.
#[test]
fn no_curve_is_bent_by_the_counts_of_the_camera() {
    for (seed, tone) in [0, 5].into_iter().flat_map(|seed| TONES.map(|tone| (seed, tone))) {
        let bracket = Shoot { size: (480, 320), ..Shoot::new(seed) }.shot().bracket(tone);
        let error = curve_error(&recover(&bracket).unwrap().response, tone, |c| tone.lowest_used(c), 245);
        assert!(error < 0.01, "{tone:?}, seed {seed}: {error}");
    }
}

/// What images tell without the response: everything but one exponent.
#[test]
fn an_unsteady_shutter_leaves_nothing_but_the_exponent_unknown() {
    for seed in 0..3 {
        let shot = Shoot { jitter: 0.01, ..Shoot::new(seed) }.shot();
        let bracket = shot.bracket(Tone::SCurve);
        let measured = MeasuredTimes::without_response(&bracket, &bracket.times_s()).unwrap();
        let error = worst(&errors(&measured, &shot.times_s));
        let but_exponent = measured.scatter_about(&shot.times_s, true).unwrap();
        println!("seed {seed}: worst {error:.4}, rms but for one exponent {but_exponent:.5}");
        assert!(but_exponent < 0.001, "seed {seed}: {but_exponent}");
        assert!(error < 0.02 && measured.exponent_sigma > 5e-4, "seed {seed}: {error}, {}", measured.exponent_sigma);
        // Linear frames leave nothing open.
        let samples = LinearSamples { signals: shot.linear() };
        let linear = MeasuredTimes::linear(&samples, &bracket.times_s(), &NOISE, None).unwrap();
        let error = worst(&errors(&linear, &shot.times_s));
        assert!(error < 0.002, "seed {seed}: {error}");
    }
}
