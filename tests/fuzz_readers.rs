//! Hostile bytes into the readers: dataset descriptions, radiance images, frames. Every answer is a whole image or a reason.
//!
//! The short form of the fuzz targets, from the same seeds (`fuzz/seeds`); rig files and wire frames are tested in their own
//! packages. The random numbers are seeded, so a failure repeats.
#![allow(missing_docs, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rigd::pipeline::decode::{FrameInfo, decode};
use rigd::pipeline::fine::{Unread, fine_levels};
use rigd::store::dataset::{self, check_text};
use rigd::store::exr::{read_radiance, read_vectors};
use std::path::Path;

type Random = Xoshiro256PlusPlus;

/// The seeds of a fuzz target: file name and bytes, in order.
fn seeds(target: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds").join(target);
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(!files.is_empty(), "{target} has no seeds");
    files.iter().map(|f| (f.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(f).unwrap())).collect()
}

/// A copy with a few bytes changed, and now and then cut short, with a piece repeated or with random bytes put in.
fn mutated(random: &mut Random, seed: &[u8]) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..random.random_range(1..8) {
        let at = random.random_range(0..bytes.len());
        match random.random_range(0..12) {
            0..4 => bytes[at] = random.random(),
            4..7 => bytes[at] ^= 1 << random.random_range(0..8),
            7..9 => bytes[at] = [0, 1, 0x7f, 0x80, 0xff][random.random_range(0..5)],
            9 => {
                let end = random.random_range(at..=bytes.len().min(at + 32));
                let piece = bytes[at..end].to_vec();
                bytes.splice(at..at, piece);
            }
            10 => {
                let noise: [u8; 4] = random.random();
                bytes.splice(at..at, noise);
            }
            _ => bytes.truncate(at.max(1)),
        }
    }
    bytes
}

fn is_answered(text: &str) -> bool {
    match check_text(text) {
        Ok(()) => true,
        Err(reasons) => {
            assert!(!reasons.is_empty() && reasons.iter().all(|reason| !reason.is_empty()), "no reason for {text:?}");
            false
        }
    }
}

#[test]
fn ten_thousand_descriptions_are_answered() {
    let mut random = Random::seed_from_u64(11);
    let seeds: Vec<String> = seeds("dataset_toml").into_iter().map(|(_, b)| String::from_utf8(b).unwrap()).collect();
    assert!(seeds.iter().all(|text| is_answered(text)), "the seeds themselves are sound");
    let words =
        ["nan", "-inf", "1e999", "-1", "0", "18446744073709551616", "[", "]", "\"", "[[light]]", "[camera]", "{}"];
    let mut accepted = 0;
    for round in 0..10_000 {
        let text = match round % 4 {
            0 => String::from_utf8_lossy(&random.random::<[u8; 32]>().repeat(1 + round % 9)).into_owned(),
            1 => String::from_utf8_lossy(&mutated(&mut random, seeds[round / 4 % seeds.len()].as_bytes())).into_owned(),
            _ => {
                // One value replaced, so that most of these parse and meet the checks behind the parser.
                let mut lines: Vec<&str> = seeds[round / 4 % seeds.len()].lines().collect();
                let at = random.random_range(0..lines.len());
                let word = words[random.random_range(0..words.len())];
                let changed = match lines[at].split_once('=') {
                    Some((key, value)) if value.contains('[') => format!("{key}= [{word}, 1, 1]"),
                    Some((key, _)) => format!("{key}= {word}"),
                    None => word.to_owned(),
                };
                lines[at] = &changed;
                lines.join("\n")
            }
        };
        accepted += usize::from(is_answered(&text));
    }
    assert!((1..5_000).contains(&accepted), "{accepted} of 10 000 accepted: the mutations are too mild or too wild");
}

#[test]
fn mutated_radiance_images_are_answered() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let mut random = Random::seed_from_u64(12);
    for (name, seed) in seeds("exr_radiance") {
        std::fs::write(&path, &seed).unwrap();
        read_radiance(&path, (10, 8)).unwrap_or_else(|e| panic!("{name}: {e}"));
        let mut read = 0;
        for _ in 0..400 {
            std::fs::write(&path, mutated(&mut random, &seed)).unwrap();
            if let Ok(vectors) = read_vectors(&path, (10, 8)) {
                assert_eq!(vectors.pixels.len(), 80);
            }
            let Ok(image) = read_radiance(&path, (10, 8)) else { continue };
            read += 1;
            assert_eq!((image.radiance.pixels.len(), image.valid.pixels.len()), (80, 80));
            for (pixel, valid) in image.radiance.pixels.iter().zip(&image.valid.pixels) {
                assert!(
                    !valid || pixel.iter().all(|v| v.is_finite() && *v >= 0.0),
                    "{name}: unsound radiance {pixel:?}"
                );
            }
        }
        assert!(read < 400, "{name}: no mutation was noticed");
    }
}

