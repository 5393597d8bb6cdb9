//! Response recovery and merge against brackets in closed form: the camera here is written for the test alone.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rand_distr::{Distribution, StandardNormal};
use rigd::numerics::image::Image;
use rigd::numerics::radiometry::bracket::{Bracket, BracketError, Exposure};
use rigd::numerics::radiometry::merge::merge;
use rigd::numerics::radiometry::noise::SensorNoise;
use rigd::numerics::radiometry::response::{REFERENCE_LEVEL, Recovered, Response, recover};

const NOISE: SensorNoise = SensorNoise { full_well_e: 80_000.0, read_noise_e: 30.0 };
/// At level 10 the signal is 160 e-: 30 e- of read noise blur the curve there by more than the 1 % asked for, 8 e- do not.
const QUIET: SensorNoise = SensorNoise { full_well_e: 80_000.0, read_noise_e: 8.0 };
const ROUNDING: [f64; 3] = [1.0 / 12.0; 3];
/// A bracket of 1.17 EV steps like the paper's, true times.
const TIMES: [f64; 10] = [0.0098, 0.0248, 0.0496, 0.125, 0.25, 0.63, 1.26, 3.17, 6.35, 16.0];

/// The power of each channel's tone curve; all have a straight toe, as sRGB has, by an offset of 0.055.
const POWER: [f64; 3] = [2.4, 2.2, 2.0];
const TOE: f64 = 0.055;

/// Charge (1 = full well) that gives a level.
fn charge(level: f64, channel: usize) -> f64 {
    let power = |v: f64| v.powf(POWER[channel]);
    (power(level / 255.0 + TOE) - power(TOE)) / (power(1.0 + TOE) - power(TOE))
}

fn level(charge: f64, channel: usize) -> f64 {
    let power = |v: f64| v.powf(POWER[channel]);
    let lifted = charge.clamp(0.0, 1.0) * (power(1.0 + TOE) - power(TOE)) + power(TOE);
    255.0 * (lifted.powf(1.0 / POWER[channel]) - TOE)
}

/// Truth: exposure of a level in units of the reference level's.
fn exposure(level: f64, channel: usize) -> f64 {
    charge(level, channel) / charge(REFERENCE_LEVEL as f64, channel)
}

fn true_response() -> Response {
    // Level 0 stands for everything that rounds to it; half a level is its middle.
    let curve = |c| (0..256).map(|z| exposure((z as f64).max(0.5), c).ln()).collect();
    Response { log_exposure: [curve(0), curve(1), curve(2)] }
}

const SIZE: (usize, usize) = (240, 160);

/// Log-uniform over 2500 : 1 from left to right, hue changing from top to bottom.
fn radiance(x: usize, y: usize, channel: usize) -> f64 {
    let tint = 1.0 + 0.5 * (y as f64 / SIZE.1 as f64 * 3.0 + channel as f64).sin();
    0.02 * 2500_f64.powf(x as f64 / SIZE.0 as f64) * tint
}

fn shoot(times: &[f64], noise: SensorNoise, seed: u64) -> Vec<Exposure> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let frame = |(number, &time_s): (usize, &f64)| {
        let mut pixels = Vec::with_capacity(SIZE.0 * SIZE.1);
        for y in 0..SIZE.1 {
            for x in 0..SIZE.0 {
                pixels.push(std::array::from_fn(|c| {
                    let mean = noise.full_well_e * radiance(x, y, c) * time_s * charge(REFERENCE_LEVEL as f64, c);
                    let normal: f64 = StandardNormal.sample(&mut rng);
                    let electrons = mean + normal * (mean + noise.read_noise_e.powi(2)).sqrt();
                    level(electrons / noise.full_well_e, c).round() as u8
                }));
            }
        }
        Exposure { name: format!("frame {number}"), levels: Image { width: SIZE.0, height: SIZE.1, pixels }, time_s }
    };
    times.iter().enumerate().map(frame).collect()
}

fn recovered(noise: SensorNoise, seed: u64) -> (Bracket, Recovered) {
    let bracket = Bracket::new(shoot(&TIMES, noise, seed), ROUNDING).unwrap();
    let recovered = recover(&bracket).unwrap();
    (bracket, recovered)
}

#[test]
fn response_is_recovered_within_one_percent_and_never_falls() {
    for seed in 0..3 {
        let (_, found) = recovered(QUIET, seed);
        for (c, curve) in found.response.log_exposure.iter().enumerate() {
            assert_eq!(curve[REFERENCE_LEVEL], 0.0);
            assert!(curve.windows(2).all(|step| step[0] <= step[1]));
            let worst = (10..=245)
                .map(|z| (z, curve[z].exp() / exposure(z as f64, c) - 1.0))
                .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
                .unwrap();
            println!(
                "seed {seed} channel {c}: worst {worst:?}, {} active, {} pixels",
                found.active_constraints[c], found.pixels
            );
            assert!(worst.1.abs() < 0.01, "channel {c}, level {}: {:+.2} %", worst.0, 100.0 * worst.1);
            assert!(found.active_constraints[c] < 10);
        }
    }
}

#[test]
fn a_curve_that_falls_is_held_up_by_the_monotony_constraints_and_says_so() {
    // A camera whose tone curve folds back: levels 90 to 109 come out in reverse order.
    let mut frames = shoot(&TIMES, NOISE, 4);
    for level in frames.iter_mut().flat_map(|frame| frame.levels.pixels.as_flattened_mut()) {
        if (90..110).contains(level) {
            *level = 199 - *level;
        }
    }
    let found = recover(&Bracket::new(frames, ROUNDING).unwrap()).unwrap();
    println!("{:?} constraints active", found.active_constraints);
    assert!(found.active_constraints.iter().all(|&active| active > 0));
    assert!(found.response.log_exposure.iter().all(|curve| curve.windows(2).all(|step| step[0] <= step[1])));
}

