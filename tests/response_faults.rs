//! Brackets that are no brackets: every fault is named with the frame and the remedy. The camera is the tests' own.
#![allow(clippy::unwrap_used, clippy::panic)]

mod response_camera;

use response_camera::{DIAL_S, Shoot, Tone};
use rigd::numerics::image::Image;
use rigd::numerics::radiometry::bracket::{Bracket, Exposure};
use rigd::pipeline::calibration::response::{Calibrated, Expected, Method, calibrate};

const ROUNDING: [f64; 3] = [1.0 / 12.0; 3];

/// A bracket listed with the times on the dial.
fn dial(seed: u64) -> Vec<Exposure> {
    let mut frames = Shoot::new(seed).shot().exposures(Tone::Srgb);
    frames.iter_mut().zip(DIAL_S).for_each(|(frame, time_s)| frame.time_s = time_s);
    frames
}

fn outcome(frames: Vec<Exposure>) -> Result<Calibrated, String> {
    calibrate(Bracket::new(frames, ROUNDING).map_err(|e| e.to_string())?, Method::Debevec).map_err(|e| e.to_string())
}

fn refusal(frames: Vec<Exposure>) -> String {
    outcome(frames).err().unwrap_or_else(|| panic!("the bracket was taken"))
}

fn warnings(frames: Vec<Exposure>) -> Vec<String> {
    outcome(frames).unwrap().calibration.warnings
}

/// The frame with every pixel taken from `source(x, y)`.
fn resample(frame: &mut Exposure, source: impl Fn(usize, usize) -> [u8; 3]) {
    let Image { width, height, .. } = frame.levels;
    let pixels = (0..width * height).map(|i| source(i % width, i / width)).collect();
    frame.levels = Image { width, height, pixels };
}

fn shifted(frame: &mut Exposure, dx: usize) {
    let old = frame.levels.clone();
    resample(frame, |x, y| *old.at(x.saturating_sub(dx), y));
}

fn blurred(frame: &mut Exposure, half: usize) {
    let old = frame.levels.clone();
    resample(frame, |x, y| {
        let range = |v: usize, size: usize| v.saturating_sub(half)..=(v + half).min(size - 1);
        let mut sum = [0_usize; 3];
        let mut count = 0;
        for j in range(y, old.height) {
            for i in range(x, old.width) {
                let pixel = old.at(i, j);
                (0..3).for_each(|c| sum[c] += usize::from(pixel[c]));
                count += 1;
            }
        }
        sum.map(|s| (s / count) as u8)
    });
}

#[test]
fn a_sound_bracket_is_taken_without_a_warning_and_the_dial_is_found_to_lie() {
    for seed in 0..3 {
        let found = outcome(dial(seed)).unwrap().calibration;
        assert_eq!(found.warnings, Vec::<String>::new());
        assert_eq!(found.expected, Expected::PowerOfTwo);
        let (nominal, thirds) = (found.scatter_nominal.unwrap(), found.scatter_power_of_two.unwrap());
        assert!(nominal > 0.01 && thirds < 0.001, "{nominal} {thirds}");
        let last = found.exposures.last().unwrap();
        assert_eq!((last.nominal_s, last.power_of_two_s), (15.0, Some(16.0)));
        assert!((last.estimated_s / 16.0 - 1.0).abs() < 0.002, "{}", last.estimated_s);
        assert!(found.exposures.iter().all(|time| !time.departs));
    }
}

#[test]
fn a_shutter_that_follows_its_dial_is_believed() {
    // Shot with exactly the times on the dial: the images say so, and the power-of-two times are put aside.
    let mut shot = Shoot::new(5);
    shot.times_s = Some(DIAL_S.to_vec());
    let mut frames = shot.shot().exposures(Tone::Srgb);
    frames.iter_mut().zip(DIAL_S).for_each(|(frame, time_s)| frame.time_s = time_s);
    let found = outcome(frames).unwrap().calibration;
    assert_eq!(found.expected, Expected::Nominal);
    for (time, dial) in found.exposures.iter().zip(DIAL_S) {
        assert!((time.estimated_s / dial - 1.0).abs() < 0.002, "{time:?}");
    }
}

