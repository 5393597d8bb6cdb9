//! `rigd merge` on folders as operators leave them: where it writes, and which files and times it refuses.
#![allow(clippy::unwrap_used)]

mod response_camera;

use jpeg_encoder::{ColorType, Encoder};
use response_camera::{Shoot, Tone};
use std::path::Path;
use std::process::{Command, Output};

/// A sound bracket as JPEG files with a list of times, each listed `factor` times as long as it was.
fn bracket(folder: &Path, factor: f64) {
    let mut list = String::new();
    for frame in Shoot::new(2).shot().exposures(Tone::Srgb) {
        let name = format!("{}.jpg", frame.name.replace(' ', "-"));
        let mut bytes = Vec::new();
        let (width, height) = (frame.levels.width as u16, frame.levels.height as u16);
        Encoder::new(&mut bytes, 97).encode(frame.levels.pixels.as_flattened(), width, height, ColorType::Rgb).unwrap();
        std::fs::write(folder.join(&name), bytes).unwrap();
        list += &format!("[[frame]]\nfile = {name:?}\ntime_s = {:?}\n", factor * frame.time_s);
    }
    std::fs::write(folder.join("exposures.toml"), list).unwrap();
}

fn merge(folder: &Path, extra: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rigd")).arg("merge").arg(folder).args(extra).output().unwrap()
}

/// What a refusal with exit status 2 says.
fn refusal(folder: &Path, extra: &[&str]) -> String {
    let output = merge(folder, extra);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    said
}

fn names(folder: &Path) -> Vec<String> {
    let name = |entry: std::io::Result<std::fs::DirEntry>| entry.unwrap().file_name().to_string_lossy().into_owned();
    let mut names: Vec<String> = std::fs::read_dir(folder).unwrap().map(name).collect();
    names.sort();
    names
}

#[test]
fn it_writes_one_exr_and_never_over_an_input() {
    let folder = tempfile::tempdir().unwrap();
    bracket(folder.path(), 1.0);
    let before = names(folder.path());
    let png = folder.path().join("x.png");
    let said = refusal(folder.path(), &["--out", png.to_str().unwrap()]);
    assert!(said.contains("x.png") && said.contains("ends in .exr"), "{said}");

    // A name that leads to a frame.
    let frame = folder.path().join("frame-5.jpg");
    let bytes = std::fs::read(&frame).unwrap();
    let link = folder.path().join("link.exr");
    std::os::unix::fs::symlink(&frame, &link).unwrap();
    let said = refusal(folder.path(), &["--out", link.to_str().unwrap()]);
    assert!(said.contains("read as input"), "{said}");
    assert_eq!(std::fs::read(&frame).unwrap(), bytes);
    std::fs::remove_file(&link).unwrap();
    assert_eq!(names(folder.path()), before, "a refusal leaves nothing behind");

    // A failure on the way leaves the earlier file as it was.
    let out = folder.path().join("radiance.exr");
    std::fs::write(&out, "an earlier merge").unwrap();
    std::fs::write(&frame, &bytes[..bytes.len() / 2]).unwrap();
    refusal(folder.path(), &[]);
    assert_eq!(std::fs::read(&out).unwrap(), b"an earlier merge");
    std::fs::write(&frame, &bytes).unwrap();
    let done = merge(folder.path(), &[]);
    let said = String::from_utf8_lossy(&done.stdout);
    assert!(done.status.success() && said.contains("radiance.exr"), "{said}");
    assert_eq!(std::fs::read(&out).unwrap()[..4], [0x76, 0x2f, 0x31, 0x01]);
    assert_eq!(names(folder.path()).len(), before.len() + 1);
}

#[test]
fn times_that_no_camera_has_are_refused() {
    for factor in [1e3, 1e-3] {
        let folder = tempfile::tempdir().unwrap();
        bracket(folder.path(), factor);
        let said = refusal(folder.path(), &[]);
        assert!(said.contains("frame-") && said.contains("1/80000 to 3600 s"), "{said}");
    }
}

#[test]
fn half_a_picture_with_an_end_is_called_damaged() {
    let folder = tempfile::tempdir().unwrap();
    bracket(folder.path(), 1.0);
    let frame = folder.path().join("frame-6.jpg");
    let bytes = std::fs::read(&frame).unwrap();
    std::fs::write(&frame, [&bytes[..bytes.len() / 2], b"\xff\xd9"].concat()).unwrap();
    for command in ["merge", "response"] {
        let arguments: &[&str] = if command == "merge" { &["merge"] } else { &["calibrate", "response"] };
        let output = Command::new(env!("CARGO_BIN_EXE_rigd")).args(arguments).arg(folder.path()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("frame-6.jpg: the JPEG file is damaged or cut short"), "{said}");
    }
}

/// Photographs and lists are never what a calibration is written over, whatever its name.
#[test]
fn calibrations_are_written_as_json_and_never_over_an_input() {
    let folder = tempfile::tempdir().unwrap();
    bracket(folder.path(), 1.0);
    let calibrate = |step: &str, out: &str, extra: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_rigd"))
            .args(["calibrate", step])
            .arg(folder.path())
            .args(extra)
            .arg("--out")
            .arg(folder.path().join(out))
            .output()
            .unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let picture = names(folder.path()).into_iter().find(|name| !name.ends_with(".toml")).unwrap();
    let before = std::fs::read(folder.path().join(&picture)).unwrap();
    std::fs::write(folder.path().join("camera.json"), "{}").unwrap();
    let camera = folder.path().join("camera.json").display().to_string();
    for (step, extra) in [
        ("response", &[][..]),
        ("camera", &["--board", "9x6", "--square-mm", "15"]),
        ("lights", &["--camera", &camera, "--radius-mm", "20"]),
    ] {
        let (status, said) = calibrate(step, &picture, extra);
        assert!(status == Some(2) && said.contains("ends in .json"), "{step}: {status:?} {said}");
    }
    let (status, said) = calibrate("lights", "camera.json", &["--camera", &camera, "--radius-mm", "20"]);
    assert!(status == Some(2) && said.contains("camera.json"), "{status:?} {said}");
    assert_eq!(std::fs::read_to_string(&camera).unwrap(), "{}");
    assert_eq!(std::fs::read(folder.path().join(&picture)).unwrap(), before);
}

#[test]
fn a_frame_listed_twice_and_a_lamp_that_none_is_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    bracket(folder.path(), 1.0);
    let list = folder.path().join("exposures.toml");
    let text = std::fs::read_to_string(&list).unwrap();
    std::fs::write(&list, format!("{text}{text}")).unwrap();
    assert!(refusal(folder.path(), &[]).contains("is listed twice"));
    let patch = "[reference_patch]\nx = 90\ny = 60\nwidth = 30\nheight = 30\nradiance = [1e-30, 1e30, 1.0]\n";
    std::fs::write(&list, format!("{text}{patch}")).unwrap();
    let said = refusal(folder.path(), &[]);
    assert!(said.contains("of its brightness"), "{said}");
}
