//! The command: files in, files out, and what it refuses.

use rigd::numerics::image::Image;
use rigd::pipeline::calibration::response::{Expected, Method, ResponseCalibration};
use rigd::pipeline::report::{GAUGE, Identified, MaterialFile, MaterialReport, Parameter, Provenance};
use rigd::store::exr::{Planes, read_radiance, write_planes};
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

const SIDE: usize = 48;
/// Radius of the measured disc, pixels: the largest square in it has a side of 28.
const RADIUS: f64 = 19.5;

fn parameter(value: f64) -> Parameter {
    Parameter { value, standard_error: Some(0.01), identified: Identified::Identified, reason: None }
}

fn material() -> MaterialFile {
    let one = |rho_d: f64, beta: f64| MaterialReport {
        share: 0.5,
        rho_d: [rho_d, 0.8 * rho_d, 0.6 * rho_d].map(parameter).to_vec(),
        rho_s: [0.05; 3].map(parameter).to_vec(),
        beta: Some(parameter(beta)),
    };
    MaterialFile {
        format: 1,
        model: "ward".to_owned(),
        gauge: GAUGE.to_owned(),
        materials: vec![one(0.6, 0.1), one(0.1, 0.2)],
        size: [SIDE, SIDE],
        provenance: Provenance { software: "test".to_owned(), images: Vec::new(), simulated: None, calibration: None },
    }
}

/// A disc of stripes of two materials, as a result.
fn write_result(folder: &Path) {
    fs::create_dir_all(folder).unwrap();
    fs::write(folder.join("material.json"), serde_json::to_string(&material()).unwrap()).unwrap();
    let centre = SIDE as f64 / 2.0 - 0.5;
    let inside = |i: usize| ((i % SIDE) as f64 - centre).hypot((i / SIDE) as f64 - centre) < RADIUS;
    let stripe = |i: usize| if (i % SIDE / 4).is_multiple_of(2) { 0.9 } else { 0.1 };
    let write = |name: &str, value: &dyn Fn(usize, usize) -> f32| {
        let plane = |m: usize| {
            let pixels = (0..SIDE * SIDE).map(|i| if inside(i) { value(m, i) } else { 0.0 }).collect();
            (format!("material_{}", m + 1), pixels)
        };
        let channels = vec![plane(0), plane(1)];
        let planes = Planes { origin: (0, 0), full: (SIDE, SIDE), size: (SIDE, SIDE), channels };
        write_planes(&folder.join(name), planes, "").unwrap();
    };
    write("weights.exr", &|m, i| if m == 0 { stripe(i) } else { 1.0 - stripe(i) });
    write("weights_sigma.exr", &|_, _| 0.01);
}

struct Folder {
    root: TempDir,
}

impl Folder {
    fn new() -> Self {
        let root = tempfile::tempdir().unwrap();
        write_result(&root.path().join("result"));
        Self { root }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.root.path().join(name)
    }

    /// `rigd render result --patch 16 ...` in this folder, small unless a size is given.
    fn render(&self, arguments: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        command.current_dir(self.root.path()).args(["render", "result", "--patch", "16"]).args(arguments);
        if !arguments.contains(&"--size") {
            command.args(["--size", "64x48"]);
        }
        command.output().unwrap()
    }

    #[track_caller]
    fn refused(&self, arguments: &[&str], words: &[&str]) {
        let output = self.render(arguments);
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{error}");
        for word in words {
            assert!(error.contains(word), "{word}: {error}");
        }
        assert!(!self.path("out/render.exr").exists(), "nothing is written");
    }
}