#[test]
fn one_wrong_time_is_named_and_leaves_the_others_alone() {
    // The shutter stuck at 1/6 s: 10 % longer than it should be.
    let mut shot = Shoot::new(1);
    let mut times: Vec<f64> = response_camera::THIRDS.iter().map(|k| 2_f64.powf(f64::from(*k) / 3.0)).collect();
    times[3] *= 1.10;
    shot.times_s = Some(times.clone());
    let frames = shot.shot().exposures(Tone::SCurve);
    let found = outcome(frames).unwrap().calibration;
    let departing: Vec<usize> = (0..10).filter(|&i| found.exposures[i].departs).collect();
    assert_eq!(departing, [3]);
    assert!(found.warnings.iter().any(|w| w.contains("frame 3")), "{:?}", found.warnings);
    for (time, truth) in found.exposures.iter().zip(times) {
        assert!((time.estimated_s / truth - 1.0).abs() < 0.003, "{time:?} {truth}");
    }
}

#[test]
fn times_that_no_shutter_makes_are_refused_by_name() {
    // Listed as 0.4 s, shot with 0.2 s: still brighter than the shorter ones, so that only the ratios tell.
    let mut shot = Shoot::new(2);
    let mut times: Vec<f64> = response_camera::THIRDS.iter().map(|k| 2_f64.powf(f64::from(*k) / 3.0)).collect();
    times[4] *= 0.6;
    shot.times_s = Some(times);
    let message = refusal(shot.shot().exposures(Tone::Srgb));
    assert!(message.contains("frame 4 is listed as") && message.contains("the images say 0.23"), "{message}");
    assert!(!message.contains("frame 5"), "{message}");
}

/// Frames `which` of a sound bracket, one of them listed `off_ev` stops too long.
fn few(which: &[usize], wrong: usize, off_ev: f64) -> Vec<Exposure> {
    let mut frames = Shoot::new(2).shot().exposures(Tone::Srgb);
    frames[wrong].time_s *= off_ev.exp2();
    which.iter().map(|&i| frames[i].clone()).collect()
}

#[test]
fn a_few_frames_say_what_they_do_not_tell() {
    let found = outcome(few(&[5, 6, 7], 5, 0.0)).unwrap().calibration;
    let words = "not determined by these frames";
    assert!(found.gauge.contains(words) && found.gauge.contains("within 3 %"), "{}", found.gauge);
    assert!(found.warnings.iter().any(|w| w.contains(words)), "{:?}", found.warnings);
    // Times within 3 %, over ln 4: the shortest and the longest of them give the slope.
    assert!(
        (0.5..2.0).contains(&(found.exponent_sigma / (0.03 * 2_f64.sqrt() / 4_f64.ln()))),
        "{}",
        found.exponent_sigma
    );
    let found = outcome(dial(2)).unwrap().calibration;
    assert!(!found.gauge.contains(words) && found.exponent_sigma < 1e-3, "{}", found.gauge);
}

#[test]
fn one_wrong_time_of_a_few_is_refused() {
    for (wrong, off_ev) in [(5, 0.85), (7, 0.85), (7, -0.85)] {
        let message = refusal(few(&[5, 6, 7], wrong, off_ev));
        assert!(message.contains("3 frames do not tell which one is wrong"), "{message}");
        // A wrong middle one would explain the images as well.
        for frame in [6, wrong] {
            assert!(message.contains(&format!("frame {frame} is listed as")), "{wrong} {off_ev}: {message}");
        }
    }
    for (which, wrong, off_ev) in
        [(&[6, 7, 8, 9][..], 6, -0.6), (&[6, 7, 8, 9], 9, 0.6), (&[3, 5, 7, 9], 9, 0.85), (&[3, 5, 7, 9], 3, 0.6)]
    {
        let message = refusal(few(which, wrong, off_ev));
        let named: Vec<usize> = (0..10).filter(|i| message.contains(&format!("frame {i} is listed as"))).collect();
        assert_eq!(named, [wrong], "{message}");
        assert!(message.contains("correct these times or leave the frames out"), "{message}");
    }
}

