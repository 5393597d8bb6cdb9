//! Canon raw files: decoded to the bit, merged as well as inverse variance with everything known, refused by name when
//! damaged. No file of a real camera was at hand: they are those of a simulated EOS 5D (`cr2_camera`).
#![cfg(feature = "raw")]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod cr2_camera;

use cr2_camera::{Body, COUNTS_PER_E, Cr2, DIAL, FULL_WELL_E, LEFT, READ_NOISE_E, TOP, times_s};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rigd::numerics::image::RadianceImage;
use rigd::numerics::radiometry::merge::Estimator;
use rigd::numerics::radiometry::mosaic::RawBracket;
use rigd::numerics::radiometry::mosaic::merge::RawMerger;
use rigd::pipeline::raw::container::Container;
use rigd::pipeline::raw::{RawFolder, RawTimes, decode, measure};

type Random = Xoshiro256PlusPlus;

#[test]
fn counts_come_back_to_the_bit_whatever_the_slices() {
    let mut random = Random::seed_from_u64(1);
    for (size, slices) in [((64, 40), vec![154]), ((64, 40), vec![50, 50, 54]), ((126, 30), vec![72, 72, 72])] {
        let (width, height) = (LEFT + size.0, TOP + size.1);
        let lit = |i: usize| i % width >= LEFT && i / width >= TOP;
        let count = |i: usize, random: &mut Random| {
            if lit(i) { random.random_range(0..4096) } else { random.random_range(120..137) }
        };
        let counts: Vec<u16> = (0..width * height).map(|i| count(i, &mut random)).collect();
        let file = Cr2 { slices, ..Cr2::new(width, height, counts.clone(), (1, 60)) };
        let bytes = file.bytes();
        let found = decode(&bytes).unwrap();
        assert_eq!((found.counts.width, found.counts.height), size, "never turned, whatever the orientation");
        let expected: Vec<u16> = (0..width * height).filter(|&i| lit(i)).map(|i| counts[i]).collect();
        assert_eq!(found.counts.pixels, expected);
        assert_eq!((found.body.model.as_str(), found.iso), ("Canon EOS 5D", 100));
        let info = Container::open(&bytes).unwrap().info;
        assert_eq!((info.exposure_time_s, info.f_number), (Some(1.0 / 60.0), Some(5.6)));
    }
}

/// Signals whose errors are looked at together, electrons a second.
const RANGES: [(&str, f64, f64); 3] = [("dark", 30.0, 3e3), ("mid", 3e3, 3e5), ("high", 3e5, 8e6)];
const SIZE: (usize, usize) = (480, 240);

/// A scene log-uniform from left to right, the places of the pattern apart.
fn rate(low: f64, high: f64, x: usize, y: usize) -> f64 {
    low * (high / low).powf((x / 2) as f64 / (SIZE.0 / 2) as f64) * [1.0, 0.9, 0.9, 0.7][2 * (y % 2) + x % 2]
}

fn no_dark(_: usize, _: usize) -> f64 {
    0.0
}

fn files(rate: &dyn Fn(usize, usize) -> f64, dark: &dyn Fn(usize, usize) -> f64, seed: u64) -> Vec<Cr2> {
    let body = Body { size: SIZE, rate, dark };
    let shoot = |(i, time_s)| body.shoot(time_s, 0.3 * i as f64, DIAL[i], 100 * seed + i as u64);
    times_s().into_iter().enumerate().map(shoot).collect()
}

fn read(files: &[Cr2]) -> RawBracket {
    let mut folder = RawFolder::default();
    for (i, file) in files.iter().enumerate() {
        let (above, below) = file.exposure;
        folder.add(&format!("{i}.cr2"), &file.bytes(), f64::from(above) / f64::from(below)).unwrap();
    }
    folder.bracket().unwrap().bracket
}

fn merged(bracket: &RawBracket, estimator: Estimator) -> RadianceImage {
    RawMerger::new(bracket, estimator).unwrap().whole()
}

