//! `rigd export` of what a session holds (rti, crate), and of its material to formats with pictures: the same bytes twice, what is
//! refused, and what in a session's folder is never followed. Whether other programs can read the files: tests/exports/.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use nix::sys::stat::Mode;
use rigd::session::state::SessionState;
use rigd::store::exr::{Planes, write_planes};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use support::{Fakes, begin, wait_for};
use tempfile::TempDir;

const SIDE: usize = 48;
/// The ball in the pictures, and the pixels that are measured, radii in pixels.
const BALL: f64 = 22.0;
const MEASURED: f64 = 19.5;
/// Lights: one near, one far away.
const NEAR: [f64; 3] = [10.0, -20.0, -90.0];
const FAR: [f64; 3] = [0.6, 0.0, -0.8];

struct Session {
    root: TempDir,
    directory: PathBuf,
}

impl Session {
    /// A session that has ended, with frames and journal by the engine; dataset and result by hand.
    fn new() -> Self {
        let (root, fakes) = (tempfile::tempdir().unwrap(), Fakes::default());
        let engine = fakes.engine(&root.path().join("data"));
        let id = begin(&engine);
        wait_for(&engine, &id, SessionState::Completed);
        engine.shutdown().unwrap();
        let directory = root.path().join("data/sessions").join(id);
        write_dataset(&directory);
        write_result(&directory.join("result"));
        Self { root, directory }
    }

    fn export_of(&self, result: &Path, format: &str, out: &str) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        let arguments = ["--format", format, "--out", out, "--patch", "16", "--json"];
        command.current_dir(self.root.path()).arg("export").arg(result).args(arguments).output().unwrap()
    }

    fn export(&self, format: &str, out: &str) -> Output {
        self.export_of(&self.directory.join("result"), format, out)
    }

    #[track_caller]
    fn done(&self, format: &str, out: &str) -> Value {
        let output = self.export(format, out);
        assert_eq!(output.status.code(), Some(0), "{format}: {}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    }

    fn files(&self, out: &str) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut files = BTreeMap::new();
        let mut ahead = vec![self.root.path().join(out)];
        while let Some(folder) = ahead.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    ahead.push(path);
                } else {
                    let name = path.strip_prefix(self.root.path().join(out)).unwrap().to_owned();
                    files.insert(name, fs::read(path).unwrap());
                }
            }
        }
        files
    }
}

#[track_caller]
fn refused(output: &Output, words: &[&str]) {
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    for word in words {
        assert!(error.contains(word), "{word}: {error}");
    }
}

fn distance(i: usize) -> f64 {
    let centre = SIDE as f64 / 2.0 - 0.5;
    ((i % SIDE) as f64 - centre).hypot((i / SIDE) as f64 - centre)
}

fn write(path: &Path, channels: Vec<(&str, Vec<f32>)>) {
    let channels = channels.into_iter().map(|(name, pixels)| (name.to_owned(), pixels)).collect();
    write_planes(path, Planes { origin: (0, 0), full: (SIDE, SIDE), size: (SIDE, SIDE), channels }, "").unwrap();
}

fn write_dataset(directory: &Path) {
    let text = format!(
        "format = 1\n[camera]\nprojection = \"orthographic\"\nwidth = {SIDE}\nheight = {SIDE}\n[object]\nshape = \"sphere\"\n\
         center_px = [24.0, 24.0]\nradius_px = {BALL:?}\n[[light]]\nimage = \"radiance/00.exr\"\nposition_mm = [34.0, 4.0, {:?}]\n\
         intensity = [8e3, 8e3, 8e3]\n[[light]]\nimage = \"radiance/01.exr\"\ndirection = {FAR:?}\nirradiance = [2.0, 2.0, 2.0]\n",
        NEAR[2]
    );
    fs::write(directory.join("dataset.toml"), text).unwrap();
    for light in 0..2 {
        let bright = |c: usize| -> Vec<f32> {
            let value =
                |i: usize| if distance(i) < BALL { (0.2 + 0.01 * (i % SIDE) as f32) * (1.0 + c as f32) } else { 0.0 };
            (0..SIDE * SIDE).map(value).collect()
        };
        let valid = (0..SIDE * SIDE).map(|i| f32::from(u8::from(distance(i) < BALL))).collect();
        let channels = vec![("R", bright(0)), ("G", bright(1)), ("B", bright(2)), ("valid", valid)];
        write(&directory.join(format!("radiance/0{light}.exr")), channels);
    }
}