#[test]
fn exchanged_files_inverse_times_and_repeated_pictures_are_told_apart() {
    let mut exchanged = dial(3);
    let (a, b) = (exchanged[5].time_s, exchanged[8].time_s);
    (exchanged[5].time_s, exchanged[8].time_s) = (b, a);
    let message = refusal(exchanged);
    let named = message.contains("frame 5") && message.contains("frame 8");
    assert!(named && message.contains("seem to be exchanged"), "{message}");

    let mut inverse = dial(3);
    inverse.iter_mut().for_each(|frame| frame.time_s = 1.0 / frame.time_s);
    assert!(refusal(inverse).contains("1/seconds"));

    let mut twice = dial(3);
    twice[6].levels = twice[5].levels.clone();
    let message = refusal(twice);
    assert!(message.contains("frame 5 and frame 6 are the same picture"), "{message}");
}

#[test]
fn frames_that_moved_or_blurred_are_named() {
    let mut moved = dial(4);
    shifted(&mut moved[6], 2);
    let found = warnings(moved);
    let said = |w: &String| w.contains("frame 6") && w.contains("px off the frames before and after");
    assert!(found.iter().any(said), "{found:?}");
    assert!(!found.iter().any(|w| w.contains("frame 3")), "{found:?}");

    let mut bumped = dial(4);
    bumped[7..].iter_mut().for_each(|frame| shifted(frame, 2));
    let found = warnings(bumped);
    let said = |w: &String| w.contains("moved by") && w.contains("from frame 6 to frame 7");
    assert!(found.iter().any(said), "{found:?}");

    let mut dull = dial(4);
    blurred(&mut dull[6], 4);
    let found = warnings(dull);
    assert!(found.iter().any(|w| w.contains("frame 6 is less sharp than")), "{found:?}");
}

#[test]
fn black_clipped_single_and_mixed_frames_are_refused() {
    let frames = dial(6);
    for (level, what) in [(1, "every frame is black"), (255, "every frame is clipped")] {
        let mut flat = frames.clone();
        flat.iter_mut().for_each(|frame| frame.levels.pixels.fill([level; 3]));
        let message = refusal(flat);
        assert!(message.contains(what) && message.contains("lamp"), "{message}");
    }
    let message = refusal(frames[3..4].to_vec());
    assert!(message.contains("1 frames in the bracket, at least 3"), "{message}");
    let mut mixed = frames.clone();
    mixed[2].levels = Image::filled(160, 240, [9; 3]);
    let message = refusal(mixed);
    assert!(message.contains("frame 2") && message.contains("160x240"), "{message}");
}

#[test]
fn a_black_frame_keeps_its_time_and_is_named() {
    let mut frames = dial(7);
    frames[0].levels.pixels.fill([0; 3]);
    let found = outcome(frames).unwrap().calibration;
    assert_eq!(found.exposures[0].sigma_relative, None);
    assert!(found.warnings.iter().any(|w| w.contains("frame 0") && w.contains("not measured")), "{:?}", found.warnings);
    assert!((found.exposures[9].estimated_s / 16.0 - 1.0).abs() < 0.002);
}

#[test]
fn light_in_the_enclosure_is_named() {
    let found = warnings(Shoot { ambient: 0.004, ..Shoot::new(8) }.shot().exposures(Tone::Srgb));
    assert!(found.iter().any(|w| w.contains("frame 9") && w.contains("ambient light")), "{found:?}");
}