#[test]
fn mutated_integer_images_are_answered() {
    let folder = tempfile::tempdir().unwrap();
    let (_, text) = seeds("dataset_toml").into_iter().find(|(name, _)| name == "orthographic.toml").unwrap();
    let text = String::from_utf8(text).unwrap();
    let mut random = Random::seed_from_u64(13);
    for (name, seed) in seeds("dataset_image") {
        std::fs::write(folder.path().join(dataset::FILE), text.replace("a.png", &name)).unwrap();
        std::fs::write(folder.path().join(&name), &seed).unwrap();
        dataset::read(folder.path()).unwrap_or_else(|e| panic!("{name}: {e}"));
        for _ in 0..700 {
            std::fs::write(folder.path().join(&name), mutated(&mut random, &seed)).unwrap();
            match dataset::read(folder.path()) {
                Ok(dataset) => {
                    assert_eq!(dataset.images[0].radiance.pixels.len(), 80);
                    assert!(dataset.images[0].radiance.pixels.iter().flatten().all(|v| (0.0..=1.0).contains(v)));
                }
                Err(error) => assert!(error.to_string().contains(&name), "{error}"),
            }
        }
    }
}

#[test]
fn mutated_frames_are_answered() {
    let mut random = Random::seed_from_u64(14);
    for (name, seed) in seeds("jpeg_frame") {
        decode(&seed).unwrap_or_else(|e| panic!("{name}: {e}"));
        for _ in 0..1_000 {
            let bytes = mutated(&mut random, &seed);
            if let Ok(picture) = decode(&bytes) {
                assert_eq!(picture.pixels.len(), picture.width * picture.height);
            }
            if let Some(time_s) = FrameInfo::read(&bytes).true_time_s() {
                assert!(time_s.is_finite() && time_s > 0.0, "{name}: an exposure of {time_s} s");
            }
        }
    }
}

#[test]
fn mutated_frames_give_finite_levels_or_a_reason() {
    let points = [(0, 0), (7, 8), (15, 11), (usize::MAX, 0)];
    let mut random = Random::seed_from_u64(15);
    for (name, seed) in seeds("fine_levels") {
        fine_levels(&seed, &points[..3]).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(fine_levels(&seed, &points), Err(Unread::Unsuited), "{name}: a pixel outside");
        let (mut read, mut damaged) = (0, 0);
        for _ in 0..2_000 {
            match fine_levels(&mutated(&mut random, &seed), &points[..3]) {
                Ok(levels) => {
                    read += 1;
                    assert!(levels.len() == 3 && levels.iter().flatten().all(|level| level.is_finite()), "{name}");
                }
                Err(Unread::Damaged) => damaged += 1,
                Err(Unread::Unsuited) => {}
            }
        }
        assert!(read > 100 && damaged > 100, "{name}: {read} read, {damaged} damaged: the mutations miss the scan");
    }
}

#[cfg(feature = "raw")]
#[test]
fn mutated_raw_frames_are_answered() {
    let mut random = Random::seed_from_u64(16);
    for (name, seed) in seeds("raw_frame") {
        rigd::pipeline::raw::decode(&seed).unwrap_or_else(|e| panic!("{name}: {e}"));
        let mut read = 0;
        for _ in 0..1_000 {
            let Ok(frame) = rigd::pipeline::raw::decode(&mutated(&mut random, &seed)) else { continue };
            read += 1;
            let counts = &frame.counts;
            assert_eq!(counts.pixels.len(), counts.width * counts.height);
            assert!(counts.width % 2 == 0 && counts.height % 2 == 0 && counts.width > 0 && counts.height > 0, "{name}");
            assert!(frame.black.level.iter().all(|level| level.is_finite()), "{name}");
            assert!(counts.pixels.iter().all(|count| count >> frame.body.bits == 0), "{name}");
        }
        assert!((20..980).contains(&read), "{name}: {read} of 1000 read: the mutations are too mild or too wild");
    }
}