fn write_result(folder: &Path) {
    fs::create_dir_all(folder).unwrap();
    let parameter =
        |value: f64| json!({"value": value, "standard_error": 0.01, "identified": "identified", "reason": null});
    let material = |rho_d: f64, beta: f64| {
        let [diffuse, specular] = [[rho_d, 0.8 * rho_d, 0.6 * rho_d], [0.05, 0.05, 0.04]].map(|rgb| rgb.map(parameter));
        json!({"share": 0.5, "rho_d": diffuse, "rho_s": specular, "beta": parameter(beta)})
    };
    let provenance = json!({"software": "rigd 0.1.0", "images": [], "simulated": true, "calibration": "a calibration"});
    let materials = [material(0.6, 0.1), material(0.1, 0.2)];
    let described = json!({"format": 1, "model": "ward", "gauge": "max gamma = 1 per material", "size": [SIDE, SIDE],
        "materials": materials, "provenance": provenance});
    fs::write(folder.join("material.json"), described.to_string()).unwrap();
    let map = |value: &dyn Fn(usize) -> f32| -> Vec<f32> {
        (0..SIDE * SIDE).map(|i| if distance(i) < MEASURED { value(i) } else { 0.0 }).collect()
    };
    let stripe = |i: usize| if (i % SIDE / 4).is_multiple_of(2) { 0.9 } else { 0.1 };
    let weights = vec![("material_1", map(&|i| stripe(i))), ("material_2", map(&|i| 1.0 - stripe(i)))];
    write(&folder.join("weights.exr"), weights);
    let sigma = vec![("material_1", map(&|_| 0.01)), ("material_2", map(&|_| 0.01))];
    write(&folder.join("weights_sigma.exr"), sigma);
    write(&folder.join("residual.exr"), vec![("R", map(&|_| 0.01)), ("G", map(&|_| 0.01)), ("B", map(&|_| 0.01))]);
    let valid: Vec<u8> = (0..SIDE * SIDE).map(|i| if distance(i) < MEASURED { 255 } else { 0 }).collect();
    image::save_buffer(folder.join("valid.png"), &valid, SIDE as u32, SIDE as u32, image::ColorType::L8).unwrap();
}

#[test]
fn the_same_command_writes_the_same_bytes() {
    let session = Session::new();
    for format in ["materialx", "usd", "gltf", "rti", "crate"] {
        session.done(format, "one");
        let first = session.files("one");
        fs::remove_dir_all(session.root.path().join("one")).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(5));
        session.done(format, "one");
        assert_eq!(first, session.files("one"), "{format}");
        assert!(first.len() >= 3, "{format}: {:?}", first.keys());
        fs::remove_dir_all(session.root.path().join("one")).unwrap();
    }
}

#[test]
fn the_list_of_rti_says_where_the_lights_stand() {
    let session = Session::new();
    let told = session.done("rti", "rti");
    let text = fs::read_to_string(session.root.path().join("rti/rti.lp")).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("2"));
    let directions: Vec<Vec<f64>> =
        lines.map(|line| line.split(' ').skip(1).map(|word| word.parse().unwrap()).collect()).collect();
    // y up and z towards the camera; the far light as it is in dataset.toml.
    assert_eq!(directions[1], [FAR[0], -FAR[1], -FAR[2]]);
    // The near one from the middle of the cap that the camera sees: two thirds of the radius before the centre, z = 0.
    let middle = [24.0, 24.0, -2.0 / 3.0 * BALL];
    let away = [34.0 - middle[0], middle[1] - 4.0, middle[2] - NEAR[2]];
    let length = away.iter().map(|c| c * c).sum::<f64>().sqrt();
    for c in 0..3 {
        assert!((directions[0][c] - away[c] / length).abs() < 0.01, "{directions:?}");
    }
    assert_eq!(told["loss"]["direction_deg"][0].as_f64().map(|angle| angle > 0.1), Some(true), "{told}");
    let beside: Value =
        serde_json::from_slice(&fs::read(session.root.path().join("rti/lights.json")).unwrap()).unwrap();
    assert!((beside["lights"][0]["position_mm"][2].as_f64().unwrap() - away[2]).abs() < 0.2, "{beside}");
    assert_eq!(beside["lights"][1]["position_mm"], Value::Null);
}

