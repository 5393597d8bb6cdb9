//! Files that are not what they should be, and outputs where inputs are: `rigd fit` and `rigd relight` refuse them in words,
//! before anything is computed, and measured data are never written over.
#![allow(clippy::unwrap_used, missing_docs)]

use rigd::store::dataset;
use rigd::store::exr::{Planes, read_radiance, write_planes};
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

const SIDE: usize = 16;
const LIGHTS: [[f64; 3]; 4] = [[0.0, 0.0, -1.0], [0.5, 0.2, -0.8], [-0.4, 0.3, -0.8], [0.1, -0.5, -0.7]];

fn planes(names: &[&str], value: f32) -> Planes {
    let channels = names.iter().map(|name| ((*name).to_owned(), vec![value; SIDE * SIDE])).collect();
    Planes { origin: (0, 0), full: (SIDE, SIDE), size: (SIDE, SIDE), channels }
}

/// A matt ball of albedo 0.5 under one light, by Lambert's law.
fn write_ball(path: &Path, light: [f64; 3]) {
    let length = light.iter().map(|v| v * v).sum::<f64>().sqrt();
    let shade = |i: usize| {
        let [x, y] = [i % SIDE, i / SIDE].map(|at| (at as f64 + 0.5 - 8.0) / 6.0);
        let z = -(1.0 - x * x - y * y).max(0.0).sqrt();
        (0.5 / PI * ((x * light[0] + y * light[1] + z * light[2]) / length).max(0.0)) as f32
    };
    let mut grey = planes(&["R", "G", "B"], 0.0);
    for (_, pixels) in &mut grey.channels {
        *pixels = (0..SIDE * SIDE).map(shade).collect();
    }
    write_planes(path, grey, "").unwrap();
}

fn describe(folder: &Path, images: &[&str], object: &str) {
    let mut text = format!(
        "format = 1\n[camera]\nprojection = \"orthographic\"\nwidth = {SIDE}\nheight = {SIDE}\n[object]\nshape = \"sphere\"\ncenter_px = [8, 8]\nradius_px = 6\n{object}\n"
    );
    for (image, light) in images.iter().zip(LIGHTS) {
        text += &format!("[[light]]\nimage = {image:?}\ndirection = {light:?}\nirradiance = [1, 1, 1]\n");
    }
    fs::write(folder.join(dataset::FILE), text).unwrap();
}

/// A dataset whose images have these names.
fn ball(images: [&str; 4]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    describe(folder.path(), &images, "");
    for (image, light) in images.iter().zip(LIGHTS) {
        write_ball(&folder.path().join(image), light);
    }
    folder
}

const NAMES: [&str; 4] = ["a.exr", "b.exr", "c.exr", "d.exr"];

fn rigd(arguments: &[&Path]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rigd")).args(arguments).output().unwrap()
}

fn fit(data: &Path, out: &Path) -> Output {
    rigd(
        &["fit", "--model", "lambert", "--materials", "1"]
            .map(Path::new)
            .into_iter()
            .chain([data, Path::new("--out"), out])
            .collect::<Vec<_>>(),
    )
}

fn relight(result: &Path, lights: &Path, out: &Path) -> Output {
    rigd(&[Path::new("relight"), result, Path::new("--lights"), lights, Path::new("--out"), out])
}

#[track_caller]
fn done(output: &Output) {
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
}

#[track_caller]
fn refused(output: &Output, words: &[&str]) {
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    for word in words {
        assert!(error.contains(word), "{word}: {error}");
    }
}

/// Why a dataset is refused.
fn reasons(folder: &Path) -> String {
    dataset::read(folder).map(|_| ()).unwrap_err().to_string()
}

#[test]
fn a_fit_never_writes_over_its_dataset() {
    let data = ball(["a.exr", "residual.exr", "c.exr", "d.exr"]);
    let image = data.path().join("residual.exr");
    let before = fs::read(&image).unwrap();
    refused(&fit(data.path(), data.path()), &["residual.exr", "read as input", "another --out"]);
    // The same file by another name, and by the name that an unfinished output has.
    let out = tempfile::tempdir_in(data.path()).unwrap();
    fs::hard_link(&image, out.path().join(".unfinished-weights.exr")).unwrap();
    refused(&fit(data.path(), out.path()), &[".unfinished-weights.exr", "read as input"]);
    assert_eq!(fs::read(&image).unwrap(), before);
    assert!(!data.path().join("report.json").exists(), "nothing was computed");

    let masked = ball(NAMES);
    describe(masked.path(), &NAMES, "mask = \"valid.png\"");
    let mask = masked.path().join("valid.png");
    image::save_buffer(&mask, &[255; SIDE * SIDE], SIDE as u32, SIDE as u32, image::ExtendedColorType::L8).unwrap();
    let before = fs::read(&mask).unwrap();
    refused(&fit(masked.path(), masked.path()), &["valid.png", "read as input"]);
    assert_eq!(fs::read(&mask).unwrap(), before);

    let unlike = ball(NAMES);
    done(&fit(unlike.path(), unlike.path()));
    done(&fit(unlike.path(), unlike.path()));
}