/// Half-size radiance by inverse variance with the true times, noise, black levels and radiance, electrons a second.
fn oracle(files: &[Cr2], rate: &dyn Fn(usize, usize) -> f64) -> Vec<[f64; 3]> {
    let rounding = (1.0 / COUNTS_PER_E).powi(2) / 12.0;
    let site = |x: usize, y: usize| {
        let (mut sum, mut total) = (0.0, 0.0);
        for (i, (file, time)) in files.iter().zip(times_s()).enumerate() {
            let mean = rate(x, y) * time;
            if mean < 0.985 * FULL_WELL_E {
                let black = 128.0 + 0.3 * i as f64 + 0.25 * (2 * (y % 2) + x % 2) as f64;
                let count = f64::from(file.counts[(y + TOP) * file.width + x + LEFT]);
                let weight = time * time / (mean + READ_NOISE_E.powi(2) + rounding);
                sum += weight * (count - black) / COUNTS_PER_E / time;
                total += weight;
            }
        }
        sum / total
    };
    half_size(&site)
}

fn half_size(site: &dyn Fn(usize, usize) -> f64) -> Vec<[f64; 3]> {
    let cell = |(x, y): (usize, usize)| [site(x, y), 0.5 * (site(x + 1, y) + site(x, y + 1)), site(x + 1, y + 1)];
    (0..SIZE.1 / 2).flat_map(|y| (0..SIZE.0 / 2).map(move |x| (2 * x, 2 * y))).map(cell).collect()
}

/// Electrons of radiance 1 in a second: white above the mean black level of ten frames.
const UNIT_E: f64 = (3692.0 - 128.0 - 0.3 * 4.5 - 0.25 * 1.5) / COUNTS_PER_E;

/// Relative rms error, bias, and mean squared error over variance of the valid pixels, and their share.
fn errors(image: &RadianceImage, truth: &[[f64; 3]]) -> (f64, f64, f64, f64) {
    let (mut n, mut sum, mut squares, mut pulls) = (0.0, 0.0, 0.0, 0.0);
    for (i, truth) in truth.iter().enumerate().filter(|(i, _)| image.valid.pixels[*i]) {
        for c in 0..3 {
            let off = f64::from(image.radiance.pixels[i][c]) * UNIT_E - truth[c];
            let variance = f64::from(image.variance.as_ref().unwrap().pixels[i][c]) * UNIT_E.powi(2);
            n += 1.0;
            sum += off / truth[c];
            squares += (off / truth[c]).powi(2);
            pulls += off * off / variance;
        }
    }
    ((squares / n).sqrt(), sum / n, pulls / n, n / (3 * truth.len()) as f64)
}

/// Relative rms error of the oracle over the same pixels.
fn oracle_rms(oracle: &[[f64; 3]], truth: &[[f64; 3]], image: &RadianceImage) -> f64 {
    let valid = || (0..truth.len()).filter(|&i| image.valid.pixels[i]);
    let squares: f64 = valid().flat_map(|i| (0..3).map(move |c| (oracle[i][c] / truth[i][c] - 1.0).powi(2))).sum();
    (squares / (3 * valid().count()) as f64).sqrt()
}

/// Greatest relative error of the times that were measured, against the reference.
fn worst_ratio(times: &RawTimes) -> f64 {
    let reference = times.exposures.iter().position(|time| time.name == times.reference).unwrap();
    let truth = times_s();
    let error = |(i, time): (usize, &rigd::pipeline::calibration::response::ExposureTime)| {
        let ratio = time.estimated_s / times.exposures[reference].estimated_s;
        time.sigma_relative.map(|_| (ratio / (truth[i] / truth[reference]) - 1.0).abs())
    };
    times.exposures.iter().enumerate().filter_map(error).fold(0.0, f64::max)
}