/// Mean and variance of (estimate - truth) / sigma and relative bias over valid pixels of channel `c`.
fn pulls(bracket: &Bracket, response: &Response, c: usize) -> (f64, f64, f64) {
    let merged = merge(bracket, response, &NOISE);
    let variance = merged.variance.unwrap();
    let (mut n, mut sum, mut squares, mut bias) = (0.0, 0.0, 0.0, 0.0);
    for y in 0..SIZE.1 {
        for x in 0..SIZE.0 {
            if *merged.valid.at(x, y) {
                let error = f64::from(merged.radiance.at(x, y)[c]) - radiance(x, y, c);
                let pull = error / f64::from(variance.at(x, y)[c]).sqrt();
                n += 1.0;
                sum += pull;
                squares += pull * pull;
                bias += error / radiance(x, y, c);
            }
        }
    }
    assert!(n > 0.9 * (SIZE.0 * SIZE.1) as f64, "only {n} pixels are valid");
    (sum / n, squares / n - (sum / n).powi(2), bias / n)
}

#[test]
fn merged_variance_is_the_variance_of_the_error() {
    let bracket = Bracket::new(shoot(&TIMES, NOISE, 11), ROUNDING).unwrap();
    for c in 0..3 {
        let (mean, variance, bias) = pulls(&bracket, &true_response(), c);
        println!("true response, channel {c}: mean {mean:.3}, variance {variance:.3}, bias {:.4} %", 100.0 * bias);
        assert!((0.9..1.1).contains(&variance), "channel {c}: variance of the pull is {variance}");
        assert!(mean.abs() < 0.1, "channel {c}: mean pull is {mean}");
        assert!(bias.abs() < 1e-3, "channel {c}: bias is {bias}");
    }
}

#[test]
fn merge_through_the_recovered_response_is_unbiased() {
    let (bracket, found) = recovered(NOISE, 5);
    for c in 0..3 {
        let (mean, variance, bias) = pulls(&bracket, &found.response, c);
        println!("recovered response, channel {c}: mean {mean:.3}, variance {variance:.3}, bias {:.4} %", 100.0 * bias);
        assert!(bias.abs() < 3e-3, "channel {c}: bias is {bias}");
        assert!(variance < 1.5, "channel {c}: variance of the pull is {variance}");
    }
}

#[test]
fn merge_does_not_depend_on_the_number_of_threads() {
    let bracket = Bracket::new(shoot(&TIMES[3..8], NOISE, 3), ROUNDING).unwrap();
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| merge(&bracket, &true_response(), &NOISE))
    };
    let (one, three) = (run(1), run(3));
    assert_eq!(one.radiance, three.radiance);
    assert_eq!(one.variance, three.variance);
    assert_eq!(one.valid, three.valid);
}

#[test]
fn clipped_and_dark_pixels_are_not_valid() {
    let frame = |level, time_s| Exposure { name: String::new(), levels: Image::filled(2, 1, [level; 3]), time_s };
    for level in [0, 3, 255] {
        let bracket = Bracket::new(vec![frame(level, 0.1), frame(level, 1.0)], ROUNDING).unwrap();
        let merged = merge(&bracket, &true_response(), &NOISE);
        assert_eq!(merged.valid.pixels, [false, false], "level {level}");
        let numbers = merged.radiance.pixels.iter().chain(&merged.variance.as_ref().unwrap().pixels).flatten();
        assert!(numbers.into_iter().all(|v| v.is_finite() && *v >= 0.0));
    }
}

#[test]
fn unusable_brackets_are_refused_with_the_reason() {
    let frames = shoot(&TIMES, NOISE, 1);
    let error = |frames: Vec<Exposure>| recover(&Bracket::new(frames, ROUNDING).unwrap()).unwrap_err();
    assert_eq!(error(frames[..2].to_vec()), BracketError::TooFewFrames { found: 2, needed: 3 });

    let mut same = frames.clone();
    same[4].time_s = same[3].time_s;
    assert!(matches!(error(same), BracketError::SameTime { .. }));

    let mut swapped = frames.clone();
    (swapped[4].time_s, swapped[7].time_s) = (swapped[7].time_s, swapped[4].time_s);
    let message = error(swapped).to_string();
    assert!(
        message.contains("frame 4 and frame 7 seem to be exchanged") || message.contains("frame 7 and frame 4 seem"),
        "{message}"
    );
    assert!(message.contains("contradict"), "{message}");

    let mut inverse = frames.clone();
    inverse.iter_mut().for_each(|frame| frame.time_s = 1.0 / frame.time_s);
    let message = error(inverse).to_string();
    assert!(message.contains("the list seems to hold 1/seconds"), "{message}");

    let mut twice = frames.clone();
    twice[6].levels = twice[5].levels.clone();
    assert_eq!(error(twice), BracketError::SamePicture { a: "frame 5".into(), b: "frame 6".into() });

    for (level, what) in [(0, "every frame is black"), (255, "every frame is clipped")] {
        let mut flat = frames[..3].to_vec();
        flat.iter_mut().for_each(|frame| frame.levels.pixels.fill([level; 3]));
        let message = error(flat).to_string();
        assert!(message.contains(what) && message.contains("frame "), "{message}");
    }
    let mut dim = frames[..3].to_vec();
    dim.iter_mut().flat_map(|frame| frame.levels.pixels.as_flattened_mut()).for_each(|level| *level /= 3);
    let message = error(dim).to_string();
    assert!(message.contains("red: ") && message.contains("levels 5 to") && message.contains("level 128"), "{message}");
}