#[test]
fn a_relit_image_is_never_written_over_a_measured_one() {
    let data = ball(["x.exr", "000.exr", "y.exr", "z.exr"]);
    let result = tempfile::tempdir().unwrap();
    done(&fit(data.path(), result.path()));
    let image = data.path().join("000.exr");
    let before = fs::read(&image).unwrap();
    refused(&relight(result.path(), data.path(), data.path()), &["000.exr", "read as input"]);
    assert_eq!(fs::read(&image).unwrap(), before);
    symlink(result.path().join("weights.exr"), result.path().join("002.exr")).unwrap();
    refused(&relight(result.path(), data.path(), result.path()), &["002.exr", "read as input"]);
    assert!(!result.path().join("000.exr").exists(), "nothing was computed");
    let out = tempfile::tempdir().unwrap();
    done(&relight(result.path(), data.path(), out.path()));
    assert_eq!(fs::read_dir(out.path()).unwrap().count(), 4);
}

#[test]
fn an_output_that_cannot_be_written_is_found_before_the_fit() {
    let data = ball(NAMES);
    let out = tempfile::tempdir().unwrap();
    fs::create_dir(out.path().join("weights.exr")).unwrap();
    refused(&fit(data.path(), out.path()), &["weights.exr: this is a directory"]);
    refused(&fit(data.path(), Path::new("/proc")), &["/proc: no file can be written here"]);
    refused(&fit(data.path(), &data.path().join("a.exr")), &["a.exr", "no directory for the result"]);
}

/// Runs rigd where no file may grow beyond so many blocks of 512 bytes, as on a full disk.
fn cramped(blocks: usize, arguments: &[&Path]) -> Output {
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
    Command::new("sh").args(["-c", &script]).arg(env!("CARGO_BIN_EXE_rigd")).args(arguments).output().unwrap()
}

#[test]
fn where_the_disk_is_full_the_earlier_result_stays_and_no_half_file_has_a_name() {
    let data = ball(NAMES);
    let out = tempfile::tempdir().unwrap();
    done(&fit(data.path(), out.path()));
    let contents = || -> Vec<(String, Vec<u8>)> {
        let entry = |e: std::io::Result<fs::DirEntry>| e.map(|e| e.path()).unwrap();
        let mut all: Vec<_> = fs::read_dir(out.path()).unwrap().map(entry).collect();
        all.sort();
        all.iter().map(|path| (path.display().to_string(), fs::read(path).unwrap())).collect()
    };
    let before = contents();
    let failed = cramped(1, &[Path::new("fit"), data.path(), Path::new("--out"), out.path()]);
    assert_eq!(failed.status.code(), Some(1), "{}", String::from_utf8_lossy(&failed.stderr));
    assert!(contents() == before, "the earlier result has changed");

    let lit = tempfile::tempdir().unwrap();
    let failed = cramped(
        1,
        &[Path::new("relight"), out.path(), Path::new("--lights"), data.path(), Path::new("--out"), lit.path()],
    );
    assert_eq!(failed.status.code(), Some(1), "{}", String::from_utf8_lossy(&failed.stderr));
    assert_eq!(fs::read_dir(lit.path()).unwrap().count(), 0, "half an image is left");
}

