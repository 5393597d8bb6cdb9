//! `rigd merge` and `rigd simulate camera` on folders: real photographs, and the simulated camera's own.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rigd::cli::merge::merge_folder;
use rigd::numerics::radiometry::bracket::Verdict;
use rigd::numerics::radiometry::merge::Estimator;
use rigd::pipeline::decode::{FrameInfo, decode};
use std::path::PathBuf;

/// The folder of shared photographs by that name, or none with a notice.
fn shared(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("RIGD_SHARED")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let folder = root.join("data").join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: {} is not there; set RIGD_SHARED to the folder that holds data/", folder.display());
    None
}

/// A folder with an exposures.toml of absolute paths, from a bracket's image_list.txt.
fn listed(name: &str) -> Option<tempfile::TempDir> {
    let photographs = shared(name)?;
    let mut list = String::new();
    for line in std::fs::read_to_string(photographs.join("image_list.txt")).unwrap().lines() {
        let mut words = line.split_whitespace();
        let Some(file) = words.next().filter(|word| *word != "#") else { continue };
        // The headers say 1/seconds, the column holds seconds.
        let time_s: f64 = words.next().unwrap().parse().unwrap();
        list += &format!("[[frame]]\nfile = {:?}\ntime_s = {time_s:?}\n", photographs.join(file));
    }
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("exposures.toml"), list).unwrap();
    Some(folder)
}

#[test]
fn a_real_night_bracket_merges() {
    let Some(folder) = listed("bracket-night") else { return };
    let merged = merge_folder(folder.path()).unwrap();
    assert_eq!(merged.calibration.exposures.len(), 14);
    let image = merged.image(Estimator::InverseVariance).unwrap();
    // The three shortest frames are nearly black: nothing can be said of their times.
    assert_eq!(merged.pairs[0].verdict, Verdict::NotTestable);
    assert!(merged.pairs.iter().filter(|pair| pair.verdict == Verdict::Sound).count() >= 11);
    for curve in &merged.calibration.log_exposure {
        assert!(curve.windows(2).all(|step| step[0] <= step[1]));
        assert!(curve[245] - curve[10] > 2.0, "the curve spans {} in log exposure", curve[245] - curve[10]);
    }
    let valid = image.valid.pixels.iter().filter(|v| **v).count();
    println!("{valid} of {} pixels valid, {:?} constraints active", 640 * 426, merged.calibration.active_constraints);
    assert!(valid > 640 * 426 / 2, "{valid} pixels are valid");
    // The merged image explains a frame it was made from: predicted levels of the 1 s exposure agree with the file's.
    let frame = decode(&std::fs::read(shared("bracket-night").unwrap().join("10.bmp")).unwrap()).unwrap();
    let curve = &merged.calibration.log_exposure[1];
    let mut differences: Vec<f64> = (0..frame.pixels.len())
        .filter(|&i| image.valid.pixels[i] && (20..235).contains(&frame.pixels[i][1]))
        .map(|i| {
            let log = f64::from(image.radiance.pixels[i][1]).ln();
            (curve.partition_point(|g| *g < log) as f64 - f64::from(frame.pixels[i][1])).abs()
        })
        .collect();
    differences.sort_by(f64::total_cmp);
    let median = differences[differences.len() / 2];
    assert!(median < 4.0, "the median level is off by {median}");
}

#[test]
fn a_bracket_whose_images_contradict_its_times_is_refused_by_name() {
    let Some(folder) = listed("bracket-inconsistent") else { return };
    let Err(error) = merge_folder(folder.path()) else { panic!("the bracket was taken") };
    let message = error.to_string();
    println!("{message}");
    for name in ["DSC_0075", "DSC_0074", "DSC_0073", "DSC_0072", "DSC_0071"] {
        assert!(message.contains(name), "{name} is not named: {message}");
    }
    for sound in ["DSC_0077", "DSC_0069"] {
        assert!(!message.contains(sound), "{sound} is named: {message}");
    }
}

#[test]
fn a_real_canon_frame_says_how_it_was_taken() {
    let Some(folder) = shared("canon-jpeg") else { return };
    let bytes = std::fs::read(folder.join("canon-eos-5d.jpg")).unwrap();
    let picture = decode(&bytes).unwrap();
    assert_eq!(picture.width * picture.height, 4368 * 2912);
    let info = FrameInfo::read(&bytes);
    assert!((info.exposure_time_s.unwrap() - 1.0 / 160.0).abs() < 1e-9);
    assert!((info.true_time_s().unwrap() - 1.0 / 161.27).abs() < 1e-5);
    assert_eq!((info.f_number, info.iso), (Some(5.0), Some(160)));
}

#[test]
fn unusable_folders_are_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |needle: &str| {
        let Err(error) = merge_folder(folder.path()) else { panic!("the folder was taken") };
        assert!(error.to_string().contains(needle), "{error}");
    };
    refused("no .jpg");
    std::fs::write(folder.path().join("a.png"), b"\x89PNG\r\n\x1a\n").unwrap();
    refused("no exposure time in the EXIF of a.png: write exposures.toml");
    let list = |text: &str| std::fs::write(folder.path().join("exposures.toml"), text).unwrap();
    list("[[frame]]\nfile = \"a.png\"\n");
    refused("time_s");
    list("[[frame]]\nfile = \"a.png\"\ntime_s = 1.0\nf = 2\n");
    refused("unknown field");
    list("[[frame]]\nfile = \"b.png\"\ntime_s = 1.0\n");
    refused("b.png");
    list("[[frame]]\nfile = \"a.png\"\ntime_s = 1.0\n");
    refused("damaged or cut short");
    std::fs::write(folder.path().join("exposures.toml"), [0xff, 0xfe]).unwrap();
    refused("not UTF-8");
    let Err(error) = merge_folder(&folder.path().join("absent")) else { panic!("taken") };
    assert!(error.to_string().contains("absent"), "{error}");
}
