//! Dark frames, flat field and lamp drift on frames whose dark signal, vignetting and lamp are known.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rand_distr::{Distribution, StandardNormal};
use rigd::numerics::image::{Image, RadianceImage};
use rigd::numerics::radiometry::bracket::{Bracket, Exposure};
use rigd::numerics::radiometry::dark::Dark;
use rigd::numerics::radiometry::drift::{Patch, PatchError};
use rigd::numerics::radiometry::flat::{Flat, FlatError};
use rigd::numerics::radiometry::merge::merge;
use rigd::numerics::radiometry::noise::SensorNoise;
use rigd::numerics::radiometry::response::Response;

const NOISE: SensorNoise = SensorNoise { full_well_e: 80_000.0, read_noise_e: 30.0 };
const SIZE: (usize, usize) = (96, 64);
const TIMES: [f64; 6] = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0];

/// Charge over full well at a level: a power curve with a straight toe.
fn charge(level: f64) -> f64 {
    let power = |v: f64| v.powf(2.2);
    (power(level / 255.0 + 0.055) - power(0.055)) / (power(1.055) - power(0.055))
}

fn response() -> Response {
    let curve: Vec<f64> = (0..256).map(|z| (charge(f64::from(z).max(0.25)) / charge(128.0)).ln()).collect();
    Response { log_exposure: [curve.clone(), curve.clone(), curve] }
}

/// Frames of signals in wells a second.
fn shoot(times: &[f64], seed: u64, signal: impl Fn(usize, usize, usize) -> f64) -> Bracket {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let tops: Vec<f64> = (0..255).map(|z| charge(f64::from(z) + 0.5)).collect();
    let exposures = times.iter().enumerate().map(|(number, &time_s)| {
        let mut pixels = Vec::new();
        for y in 0..SIZE.1 {
            for x in 0..SIZE.0 {
                pixels.push(std::array::from_fn(|c| {
                    let mean = NOISE.full_well_e * signal(x, y, c) * time_s;
                    let normal: f64 = StandardNormal.sample(&mut random);
                    let electrons = mean + normal * (mean + NOISE.read_noise_e.powi(2)).sqrt();
                    tops.partition_point(|top| *top <= electrons / NOISE.full_well_e) as u8
                }));
            }
        }
        Exposure { name: format!("frame {number}"), levels: Image { width: SIZE.0, height: SIZE.1, pixels }, time_s }
    });
    Bracket::new(exposures.collect(), [1.0 / 12.0; 3]).unwrap()
}

/// Mean relative error, and variance of (error / standard deviation), over valid pixels.
fn judge(image: &RadianceImage, truth: impl Fn(usize, usize, usize) -> f64) -> (f64, f64) {
    let (mut n, mut bias, mut squares) = (0.0, 0.0, 0.0);
    for (i, pixel) in image.radiance.pixels.iter().enumerate().filter(|(i, _)| image.valid.pixels[*i]) {
        for c in 0..3 {
            let expected = truth(i % SIZE.0, i / SIZE.0, c) / charge(128.0);
            let error = f64::from(pixel[c]) - expected;
            n += 1.0;
            bias += error / expected;
            squares += error * error / f64::from(image.variance.as_ref().unwrap().pixels[i][c]);
        }
    }
    assert!(n > 1000.0);
    (bias / n, squares / n)
}

fn scene(x: usize, _: usize, c: usize) -> f64 {
    0.02 * (1.0 + 0.3 * c as f64) * (1.0 + x as f64 / 40.0)
}

/// A glow in one corner as amplifiers give it, and five hot pixels.
fn dark_signal(x: usize, y: usize) -> f64 {
    let glow = 0.002 * (-((x * x + y * y) as f64) / 400.0).exp();
    if x % 20 == 7 && y == 30 { 0.04 } else { glow }
}

#[test]
fn dark_signal_is_taken_off_and_hot_pixels_are_left_out() {
    let bracket = shoot(&TIMES, 1, |x, y, c| scene(x, y, c) + dark_signal(x, y));
    let frames = shoot(&[8.0; 4], 2, |x, y, _| dark_signal(x, y));
    let dark = Dark::new(&frames, &response(), &NOISE);
    assert_eq!(dark.hot_pixels(), 5);
    let mut image = merge(&bracket, &response(), &NOISE);
    let corner = |image: &RadianceImage| f64::from(image.radiance.at(2, 2)[0]) * charge(128.0) / scene(2, 2, 0) - 1.0;
    assert!(corner(&image) > 0.05, "without dark frames the corner is {:+.3} off", corner(&image));
    dark.subtract(0, &mut image);
    let (bias, variance) = judge(&image, scene);
    println!("bias {bias:+.5}, variance of the pull {variance:.3}");
    assert!(bias.abs() < 1e-3 && (0.8..1.2).contains(&variance), "{bias}, {variance}");
    assert_eq!(image.valid.pixels.iter().filter(|valid| !**valid).count(), 5);
    // Strips are corrected as the whole is.
    let mut strip = merge(&bracket, &response(), &NOISE);
    strip.radiance.pixels.drain(..32 * SIZE.0);
    strip.valid.pixels.drain(..32 * SIZE.0);
    strip.variance.as_mut().unwrap().pixels.drain(..32 * SIZE.0);
    dark.subtract(32, &mut strip);
    assert_eq!(strip.radiance.pixels, image.radiance.pixels[32 * SIZE.0..]);
}

/// Vignetting to 20 % in the corners, different in each channel, as a mean of 1.
fn vignetting(x: usize, y: usize, c: usize) -> f64 {
    let (u, v) = (x as f64 / 95.0 - 0.5, y as f64 / 63.0 - 0.5);
    1.0 - (0.3 + 0.05 * c as f64) * (u * u + v * v)
}