#[test]
fn a_bracket_merges_as_well_as_with_everything_known() {
    for (range, (name, low, high)) in RANGES.into_iter().enumerate() {
        let rate = |x: usize, y: usize| rate(low, high, x, y);
        let files = files(&rate, &no_dark, 1 + range as u64);
        let bracket = read(&files);
        for (i, frame) in bracket.frames().iter().enumerate() {
            for (place, level) in frame.black.level.into_iter().enumerate() {
                let truth = 128.0 + 0.3 * i as f64 + 0.25 * place as f64;
                assert!((level - truth).abs() < 0.05, "black {level} for {truth}");
            }
        }
        let read_noise = bracket.noise().read_noise_e;
        assert!((read_noise / READ_NOISE_E - 1.0).abs() < 0.05, "read noise {read_noise}");
        let (bracket, times) = measure(bracket).unwrap();
        let told = times.exposures.iter().filter(|time| time.sigma_relative.is_some()).count();
        let ratio = worst_ratio(&times);
        let truth = half_size(&rate);
        let image = merged(&bracket, Estimator::InverseVariance);
        let (rms, bias, pulls, valid) = errors(&image, &truth);
        let best = oracle_rms(&oracle(&files, &rate), &truth, &image);
        let poisson = errors(&merged(&bracket, Estimator::Poisson), &truth).0;
        println!(
            "{name}: rms {:.3} % (oracle {:.3} %, {:+.1} %; poisson {:.3} %), bias {:+.3} %, squared error over variance \
             {pulls:.3}, \
             {:.1} % valid, {told} ratios measured, to {:.3} %",
            100.0 * rms,
            100.0 * best,
            100.0 * (rms / best - 1.0),
            100.0 * poisson,
            100.0 * bias,
            100.0 * valid,
            100.0 * ratio
        );
        assert!(rms <= 1.05 * best, "{name}: {rms} for {best}");
        assert!(ratio < 0.002 && told >= 4, "{name}: a ratio is off by {ratio}, {told} measured");
        // The times' own error is common to all pixels: it is no bias of the merge.
        assert!(bias.abs() < 1e-3 && (0.9..1.1).contains(&pulls) && valid > 0.97, "{name}: {bias} {pulls} {valid}");
        let (rms, bias, ..) =
            errors(&merged(&bracket.with_times(&times_s()).unwrap(), Estimator::InverseVariance), &truth);
        assert!(bias.abs() < 0.1 * rms, "{name}: biased by {bias} of {rms} with the true times");
    }
}

#[test]
fn every_ratio_is_measured_where_all_levels_are_seen() {
    let wide = |x: usize, y: usize| rate(30.0, 8e6, x, y);
    let (_, times) = measure(read(&files(&wide, &no_dark, 9))).unwrap();
    let ratio = worst_ratio(&times);
    println!("all levels: ratios to {:.3} %", 100.0 * ratio);
    assert!(times.exposures.iter().all(|time| time.sigma_relative.is_some() && !time.departs), "{times:?}");
    assert!(ratio < 0.002 && times.warnings.is_empty(), "{times:?}");
}

#[test]
fn what_is_clipped_in_every_frame_and_its_neighbours_is_not_valid() {
    let spot = |x: usize, y: usize| if x.abs_diff(241) < 3 && y.abs_diff(121) < 3 { 1e9 } else { 2e4 };
    let (bracket, _) = measure(read(&files(&spot, &no_dark, 4))).unwrap();
    let image = merged(&bracket, Estimator::InverseVariance);
    // Photosites 239 to 243 are clipped, 238 and 244 beside them: cells 119 to 122; rows 119 to 123, cells 59 to 62.
    for y in 0..SIZE.1 / 2 {
        for x in 0..SIZE.0 / 2 {
            let inside = (119..=122).contains(&x) && (59..=62).contains(&y);
            assert_eq!(*image.valid.at(x, y), !inside, "cell {x}, {y}");
            let variance = image.variance.as_ref().unwrap().at(x, y)[1];
            let radiance = image.radiance.at(x, y)[1];
            assert!(radiance.is_finite() && variance.is_finite() && variance > 0.0);
            assert!(!inside || variance > 0.0 && variance <= radiance * radiance * 1.001);
        }
    }
}

#[test]
fn strips_and_threads_do_not_change_a_bit() {
    let wide = |x: usize, y: usize| rate(30.0, 8e6, x, y);
    let bracket = read(&files(&wide, &no_dark, 5)[..4]);
    let bits = |image: &RadianceImage, rows: usize| -> Vec<u32> {
        image.radiance.pixels[..rows * SIZE.0 / 2].as_flattened().iter().map(|v| v.to_bits()).collect()
    };
    let merger = RawMerger::new(&bracket, Estimator::InverseVariance).unwrap();
    let whole = bits(&merger.whole(), SIZE.1 / 2);
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let mut strip = RadianceImage::empty(SIZE.0 / 2, 7);
    for row in (0..SIZE.1 / 2).step_by(7) {
        alone.install(|| merger.strip(row, &mut strip));
        let rows = 7.min(SIZE.1 / 2 - row);
        assert!(bits(&strip, rows) == whole[3 * row * SIZE.0 / 2..][..3 * rows * SIZE.0 / 2], "row {row}");
    }
}