#[test]
fn a_material_that_does_not_say_all_is_refused() {
    let data = ball(NAMES);
    let (result, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    done(&fit(data.path(), result.path()));
    let path = result.path().join("material.json");
    let good: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    let parameter = |value: f64| json!({"value": value, "standard_error": null, "identified": "weak", "reason": null});
    let lobe = |beta: Value| {
        let mut ward = good.clone();
        ward["model"] = json!("ward");
        ward["materials"][0]["rho_s"] = json!([parameter(0.1), parameter(0.1), parameter(0.1)]);
        ward["materials"][0]["beta"] = beta;
        ward
    };
    let changed = |pointer: &str, value: Value| {
        let mut changed = good.clone();
        *changed.pointer_mut(pointer).unwrap() = value;
        changed
    };
    let twice = json!([good["materials"][0], good["materials"][0]]);
    let two_channels = json!([parameter(0.1), parameter(0.1)]);
    for (material, expected) in [
        (changed("/model", json!("banana")), "format 1 with model \"banana\""),
        (changed("/model", json!("ward")), "beta is missing"),
        (changed("/format", json!(2)), "format 2"),
        (changed("/materials", json!([])), "0 materials"),
        (changed("/materials", twice), "material.json has 2 materials"),
        (changed("/materials/0/rho_d", two_channels), "rho_d is [0.1, 0.1]: three finite"),
        (changed("/materials/0/rho_d/1/value", json!(-0.5)), "three finite values that are not negative"),
        (changed("/materials/0/beta", parameter(0.2)), "this model has no lobe"),
        (lobe(parameter(0.0)), "beta is 0: it must be finite and positive"),
        (lobe(parameter(-0.1)), "beta is -0.1"),
    ] {
        fs::write(&path, material.to_string()).unwrap();
        refused(&relight(result.path(), data.path(), out.path()), &[expected]);
    }
    fs::write(&path, lobe(parameter(0.2)).to_string()).unwrap();
    done(&relight(result.path(), data.path(), out.path()));
    fs::write(&path, changed("/materials/0/rho_d/0/value", json!(1e300)).to_string()).unwrap();
    refused(&relight(result.path(), data.path(), out.path()), &["light 0 (a.exr)", "beyond 3.4e38"]);
}

#[test]
fn a_light_beyond_single_precision_is_refused() {
    let data = ball(NAMES);
    let path = data.path().join(dataset::FILE);
    let text = fs::read_to_string(&path).unwrap();
    for strength in ["1e39", "1e-39", "inf", "0"] {
        fs::write(&path, text.replacen("irradiance = [1,", &format!("irradiance = [{strength},"), 1)).unwrap();
        assert!(reasons(data.path()).contains("light 0 (a.exr): irradiance must be positive"), "{strength}");
    }
}

fn pipe(path: &Path) {
    nix::unistd::mkfifo(path, nix::sys::stat::Mode::S_IRWXU).unwrap();
}

#[test]
fn a_description_that_is_no_file_or_has_no_end_is_refused_at_once() {
    for (name, expected) in [("pipe", "this is a pipe (FIFO)"), ("zero", "this is a device"), ("large", "larger than")]
    {
        let data = ball(NAMES);
        let path = data.path().join(dataset::FILE);
        fs::remove_file(&path).unwrap();
        match name {
            "pipe" => pipe(&path),
            "zero" => symlink("/dev/zero", &path).unwrap(),
            _ => fs::File::create(&path).unwrap().set_len(1 << 34).unwrap(),
        }
        assert!(reasons(data.path()).contains(expected), "{}", reasons(data.path()));
    }
    let folder = tempfile::tempdir().unwrap();
    for (name, command) in [("exposures.toml", "merge"), ("material.json", "relight")] {
        pipe(&folder.path().join(name));
        let lights = [Path::new("--lights"), folder.path(), Path::new("--out"), Path::new("x")];
        let lights: &[&Path] = if command == "merge" { &[] } else { &lights };
        let output = rigd(&[&[Path::new(command), folder.path()], lights].concat());
        refused(&output, &[name, "this is a pipe (FIFO)"]);
    }
}

#[test]
fn an_image_that_is_no_file_is_said_to_be_what_it_is() {
    for ending in ["exr", "png"] {
        let name = format!("a.{ending}");
        let data = ball(NAMES);
        let path = data.path().join(&name);
        describe(data.path(), &[&name, "b.exr", "c.exr", "d.exr"], "");
        let _ = fs::remove_file(&path);
        let says = |expected: &str| assert!(reasons(data.path()).contains(expected), "{}", reasons(data.path()));
        says("there is no such");
        for (target, expected) in [
            ("/nonexistent/a", "this link points to /nonexistent/a, where nothing is"),
            ("/dev/zero", "this is a device"),
            (name.as_str(), "cannot be reached"),
        ] {
            symlink(target, &path).unwrap();
            says(expected);
            fs::remove_file(&path).unwrap();
        }
        pipe(&path);
        says("this is a pipe (FIFO)");
        fs::remove_file(&path).unwrap();
        fs::write(&path, "").unwrap();
        says("the file is empty");
        fs::write(&path, "no picture").unwrap();
        says("whatever its name says: convert it".split_at(if ending == "exr" { 0 } else { 24 }).1);
        fs::remove_file(&path).unwrap();
        fs::create_dir(&path).unwrap();
        says("this is a directory");
    }
    let data = ball(NAMES);
    let whole = fs::read(data.path().join("a.exr")).unwrap();
    for length in [20, 300, whole.len() - 8] {
        fs::write(data.path().join("a.exr"), &whole[..length]).unwrap();
        assert!(
            reasons(data.path()).contains("damaged or cut short: write or copy it again"),
            "{}",
            reasons(data.path())
        );
    }
}

#[test]
fn a_mask_that_leaves_nothing_or_is_no_picture_is_refused() {
    let data = ball(NAMES);
    describe(data.path(), &NAMES, "mask = \"mask.png\"");
    let mask = data.path().join("mask.png");
    image::save_buffer(&mask, &[0; SIDE * SIDE], SIDE as u32, SIDE as u32, image::ExtendedColorType::L8).unwrap();
    assert!(reasons(data.path()).contains("every pixel of the mask is zero"), "{}", reasons(data.path()));
    fs::copy(data.path().join("a.exr"), &mask).unwrap();
    assert!(reasons(data.path()).ends_with("convert it to PNG or TIFF"), "{}", reasons(data.path()));
}

#[test]
fn one_file_under_two_lights_is_found_whatever_leads_there() {
    let data = ball(NAMES);
    let above = format!("../{}/a.exr", data.path().file_name().unwrap().to_str().unwrap());
    symlink("a.exr", data.path().join("link.exr")).unwrap();
    fs::hard_link(data.path().join("a.exr"), data.path().join("hard.exr")).unwrap();
    for name in [above.as_str(), "link.exr", "hard.exr"] {
        describe(data.path(), &["a.exr", name, "c.exr"], "");
        let expected = format!("lights 0 and 1 use the same image {name}");
        assert!(reasons(data.path()).contains(&expected), "{name}: {}", reasons(data.path()));
    }
    // A copy is another file: that two pictures are equal is not for the reader to judge.
    fs::copy(data.path().join("a.exr"), data.path().join("copy.exr")).unwrap();
    describe(data.path(), &["a.exr", "copy.exr", "c.exr"], "");
    dataset::read(data.path()).unwrap();
}

#[test]
fn colours_and_variances_in_part_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let read = |names: &[&str]| {
        write_planes(&path, planes(names, 0.5), "").unwrap();
        read_radiance(&path, (SIDE, SIDE)).map(|image| image.variance.is_some()).map_err(|e| e.to_string())
    };
    assert_eq!(read(&["R", "G", "B"]), Ok(false));
    assert_eq!(read(&["Y", "valid"]), Ok(false));
    assert_eq!(read(&["Y", "variance.R", "variance.G", "variance.B"]), Ok(true));
    for (names, expected) in [
        (&["R", "G", "B", "variance.R"][..], "without variance.G, variance.B"),
        (&["R", "G", "Y"], "without B"),
        (&["Y", "variance.Y"], "without variance.R, variance.G, variance.B"),
        (&["Q"], "it has the channels Q; R, G and B (or Y) are needed"),
    ] {
        let found = read(names).unwrap_err();
        assert!(found.contains(expected), "{names:?}: {found}");
    }
}

