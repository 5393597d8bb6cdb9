//! `rigd merge` and `rigd calibrate response` on folders of Canon raw files, with the feature `raw` and without.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod cr2_camera;

use cr2_camera::{Body, Cr2, DIAL, times_s};
use std::path::Path;
use std::process::{Command, Output};

fn rigd(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rigd")).args(arguments).arg(folder).output().unwrap()
}

fn refusal(arguments: &[&str], folder: &Path) -> String {
    let output = rigd(arguments, folder);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{message}");
    message
}

const SIZE: (usize, usize) = (160, 240);

/// Electrons a second: a ramp over three decades.
fn ramp(x: usize, _: usize) -> f64 {
    3e3 * 1e3_f64.powf((x / 2) as f64 / (SIZE.0 / 2) as f64)
}

fn nothing(_: usize, _: usize) -> f64 {
    0.0
}

/// The frame of the bracket's i-th exposure.
fn frame(i: usize, rate: &dyn Fn(usize, usize) -> f64, dark: &dyn Fn(usize, usize) -> f64, seed: u64) -> Cr2 {
    Body { size: SIZE, rate, dark }.shoot(times_s()[i], 0.0, DIAL[i], 1000 * seed + i as u64)
}

#[test]
fn raw_frames_are_not_for_the_response_nor_beside_others() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.CR2"), frame(5, &ramp, &nothing, 1).bytes()).unwrap();
    let message = refusal(&["calibrate", "response"], folder.path());
    assert!(
        message.contains("raw frames are linear and need no response") && message.contains("rigd merge"),
        "{message}"
    );
    std::fs::write(
        folder.path().join("exposures.toml"),
        "[[frame]]\nfile = \"a.CR2\"\ntime_s = 1.0\n[[frame]]\nfile = \"a.jpg\"\ntime_s = 2.0\n",
    )
    .unwrap();
    let message = refusal(&["merge"], folder.path());
    assert!(message.contains("a.CR2 is a raw file, a.jpg is not"), "{message}");
}

#[cfg(not(feature = "raw"))]
#[test]
fn a_build_without_raw_files_says_so() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.cr2"), frame(5, &ramp, &nothing, 1).bytes()).unwrap();
    let message = refusal(&["merge"], folder.path());
    assert!(message.contains("a.cr2") && message.contains("--features raw"), "{message}");
}

#[cfg(feature = "raw")]
mod with_raw {
    use super::*;
    use rigd::store::exr::read_radiance;

    /// What the lens lets through, relative.
    fn shade(x: usize, y: usize) -> f64 {
        let [x, y] = [(x / 2, SIZE.0), (y / 2, SIZE.1)].map(|(at, size)| 4.0 * at as f64 / size as f64 - 1.0);
        1.0 - 0.1 * (x * x + y * y)
    }

    /// Electrons a second without light: a glow towards the right, and hot photosites.
    fn dark(x: usize, y: usize) -> f64 {
        if (x, y) == (61, 41) { 3_000.0 } else { 200.0 * x as f64 / SIZE.0 as f64 }
    }

    #[test]
    fn a_folder_is_merged_with_dark_frames_flat_field_and_reference_patch() {
        let folder = tempfile::tempdir().unwrap();
        let mut list = String::new();
        let mut put = |kind: &str, name: String, file: &Cr2| {
            let time = f64::from(file.exposure.0) / f64::from(file.exposure.1);
            list += &format!("[[{kind}]]\nfile = {name:?}\ntime_s = {time:?}\n");
            std::fs::write(folder.path().join(name), file.bytes()).unwrap();
        };
        // The lamp 4 % too dark.
        let scene = |x: usize, y: usize| 0.96 * ramp(x, y) * shade(x, y);
        for i in 0..10 {
            put("frame", format!("{i}.cr2"), &frame(i, &scene, &dark, 1));
        }
        for k in 0..2 {
            put("dark", format!("dark-{k}.cr2"), &frame(9, &nothing, &dark, 2 + k));
        }
        let white = |x: usize, y: usize| 4e4 * shade(x, y);
        for k in 0..16 {
            put("flat", format!("flat-{k}.cr2"), &frame(5, &white, &nothing, 10 + k));
        }
        // A patch of one column, and the radiance there with the lamp as it should be.
        let radiance = [ramp(80, 0) / 80_000.0; 3];
        list += &format!("[reference_patch]\nx = 40\ny = 0\nwidth = 1\nheight = 120\nradiance = {radiance:?}\n");
        std::fs::write(folder.path().join("exposures.toml"), list).unwrap();

        let output = rigd(&["merge"], folder.path());
        let [said, error] = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
        assert!(output.status.success(), "{error}");
        println!("{said}");
        assert!(said.contains("Canon EOS 5D at ISO 100") && said.contains("9.cr2") && said.contains("+- 0."), "{said}");
        assert!(said.contains("dark frames: 1 hot pixels") && said.contains("reference patch"), "{said}");

        let image = read_radiance(&folder.path().join("radiance.exr"), (SIZE.0 / 2, SIZE.1 / 2)).unwrap();
        assert_eq!((image.radiance.width, image.radiance.height), (SIZE.0 / 2, SIZE.1 / 2));
        assert!(!image.valid.at(30, 20), "the hot pixel");
        let (mut n, mut sum, mut squares, mut pulls) = (0.0, 0.0, 0.0, 0.0);
        for (i, pixel) in image.radiance.pixels.iter().enumerate().filter(|(i, _)| image.valid.pixels[*i]) {
            let truth = ramp(2 * (i % (SIZE.0 / 2)), 0) / 80_000.0;
            for c in 0..3 {
                let off = f64::from(pixel[c]) / truth - 1.0;
                n += 1.0;
                sum += off;
                squares += off * off;
                pulls += (off * truth).powi(2) / f64::from(image.variance.as_ref().unwrap().pixels[i][c]);
            }
        }
        println!(
            "bias {:+.4} %, rms {:.3} %, squared error over variance {:.3}",
            100.0 * sum / n,
            100.0 * (squares / n).sqrt(),
            pulls / n
        );
        assert!(n > 0.99 * (3 * SIZE.0 * SIZE.1 / 4) as f64, "{n}");
        assert!((sum / n).abs() < 2e-3 && (0.8..1.25).contains(&(pulls / n)), "{} {}", sum / n, pulls / n);
    }