#[test]
fn wrong_times_and_mixed_frames_are_refused_by_name() {
    let flat = |x: usize, y: usize| rate(3e3, 3e5, x, y);
    let sound = files(&flat, &no_dark, 6);
    let mut exchanged = sound.clone();
    (exchanged[5].exposure, exchanged[7].exposure) = (sound[7].exposure, sound[5].exposure);
    let message = measure(read(&exchanged)).unwrap_err().to_string();
    assert!(message.contains("5.cr2") && message.contains("7.cr2") && message.contains("correct"), "{message}");
    let twice = [&sound[..], &[Cr2 { exposure: (30, 1), ..sound[6].clone() }]].concat();
    let message = measure(read(&twice)).unwrap_err().to_string();
    assert!(message.contains("10.cr2") && message.contains("30 s"), "{message}");

    let mut folder = RawFolder::default();
    folder.add("a.cr2", &sound[0].bytes(), 1.0).unwrap();
    let message = folder.add("b.cr2", &Cr2 { iso: 400, ..sound[1].clone() }.bytes(), 2.0).unwrap_err().to_string();
    assert!(message.contains("b.cr2") && message.contains("ISO 400"), "{message}");
    let message = folder.add("c.cr2", &Cr2 { model: "Canon EOS 7D", ..sound[1].clone() }.bytes(), 2.0).unwrap_err();
    assert!(message.to_string().contains("c.cr2") && message.to_string().contains("Canon EOS 5D"), "{message}");
    let black = |_: usize, _: usize| 0.0;
    let message = measure(read(&files(&black, &no_dark, 7))).unwrap_err().to_string();
    assert!(message.contains("shoot"), "{message}");
}

/// A small file and the name of it in every refusal.
fn small() -> Vec<u8> {
    let body = Body { size: (40, 24), rate: &|x, y| rate(30.0, 8e5, 6 * x, y), dark: &no_dark };
    body.shoot(0.1, 0.0, (1, 10), 3).bytes()
}

/// Whether the bytes are taken; a refusal must name the file and say what to do.
fn taken(bytes: &[u8]) -> bool {
    match RawFolder::default().add("damaged.cr2", bytes, 1.0) {
        Ok(()) => true,
        Err(error) => {
            let message = error.to_string();
            assert!(message.contains("damaged.cr2") && message.contains(": "), "{message}");
            false
        }
    }
}

#[test]
fn a_file_cut_short_is_refused_by_name_at_any_length() {
    let whole = small();
    assert!(taken(&whole));
    for length in (0..whole.len()).step_by(13).chain(0..600).chain(whole.len() - 200..whole.len()) {
        assert!(!taken(&whole[..length]), "{length} of {} bytes were taken", whole.len());
    }
}

#[test]
fn damaged_files_give_a_frame_or_a_named_refusal() {
    let whole = small();
    let head = whole.len().min(700);
    let mut random = Random::seed_from_u64(11);
    let mut accepted = 0;
    for round in 0..6_000 {
        let mut bytes = whole.clone();
        // Two thirds of the damage to the directories and tables, where it does most.
        let within = if round % 3 == 0 { bytes.len() } else { head };
        for _ in 0..random.random_range(1..6) {
            let at = random.random_range(0..within);
            match random.random_range(0..4) {
                0 => bytes[at] = random.random(),
                1 => bytes[at] ^= 1 << random.random_range(0..8),
                2 => bytes[at] = [0, 1, 0x7f, 0x80, 0xff][random.random_range(0..5)],
                _ => bytes.splice(at..at, [random.random::<u8>()]).for_each(drop),
            }
        }
        accepted += usize::from(taken(&bytes));
    }
    println!("{accepted} of 6000 damaged files still hold a frame");
    assert!(accepted > 100 && accepted < 6_000);
}

#[test]
fn sizes_that_no_sensor_has_are_refused_before_memory_is_taken() {
    let whole = small();
    let sof = whole.windows(2).position(|pair| pair == [0xff, 0xc3]).unwrap();
    let mut huge = whole.clone();
    huge[sof + 5..sof + 9].copy_from_slice(&[0xff, 0xff, 0xff, 0xff]);
    let message = decode(&huge).unwrap_err().to_string();
    assert!(message.contains("size"), "{message}");
}