#[track_caller]
fn done(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn png(path: &Path) -> Image<[u8; 3]> {
    let picture = image::open(path).unwrap().to_rgb8();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    Image { width, height, pixels: picture.pixels().map(|pixel| pixel.0).collect() }
}

#[test]
fn radiance_and_levels_are_written_and_agree() {
    let folder = Folder::new();
    let response = ResponseCalibration {
        method: Method::Debevec,
        log_exposure: [1.8, 2.0, 2.2]
            .map(|power| (0..256).map(|z| power * (f64::from(z).max(0.2) / 128.0).ln()).collect()),
        active_constraints: [0; 3],
        pixels: 0,
        exposures: Vec::new(),
        reference: String::new(),
        expected: Expected::Nominal,
        gauge: String::new(),
        exponent_sigma: 0.0,
        scatter_nominal: None,
        scatter_power_of_two: None,
        warnings: Vec::new(),
    };
    fs::write(folder.path("response.json"), serde_json::to_string(&response).unwrap()).unwrap();
    let said =
        done(&folder.render(&["--out", "out", "--response", "response.json", "--exposure", "1.5", "--samples", "2"]));
    for words in
        ["70000 triangles", "16 x 16 weights from column 14, row 14", "1.5 s through the response of response.json"]
    {
        assert!(said.contains(words), "{words}: {said}");
    }
    let radiance = read_radiance(&folder.path("out/render.exr"), (64, 48)).unwrap();
    let levels = png(&folder.path("out/render.png"));
    let mut shown = 0;
    for (i, pixel) in levels.pixels.iter().enumerate() {
        for c in 0..3 {
            // By the power law that the response was made of.
            let exposure = 1.5 * f64::from(radiance.radiance.pixels[i][c]);
            let level = (128.0 * exposure.powf(1.0 / [1.8, 2.0, 2.2][c])).min(255.0);
            assert!((level - f64::from(pixel[c])).abs() < 0.6, "pixel {i}: {level}, {pixel:?}");
        }
        assert!(radiance.valid.pixels[i] || *pixel == [0; 3]);
        shown += usize::from(pixel[0] > 20);
    }
    assert!(shown > 300, "{shown} pixels show something");
}

#[test]
fn the_same_command_writes_the_same_bytes() {
    let folder = Folder::new();
    fs::write(folder.path("roof.obj"), "v -1 0 0\nv 1 0 0\nv 0 1 -1\nv 0 1 1\nf 1 2 3\nf 1 4 2\nf 1 1 2\n").unwrap();
    let lamp = ["--light-position", "-1,2,3", "--intensity", "20,18,15", "--camera", "-1,2,4", "--look-at", "0,0.5,0"];
    let arguments = |out: &'static str| [&["--mesh", "roof.obj", "--out", out][..], &lamp].concat();
    let said = done(&folder.render(&arguments("a")));
    assert!(said.contains("2 triangles (1 without area left out), without texture coordinates"), "{said}");
    assert!(said.contains("through the levels of sRGB"), "{said}");
    done(&folder.render(&arguments("b")));
    for name in ["render.exr", "render.png"] {
        assert_eq!(fs::read(folder.path("a").join(name)).unwrap(), fs::read(folder.path("b").join(name)).unwrap());
    }
    assert!(png(&folder.path("a/render.png")).pixels.iter().filter(|pixel| pixel[0] > 20).count() > 200);
}

#[test]
fn what_cannot_be_rendered_is_refused_in_words() {
    let folder = Folder::new();
    fs::write(folder.path("broken.obj"), "v 0 0 0\nf 1 2 3\n").unwrap();
    fs::write(folder.path("flat.stl"), "solid").unwrap();
    fs::write(
        folder.path("reaches.gltf"),
        r#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":4,"uri":"../secret"}]}"#,
    )
    .unwrap();
    fs::write(folder.path("none.json"), "{}").unwrap();
    let out = ["--out", "out"];
    let refusals: [(&[&str], &[&str]); 18] = [
        (&["--mesh", "broken.obj"], &["broken.obj", "face vertex index out of bounds", "export the mesh again"]),
        (&["--mesh", "flat.stl"], &["flat.stl", ".obj, .gltf or .glb", "sphere, cylinder, knot"]),
        (&["--mesh", "missing.obj"], &["missing.obj", "no such mesh"]),
        (&["--mesh", "reaches.gltf"], &["reaches.gltf", "buffer 0 (../secret)", "beside the mesh"]),
        (&["--response", "none.json"], &["none.json"]),
        (&["--response", "missing.json"], &["missing.json", "no such response"]),
        (&["--camera", "0,0"], &["three numbers"]),
        (&["--camera", "1,2,3", "--look-at", "1,2,3"], &["--camera, --look-at", "two different points"]),
        (&["--camera", "0,0,9", "--look-at", "0,0,99"], &["nothing of the mesh is in the picture"]),
        (&["--field", "180"], &["180 degrees"]),
        (&["--exposure", "-1"], &["more than 0 s"]),
        (&["--light-direction", "0,0,0"], &["a direction has a length"]),
        (&["--light-position", "1,2,3"], &["--intensity"]),
        (&["--light-position", "1,2,3", "--intensity", "1", "--irradiance", "1"], &["--irradiance"]),
        (&["--irradiance", "3,4"], &["one number, or three"]),
        (&["--irradiance", "1e39"], &["numbers from 1.2e-38 to 3.4e38"]),
        (
            &["--mesh", "cylinder", "--light-position", "0,0,1.01", "--intensity", "3e38"],
            &["the radiance at column", "beyond 3.4e38", "less strength"],
        ),
        (&["--size", "0x5"], &["columns and rows, as in 1024x768"]),
    ];
    for (arguments, words) in refusals {
        folder.refused(&[arguments, &out].concat(), words);
    }
}

#[test]
fn a_result_without_a_measured_square_is_refused_with_the_largest_there_is() {
    let folder = Folder::new();
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    let output = command.current_dir(folder.root.path()).args(["render", "result", "--out", "out"]).output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(error.contains("no square of 80 x 80 pixels is measured throughout; the largest one has 28"), "{error}");
    assert!(error.contains("give a smaller --patch"), "{error}");
    fs::remove_file(folder.path("result/weights_sigma.exr")).unwrap();
    folder.refused(&["--out", "out"], &["weights_sigma.exr", "no such OpenEXR file"]);
}

#[test]
fn a_file_that_is_read_is_never_written_over() {
    let folder = Folder::new();
    fs::create_dir(folder.path("out")).unwrap();
    fs::write(folder.path("roof.obj"), "v -1 0 0\nv 1 0 0\nv 0 1 -1\nf 1 2 3\n").unwrap();
    fs::hard_link(folder.path("roof.obj"), folder.path("out/render.png")).unwrap();
    folder.refused(&["--out", "out", "--mesh", "roof.obj"], &["render.png", "read as input"]);
    assert!(fs::read_to_string(folder.path("roof.obj")).unwrap().starts_with("v -1 0 0"));
    // What lies under the names of unfinished files may be a link to anything.
    fs::remove_file(folder.path("out/render.png")).unwrap();
    for (name, link) in [("symbolic", std::os::unix::fs::symlink as fn(PathBuf, PathBuf) -> _), ("hard", fs::hard_link)]
    {
        fs::write(folder.path(name), "mine").unwrap();
        link(folder.path(name), folder.path("out/.unfinished-render.png")).unwrap();
        done(&folder.render(&["--out", "out"]));
        assert_eq!(fs::read_to_string(folder.path(name)).unwrap(), "mine", "{name}");
    }
}

#[test]
fn a_path_that_is_no_text_is_told_all_the_same() {
    let folder = Folder::new();
    let out = std::ffi::OsStr::from_bytes(b"out-\xff");
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command.current_dir(folder.root.path()).args(["render", "result", "--patch", "16", "--size", "16x16", "--json"]);
    let told = done(&command.arg("--out").arg(out).output().unwrap());
    assert!(told.contains("out-") && told.contains("render.exr"), "{told}");
}
