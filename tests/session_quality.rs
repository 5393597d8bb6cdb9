//! The judgement of single frames: real photographs, and bytes nobody meant.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use rand::rngs::SmallRng;
use rand::{RngExt, SeedableRng};
use rig_config::Shutter;
use rigd::devices::camera::{RawFrame, Shot};
use rigd::session::quality::{Fingerprint, check};
use std::time::Duration;
use support::{SIZE, jpeg};

fn shot(label: &str, f_number: f64, iso: u32) -> Shot {
    Shot { station: 0, exposure: 0, shutter: Shutter::from_label(label).unwrap(), f_number, iso }
}

fn judge(bytes: Vec<u8>, shot: &Shot, size: (usize, usize)) -> Result<(), String> {
    let frame = RawFrame { bytes, name: "IMG.JPG".into(), transfer: Duration::ZERO };
    check(&frame, shot, size, &Fingerprint::of(&frame), None)
}

/// The truth of the photograph is its publisher's, not ours.
#[test]
fn a_real_5d_frame_is_judged_by_its_own_exif() {
    let root = std::env::var("RIGD_SHARED").unwrap_or_else(|_| "../shared".into());
    let path = std::path::Path::new(&root).join("data/canon-jpeg/canon-eos-5d.jpg");
    let Ok(bytes) = std::fs::read(&path) else {
        eprintln!("skipped: {} is not there (set RIGD_SHARED)", path.display());
        return;
    };
    // Held upright: the file is portrait.
    let size = (2912, 4368);
    assert_eq!(judge(bytes.clone(), &shot("1/160", 5.0, 160), size), Ok(()));
    for (wrong, reason) in [
        (shot("1/200", 5.0, 160), "shutter speed"),
        (shot("1/125", 5.0, 160), "shutter speed"),
        (shot("1/160", 5.6, 160), "aperture"),
        (shot("1/160", 5.0, 100), "ISO"),
    ] {
        let error = judge(bytes.clone(), &wrong, size).unwrap_err();
        assert!(error.contains(reason), "{error}");
    }
    assert!(judge(bytes.clone(), &shot("1/160", 5.0, 160), (4368, 2912)).unwrap_err().contains("2912 x 4368"));
    let cut = bytes[..bytes.len() / 2].to_vec();
    assert!(judge(cut, &shot("1/160", 5.0, 160), size).unwrap_err().contains("cut off"));
}

#[test]
fn every_third_stop_is_told_from_its_neighbours() {
    let labels =
        ["1/8000", "1/1000", "1/100", "1/80", "1/15", "1/6", "0.3", "0.6", "1.3", "10", "13", "15", "20", "30"];
    for asked in labels {
        for written in labels {
            let bytes = jpeg::encode(SIZE, Some(&jpeg::Exif::of(&shot(written, 5.6, 100), 3)));
            let verdict = judge(bytes, &shot(asked, 5.6, 100), SIZE);
            assert_eq!(verdict.is_ok(), asked == written, "asked {asked}, EXIF {written}: {verdict:?}");
        }
    }
}

/// 20 000 damaged frames: no panic, and what passes still says the right exposure.
#[test]
fn damaged_bytes_never_panic() {
    let shot = shot("0.4", 5.6, 100);
    let good = jpeg::encode(SIZE, Some(&jpeg::Exif::of(&shot, 3)));
    assert_eq!(judge(good.clone(), &shot, SIZE), Ok(()));
    let mut random = SmallRng::seed_from_u64(2008);
    let mut refused = 0;
    for _ in 0..20_000 {
        let mut bytes = good.clone();
        for _ in 0..random.random_range(1..8) {
            let at = random.random_range(0..bytes.len());
            bytes[at] = random.random();
        }
        if random.random_bool(0.3) {
            bytes.truncate(random.random_range(0..bytes.len()));
        }
        refused += usize::from(judge(bytes, &shot, SIZE).is_err());
    }
    assert!(refused > 5000, "{refused}");
}