#[test]
fn links_and_pipes_in_a_session_are_not_followed() {
    let session = Session::new();
    let (frames, secret) = (session.directory.join("frames"), session.root.path().join("secret"));
    fs::write(&secret, "not of this session").unwrap();
    std::os::unix::fs::symlink(&secret, session.directory.join("link.txt")).unwrap();
    std::os::unix::fs::symlink(session.root.path(), session.directory.join("result/outside")).unwrap();
    nix::unistd::mkfifo(&session.directory.join("pipe"), Mode::S_IRWXU).unwrap();
    let told = session.done("crate", "bag");
    // A detour through folders that are there is none.
    session.done("crate", "data/../detour");
    assert_eq!(session.files("detour").len(), session.files("bag").len());
    let left: Vec<&str> = told["left_out"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    assert_eq!(left, ["link.txt: a link", "pipe: no regular file", "result/outside: a link"]);
    let files = session.files("bag");
    assert!(!files.values().any(|bytes| bytes.windows(19).any(|part| part == b"not of this session")));
    assert!(files.contains_key(Path::new("data/journal.jsonl")), "{:?}", files.keys());
    // A picture that is a pipe ends the export, instead of being waited for.
    let picture = session.directory.join("radiance/01.exr");
    fs::remove_file(&picture).unwrap();
    nix::unistd::mkfifo(&picture, Mode::S_IRWXU).unwrap();
    refused(&session.export("rti", "rti"), &["01.exr", "pipe (FIFO)"]);
    // A frame that is a link is no frame any more.
    let frame = fs::read_dir(frames).unwrap().next().unwrap().unwrap().path();
    fs::rename(&frame, &secret).unwrap();
    std::os::unix::fs::symlink(&secret, &frame).unwrap();
    let output = session.export("crate", "linked");
    assert!(!output.status.success(), "a link in place of a frame");
    // Nor is a folder of them.
    for folder in ["frames", "radiance"] {
        let session = Session::new();
        let moved = session.root.path().join(folder);
        fs::rename(session.directory.join(folder), &moved).unwrap();
        std::os::unix::fs::symlink(&moved, session.directory.join(folder)).unwrap();
        refused(&session.export("crate", "linked"), &[folder, "a link"]);
    }
}

#[test]
fn what_is_no_whole_session_is_refused() {
    let session = Session::new();
    let alone = session.root.path().join("alone/result");
    write_result(&alone);
    refused(
        &session.export_of(&alone, "rti", "out"),
        &["alone/result", "no dataset.toml beside it", "give the `result`"],
    );
    refused(&session.export_of(&alone, "crate", "out"), &["no manifest.json beside it", "a whole session"]);
    refused(&session.export_of(&alone, "tape", "out"), &["tape", "gltf", "crate"]);
    let inside = session.directory.join("bag");
    refused(&session.export("crate", inside.to_str().unwrap()), &["in the session itself"]);
    let detour = format!("nowhere/../{}/bag", session.directory.strip_prefix(session.root.path()).unwrap().display());
    refused(&session.export("crate", &detour), &["a folder that is not there"]);
    fs::create_dir(session.root.path().join("full")).unwrap();
    fs::write(session.root.path().join("full/mine"), "kept").unwrap();
    refused(&session.export("crate", "full"), &["full", "empty directory"]);
    assert_eq!(session.files("full").len(), 1, "what was there stays as it was");
    let frame = fs::read_dir(session.directory.join("frames")).unwrap().next().unwrap().unwrap().path();
    let whole = fs::read(&frame).unwrap();
    fs::write(&frame, &whole[..100]).unwrap();
    refused(&session.export("crate", "out"), &["not what was committed", "rigd verify"]);
    fs::write(&frame, whole).unwrap();
    let journal = session.directory.join("journal.jsonl");
    let text = fs::read_to_string(&journal).unwrap();
    let running: String = text.lines().take(3).map(|line| format!("{line}\n")).collect();
    fs::write(&journal, running).unwrap();
    refused(&session.export("crate", "out"), &["wait until it has ended"]);
    assert!(!session.root.path().join("out").exists(), "nothing is written");
}
