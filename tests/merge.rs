//! The merge: close to inverse variance with everything known, the same bits however it is run.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rigd::numerics::image::{Image, RadianceImage};
use rigd::numerics::radiometry::bracket::{Bracket, Exposure};
use rigd::numerics::radiometry::merge::{Estimator, Merger};
use rigd::numerics::radiometry::noise::SensorNoise;
use rigd::numerics::radiometry::response::Response;
use rigd::numerics::simd::Level;
use rigd::study::merge::{RANGES, run, table};

#[test]
fn errors_stay_within_five_percent_of_everything_known() {
    let scores = run((900, 40), 7).unwrap();
    println!("{}", table(&scores));
    for oracle in scores.iter().filter(|score| score.estimator == "oracle") {
        let of = |name| {
            let same = |s: &&rigd::study::merge::Score| {
                s.estimator == name && s.storage == oracle.storage && s.range == oracle.range
            };
            scores.iter().find(same).unwrap()
        };
        let (ours, range) = (of("inverse-variance"), RANGES[oracle.range].0);
        assert!(ours.rms <= 1.05 * oracle.rms, "{range}: {} for {}", ours.rms, oracle.rms);
        assert!(ours.bias.abs() < 0.1 * ours.rms, "{range}: biased by {}", ours.bias);
        assert!(ours.valid > 0.95, "{range}: {} valid", ours.valid);
        // What the weights are for: the hat biases the dark and loses precision everywhere.
        assert!(of("debevec").rms > 1.25 * ours.rms && of("robertson").rms > 1.05 * ours.rms, "{range}");
    }
}

/// A smooth curve with a toe.
fn response() -> Response {
    let curve: Vec<f64> = (0..256).map(|z| 2.2 * ((f64::from(z) + 12.0) / 140.0).ln()).collect();
    Response { log_exposure: [curve.clone(), curve.clone(), curve] }
}

const NOISE: SensorNoise = SensorNoise { full_well_e: 80_000.0, read_noise_e: 30.0 };

/// Frames of any levels whatever: what no camera gives must not break the arithmetic.
fn random_bracket(width: usize, height: usize, times: &[f64], seed: u64) -> Bracket {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let exposure = |&time_s: &f64| {
        let pixels = (0..width * height).map(|_| std::array::from_fn(|_| random.random())).collect();
        Exposure { name: String::new(), levels: Image { width, height, pixels }, time_s }
    };
    Bracket::new(times.iter().map(exposure).collect(), [0.9, 0.5, 1.2]).unwrap()
}

fn bits(image: &RadianceImage) -> (Vec<u32>, Vec<u32>, Vec<bool>) {
    let of = |image: &Image<[f32; 3]>| image.pixels.as_flattened().iter().map(|v| v.to_bits()).collect();
    (of(&image.radiance), of(image.variance.as_ref().unwrap()), image.valid.pixels.clone())
}

#[test]
fn instruction_sets_threads_and_strips_do_not_change_a_bit() {
    // Steps that need 2, 4, 5, 8 and 16 frames a pixel; more pixels than a chunk, and no whole number of blocks.
    for (step, count) in [(5.0, 6), (2.25, 10), (2.0, 10), (1.6, 12), (1.26, 20)] {
        let times: Vec<f64> = (0..count).map(|i| 0.01 * f64::powi(step, i)).collect();
        let bracket = random_bracket(173, 61, &times, 5);
        for estimator in Estimator::ALL {
            let merger = Merger::new(&bracket, &response(), &NOISE, estimator);
            let whole = bits(&merger.whole());
            for level in Level::available() {
                let mut again = merger.empty(61);
                merger.strip_at(level, 0, &mut again);
                assert!(bits(&again) == whole, "{level:?}, {}", estimator.name());
            }
            let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
            assert!(bits(&pool.install(|| merger.whole())) == whole, "three threads");
            let mut strip = merger.empty(8);
            for row in (0..61).step_by(8) {
                merger.strip(row, &mut strip);
                let (rows, width) = (8.min(61 - row), 173);
                let (radiance, _, valid) = bits(&strip);
                assert!(radiance[..3 * rows * width] == whole.0[3 * row * width..][..3 * rows * width], "row {row}");
                assert!(valid[..rows * width] == whole.2[row * width..][..rows * width], "row {row}");
            }
        }
    }
}

/// One pixel by the formulas alone: every frame, weights of the estimate, iterated.
fn by_the_formulas(levels: &[u8], times: &[f64], level_variance: f64) -> Option<f64> {
    let exposure = |z: f64| ((z + 12.0) / 140.0).powf(2.2);
    let level = |e: f64| 140.0 * e.powf(1.0 / 2.2) - 12.0;
    let open = levels.iter().take_while(|&&z| z < 252).count();
    let samples: Vec<(f64, f64)> =
        levels[..open].iter().zip(times).map(|(&z, &t)| (exposure(f64::from(z)), t)).collect();
    let mut x = samples.iter().map(|s| s.0).sum::<f64>() / samples.iter().map(|s| s.1).sum::<f64>();
    let per_electron = exposure(255.0) / 80_000.0;
    for _ in 0..20 {
        let (mut sum, mut total) = (0.0, 0.0);
        for &(y, t) in samples.iter().filter(|(_, t)| (4.0..248.0).contains(&level(x * t))) {
            let slope = 2.2 * x * t / (level(x * t) + 12.0);
            let variance = x * t * per_electron + (30.0 * per_electron).powi(2) + level_variance * slope * slope;
            sum += y * t / variance;
            total += t * t / variance;
        }
        x = sum / total;
    }
    x.is_finite().then_some(x)
}

#[test]
fn look_ups_agree_with_the_formulas() {
    let times: Vec<f64> = (0..10).map(|i| 0.01 * f64::powi(2.25, i)).collect();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
    let (mut squares, mut count) = (0.0, 0);
    for _ in 0..2000 {
        // A radiance that the last frame shows at level 20 or more, and one grey level of scatter.
        let x = 0.005 * 10_f64.powf(4.0 * random.random::<f64>());
        let shown = |t: &f64| {
            let level = 140.0 * (x * t).powf(1.0 / 2.2) - 12.0 + 2.0 * (random.random::<f64>() - 0.5);
            level.round().clamp(0.0, 255.0) as u8
        };
        let levels: Vec<u8> = times.iter().map(shown).collect();
        let exposures = levels.iter().zip(&times).map(|(&z, &time_s)| Exposure {
            name: String::new(),
            levels: Image::filled(1, 1, [z; 3]),
            time_s,
        });
        let bracket = Bracket::new(exposures.collect(), [0.5; 3]).unwrap();
        let image = Merger::new(&bracket, &response(), &NOISE, Estimator::InverseVariance).whole();
        if image.valid.pixels[0] {
            let expected = by_the_formulas(&levels, &times, 0.5).unwrap();
            let variance = f64::from(image.variance.unwrap().pixels[0][1]);
            let off = f64::from(image.radiance.pixels[0][1]) - expected;
            squares += off * off / variance;
            count += 1;
        }
    }
    let rms = (squares / f64::from(count)).sqrt();
    println!("{count} pixels: {rms:.3} standard deviations from the formulas");
    assert!(count > 1800 && rms < 0.25, "{rms} standard deviations over {count} pixels");
}
