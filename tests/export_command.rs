//! `rigd export`: what it refuses, that the same command writes the same bytes, and that nothing it reads is written over. What is in
//! the files is for readers that know nothing of rigd to say: `make exports`.
#![allow(clippy::unwrap_used, missing_docs)]

use rigd::numerics::image::Image;
use rigd::pipeline::export;
use rigd::pipeline::report::{GAUGE, Identified, MaterialFile, MaterialReport, Parameter, Provenance};
use rigd::store::exr::{Planes, write_planes};
use rigd::store::png;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

const SIDE: usize = 32;

fn parameter(value: f64) -> Parameter {
    Parameter { value, standard_error: Some(0.01), identified: Identified::Identified, reason: None }
}

/// Two materials of one model, the first along one diagonal, the second along the other.
fn write_result(folder: &Path, model: &str) {
    fs::create_dir_all(folder).unwrap();
    let lobe = model != "lambert";
    let one = |rho_d: f64| MaterialReport {
        share: 0.5,
        rho_d: [rho_d, 0.8 * rho_d, 0.6 * rho_d].map(parameter).to_vec(),
        rho_s: if lobe { [0.04; 3].map(parameter).to_vec() } else { Vec::new() },
        beta: lobe.then(|| parameter(0.3 * rho_d)),
    };
    let material = MaterialFile {
        format: 1,
        model: model.to_owned(),
        gauge: GAUGE.to_owned(),
        materials: vec![one(0.6), one(0.3)],
        size: [SIDE, SIDE],
        provenance: Provenance { software: "test".to_owned(), images: Vec::new(), simulated: None, calibration: None },
    };
    fs::write(folder.join("material.json"), serde_json::to_string(&material).unwrap()).unwrap();
    let write = |name: &str, channels: &[&str], value: &dyn Fn(usize, usize, usize) -> f32| {
        let plane = |(m, channel): (usize, &&str)| {
            ((*channel).to_owned(), (0..SIDE * SIDE).map(|i| value(m, i % SIDE, i / SIDE)).collect())
        };
        let channels = channels.iter().enumerate().map(plane).collect();
        let planes = Planes { origin: (0, 0), full: (SIDE, SIDE), size: (SIDE, SIDE), channels };
        write_planes(&folder.join(name), planes, "").unwrap();
    };
    let weight =
        |m: usize, x: usize, y: usize| if m == 0 { (x + y) as f32 / 62.0 } else { x.abs_diff(y) as f32 / 31.0 };
    write("weights.exr", &["material_1", "material_2"], &weight);
    write("weights_sigma.exr", &["material_1", "material_2"], &|_, _, _| 0.01);
    write("residual.exr", &["R", "G", "B"], &|_, _, _| 0.02);
    png::write(&folder.join("valid.png"), &Image::filled(SIDE, SIDE, [255; 3])).unwrap();
}

struct Folder(TempDir);

impl Folder {
    fn new(model: &str) -> Self {
        let root = tempfile::tempdir().unwrap();
        write_result(&root.path().join("result"), model);
        Self(root)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn export(&self, format: &str, out: &str, threads: usize, more: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_rigd"))
            .arg("export")
            .arg(self.path("result"))
            .args(["--format", format, "--json", "--out"])
            .arg(self.path(out))
            .args(if more.contains(&"--patch") { &[][..] } else { &["--patch", "16"] })
            .args(more)
            .env("RAYON_NUM_THREADS", threads.to_string())
            .output()
            .unwrap()
    }

    /// The files of an export, as it tells them and as they are.
    fn bytes(&self, format: &str, out: &str, threads: usize) -> (serde_json::Value, Vec<(String, Vec<u8>)>) {
        let run = self.export(format, out, threads, &[]);
        assert!(run.status.success(), "{format}: {}", String::from_utf8_lossy(&run.stderr));
        let told: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
        let names: Vec<String> = serde_json::from_value(told["files"].clone()).unwrap();
        assert_eq!(
            fs::read_dir(self.path(out)).unwrap().count(),
            names.len(),
            "{format}: files were left, or not told of"
        );
        let read = |name: String| (name.clone(), fs::read(self.path(out).join(name)).unwrap());
        (told, names.into_iter().map(read).collect())
    }

    fn refusal(&self, format: &str, out: &str, more: &[&str]) -> String {
        let run = self.export(format, out, 2, more);
        let message = String::from_utf8(run.stderr).unwrap();
        assert_eq!(run.status.code(), Some(2), "{message}");
        assert!(run.stdout.is_empty());
        message
    }
}

#[test]
fn every_format_writes_the_same_bytes_at_any_number_of_threads() {
    let folder = Folder::new("ward");
    for format in export::names() {
        let (first, second) = (folder.bytes(format, "first", 1), folder.bytes(format, "second", 3));
        assert!(first.1 == second.1, "{format}");
        fs::remove_dir_all(folder.path("first")).unwrap();
        fs::remove_dir_all(folder.path("second")).unwrap();
    }
}

#[test]
fn a_model_that_the_format_has_loses_nothing_but_rounding_and_another_is_told_to_lose() {
    for (model, exact) in [("lambert", true), ("ggx", true), ("ward", false)] {
        let folder = Folder::new(model);
        let (told, files) = folder.bytes("mitsuba", "out", 2);
        let mean = told["loss"]["mean"].as_f64().unwrap();
        assert_eq!(mean < 1e-5, exact, "{model}: {mean}");
        let readme = String::from_utf8(files.last().unwrap().1.clone()).unwrap();
        let said = if exact { "less than 0.00" } else { "% off" };
        assert!(readme.contains(said) && readme.contains("Measured"), "{model}: {readme}");
    }
}

#[test]
fn what_is_missing_or_too_large_is_named_with_what_to_do() {
    let folder = Folder::new("ward");
    let refused = folder.refusal("axf", "out", &[]);
    assert!(refused.contains("axf") && refused.contains("mitsuba"), "{refused}");
    let refused = folder.refusal("exr", "out", &["--patch", "27"]);
    assert!(refused.contains("largest one has 32") && refused.contains("smaller --patch"), "{refused}");
    let refused = folder.refusal("exr", "out", &["--mesh", "vase.obj"]);
    assert!(refused.contains("vase.obj") && refused.contains("knot"), "{refused}");
    fs::write(folder.path("result").join("valid.png"), b"no picture").unwrap();
    let refused = folder.refusal("pbrt", "out", &[]);
    assert!(refused.contains("valid.png: ") && !refused.contains("valid.png: /"), "{refused}");
    fs::remove_file(folder.path("result").join("residual.exr")).unwrap();
    let refused = folder.refusal("pbrt", "out", &[]);
    assert!(refused.contains("residual.exr"), "{refused}");
    assert!(!folder.path("out").exists(), "something was written for a refusal");
}

#[test]
fn what_is_read_is_never_written_over() {
    let folder = Folder::new("lambert");
    let input = folder.path("result").join("material.json");
    let before = fs::read(&input).unwrap();
    for (format, name) in [("exr", "parameters.json"), ("mitsuba", "scene.xml"), ("pbrt", "README.txt")] {
        let out = folder.path(format);
        fs::create_dir(&out).unwrap();
        fs::hard_link(&input, out.join(name)).unwrap();
        let refused = folder.refusal(format, format, &[]);
        assert!(refused.contains(name) && refused.contains("read as input"), "{refused}");
    }
    assert_eq!(fs::read(&input).unwrap(), before);
}