#[test]
fn a_frame_for_which_there_is_no_memory_is_refused_in_words() {
    let data = tempfile::tempdir().unwrap();
    let mut crop = planes(&["R", "G", "B"], 0.1);
    crop.full = (10_000, 10_000);
    write_planes(&data.path().join("a.exr"), crop, "").unwrap();
    describe(data.path(), &["a.exr"], "");
    let path = data.path().join(dataset::FILE);
    let text = fs::read_to_string(&path).unwrap().replace(&format!(" = {SIDE}\n"), " = 10000\n");
    fs::write(&path, text).unwrap();
    // 3 GiB of address space: enough for the program, not for 10^8 pixels and the maps of their result.
    let script = "ulimit -v 3145728; exec \"$0\" \"$@\"";
    let mut command = Command::new("sh");
    command.args(["-c", script]).arg(env!("CARGO_BIN_EXE_rigd")).arg("fit").arg(data.path());
    let output = command.arg("--out").arg(data.path().join("out")).output().unwrap();
    refused(&output, &["a.exr: no memory for a frame of 10000 x 10000 pixels", "cut images and camera"]);
}

#[test]
fn control_characters_in_names_do_not_reach_the_terminal() {
    let data = ball(NAMES);
    let path = data.path().join(dataset::FILE);
    let text = fs::read_to_string(&path).unwrap().replace("a.exr", "a\\u001B[2J\\n.exr");
    fs::write(&path, text).unwrap();
    let output = fit(data.path(), &data.path().join("out"));
    refused(&output, &["a\\u{1b}[2J\\n.exr: there is no such OpenEXR file"]);
    assert!(!output.stderr.contains(&0x1b));
}

#[test]
fn an_unknown_lobe_is_refused_also_where_the_model_has_none() {
    let data = ball(NAMES);
    let arguments = ["fit", "--model", "lambert", "--lobe", "banana"].map(Path::new);
    refused(&rigd(&[&arguments[..], &[data.path()]].concat()), &["unknown lobe \"banana\""]);
}