    #[test]
    fn estimators_for_levels_and_damaged_files_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        for i in 4..7 {
            std::fs::write(folder.path().join(format!("{i}.cr2")), frame(i, &ramp, &nothing, 3).bytes()).unwrap();
        }
        assert!(rigd(&["merge", "--estimator", "poisson"], folder.path()).status.success());
        let message = refusal(&["merge", "--estimator", "debevec"], folder.path());
        assert!(message.contains("inverse-variance or poisson"), "{message}");
        let whole = frame(7, &ramp, &nothing, 3).bytes();
        std::fs::write(folder.path().join("7.cr2"), &whole[..whole.len() / 2]).unwrap();
        let message = refusal(&["merge"], folder.path());
        assert!(message.contains("7.cr2") && message.contains("cut short") && message.contains("again"), "{message}");
    }

    /// Highest resident memory of a running process so far, MB; none once it has ended.
    fn peak_mb(pid: u32) -> Option<u64> {
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
        let line = status.lines().find(|line| line.starts_with("VmHWM"))?;
        Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? / 1000)
    }

    /// Ten full frames, dark frames and flat-field frames in a folder with a list.
    fn full_folder(darks: usize, flats: usize) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let scene = |x: usize, y: usize| 3e3 * 1e3_f64.powf((x / 2 + y / 2) as f64 / 3640.0);
        let white = |_: usize, _: usize| 4e4;
        let mut list = String::new();
        let mut put = |kind: &str, name: String, at: usize, rate: &dyn Fn(usize, usize) -> f64, seed: usize| {
            let file =
                Body { size: (4368, 2912), rate, dark: &nothing }.shoot(times_s()[at], 0.0, DIAL[at], seed as u64);
            let (above, below) = DIAL[at];
            list += &format!("[[{kind}]]\nfile = {name:?}\ntime_s = {:?}\n", f64::from(above) / f64::from(below));
            std::fs::write(folder.path().join(name), file.bytes()).unwrap();
        };
        (0..10).for_each(|i| put("frame", format!("{i}.cr2"), i, &scene, i));
        (0..darks).for_each(|i| put("dark", format!("dark-{i}.cr2"), 9, &nothing, 20 + i));
        (0..flats).for_each(|i| put("flat", format!("flat-{i}.cr2"), 5, &white, 40 + i));
        std::fs::write(folder.path().join("exposures.toml"), list).unwrap();
        folder
    }

    /// Merges the folder; highest resident memory, MB.
    fn merged_in_mb(folder: &Path) -> u64 {
        let start = std::time::Instant::now();
        let mut child = Command::new(env!("CARGO_BIN_EXE_rigd")).arg("merge").arg(folder).spawn().unwrap();
        let mut peak = 0;
        let status = loop {
            peak = peak_mb(child.id()).unwrap_or(0).max(peak);
            if let Some(status) = child.try_wait().unwrap() {
                break status;
            }
            std::thread::sleep(std::time::Duration::from_millis(5));
        };
        assert!(status.success() && peak > 0);
        println!("{:.1} s, {peak} MB at most", start.elapsed().as_secs_f64());
        peak
    }

    #[test]
    #[ignore = "by hand, prints time and memory: cargo test --features raw --test raw_folder -- --ignored --nocapture"]
    fn ten_full_frames_are_merged_in_less_than_400_mb() {
        let peak = merged_in_mb(full_folder(0, 0).path());
        assert!(peak < 400, "{peak} MB");
    }

    #[test]
    #[ignore = "by hand, prints time and memory: cargo test --features raw --test raw_folder -- --ignored --nocapture"]
    fn with_dark_frames_and_a_flat_field_in_less_than_520_mb() {
        let peak = merged_in_mb(full_folder(2, 3).path());
        assert!(peak < 520, "{peak} MB");
    }
}