fn mean_vignetting(c: usize) -> f64 {
    let sum: f64 = (0..SIZE.0 * SIZE.1).map(|i| vignetting(i % SIZE.0, i / SIZE.0, c)).sum();
    sum / (SIZE.0 * SIZE.1) as f64
}

#[test]
fn vignetting_is_divided_out_and_the_noise_of_the_flat_goes_to_the_variance() {
    let bracket = shoot(&TIMES, 3, |x, y, c| scene(x, y, c) * vignetting(x, y, c));
    // Brightness differs from frame to frame: only its shape counts. Few frames, so that their noise is seen.
    let frames = shoot(&[3.6, 4.0, 4.4], 4, |x, y, c| 0.1 * vignetting(x, y, c));
    let flat = Flat::new(&frames, &response()).unwrap();
    let mut image = merge(&bracket, &response(), &NOISE);
    flat.divide(0, &mut image);
    let (bias, variance) = judge(&image, |x, y, c| scene(x, y, c) * mean_vignetting(c));
    println!("bias {bias:+.5}, variance of the pull {variance:.3}");
    // A standard error from three frames is itself uncertain: pulls scatter somewhat more.
    assert!(bias.abs() < 1e-3 && (0.8..1.4).contains(&variance), "{bias}, {variance}");
}

#[test]
fn flat_fields_that_say_nothing_are_refused_by_name() {
    let one = shoot(&[4.0], 5, |_, _, _| 0.1);
    assert_eq!(Flat::new(&one, &response()).unwrap_err(), FlatError::TooFew { found: 1 });
    let bright = shoot(&[1.0, 40.0], 6, |_, _, _| 0.1);
    let message = Flat::new(&bright, &response()).unwrap_err().to_string();
    assert!(message.contains("frame 1") && message.contains("clipped"), "{message}");
}

#[test]
fn a_drifting_lamp_is_brought_back_by_the_patch() {
    let patch = Patch { x: 4, y: 4, width: 20, height: 20 };
    let with_patch = |x: usize, y: usize, c: usize| if x < 28 && y < 28 { 0.06 } else { scene(x, y, c) };
    let reference = patch.mean(&merge(&shoot(&TIMES, 7, with_patch), &response(), &NOISE)).unwrap();
    let lamp = [0.96, 0.95, 0.93];
    let mut image = merge(&shoot(&TIMES, 8, |x, y, c| lamp[c] * with_patch(x, y, c)), &response(), &NOISE);
    let seen = patch.mean(&image).unwrap();
    for (drift, lamp) in seen.drift(reference.radiance).into_iter().zip(lamp) {
        assert!((drift / lamp - 1.0).abs() < 1e-3, "{drift} for {lamp}");
    }
    seen.normalise(reference.radiance, &mut image);
    let (bias, variance) = judge(&image, with_patch);
    assert!(bias.abs() < 1e-3 && (0.8..1.2).contains(&variance), "{bias}, {variance}");
    let outside = Patch { x: 90, ..patch };
    assert!(matches!(outside.mean(&image), Err(PatchError::Outside { .. })));
    image.valid.pixels.fill(false);
    assert_eq!(patch.mean(&image), Err(PatchError::TooFew { valid: 0 }));
}

/// A folder as `rigd merge` takes it, with one dark frame of these levels; what it says.
fn merge_with_dark(level: impl Fn(u32, u32) -> u8) -> (bool, String) {
    let folder = tempfile::tempdir().unwrap();
    let (width, height) = (64_u32, 48_u32);
    let save = |name: &str, level: &dyn Fn(u32, u32) -> u8| {
        let bytes: Vec<u8> =
            (0..height).flat_map(|y| (0..width).flat_map(move |x| [(x, y); 3])).map(|(x, y)| level(x, y)).collect();
        image::save_buffer(folder.path().join(name), &bytes, width, height, image::ExtendedColorType::Rgb8).unwrap();
    };
    let mut list = String::new();
    for k in 0..7_i32 {
        let time_s = 2_f64.powi(k) / 8.0;
        let shown = move |x: u32, y: u32| {
            let radiance = 0.01 * 300_f64.powf(f64::from(x + width * y) / f64::from(width * height));
            (255.0 * (radiance * time_s).min(1.0).powf(1.0 / 2.2)) as u8
        };
        save(&format!("{k}.png"), &shown);
        list += &format!("[[frame]]\nfile = \"{k}.png\"\ntime_s = {time_s:?}\n");
    }
    save("dark.png", &level);
    list += "[[dark]]\nfile = \"dark.png\"\ntime_s = 8.0\n";
    std::fs::write(folder.path().join("exposures.toml"), list).unwrap();
    let output =
        std::process::Command::new(env!("CARGO_BIN_EXE_rigd")).arg("merge").arg(folder.path()).output().unwrap();
    let text = [output.stdout, output.stderr].concat();
    (output.status.success(), String::from_utf8_lossy(&text).into_owned())
}

#[test]
fn a_dark_frame_that_shows_light_is_named_and_refused() {
    let (merged, said) = merge_with_dark(|x, y| if x % 13 == 5 && y % 17 == 3 { 200 } else { (x / 10) as u8 });
    assert!(merged && said.contains("dark frames: "), "a glow and hot pixels are no light: {said}");
    let whole = |_: u32, _: u32| 60;
    let window = |x: u32, y: u32| if x < 16 && y < 12 { 140 } else { 2 };
    for (merged, said) in [merge_with_dark(whole), merge_with_dark(window)] {
        assert!(!merged && said.contains("dark.png is listed as a dark frame"), "{said}");
        assert!(said.contains("lens cap") && said.contains("room light"), "{said}");
    }
}
