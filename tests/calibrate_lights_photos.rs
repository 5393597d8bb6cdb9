//! Light directions from the chrome sphere of real photographs, and `rigd calibrate lights` on a folder.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rigd::numerics::calibration::lights::highlight::{self, Spots};
use rigd::numerics::calibration::lights::{balls, mirror};
use rigd::numerics::geometry::{Projection, Sphere, Vec3};
use rigd::numerics::image::Image;
use rigd::pipeline::calibration::lights::LightsCalibration;
use rigd::pipeline::decode::decode;
use rigd::study::lights::forward::Rig;
use rigd::study::lights::render::{Exposure, frame};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn photographs() -> Option<PathBuf> {
    let root = std::env::var_os("RIGD_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let folder = root.join("data/sphere-photos");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: {} is not there; set RIGD_SHARED to the folder that holds data/", folder.display());
    None
}

/// Levels as they are: these photographs are linear.
fn read(path: &Path) -> Spots {
    let picture = decode(&std::fs::read(path).unwrap()).unwrap();
    let grey = |p: &[u8; 3]| p.iter().map(|&c| f32::from(c)).sum::<f32>() / 765.0;
    let (width, height) = (picture.width, picture.height);
    Spots {
        level: Image { width, height, pixels: picture.pixels.iter().map(grey).collect() },
        clipped: Image { width, height, pixels: picture.pixels.iter().map(|p| p.iter().any(|&c| c >= 250)).collect() },
    }
}

/// Directions that ship with the photographs (y up, z towards the camera there), in the camera frame.
fn given(folder: &Path) -> Vec<Vec3> {
    let text = std::fs::read_to_string(folder.join("lights_from_chrome_sphere.txt")).unwrap();
    let vector = |line: &str| {
        let v: Vec<f64> = line.split_whitespace().map(|n| n.parse().unwrap()).collect();
        Vec3::new(v[0], -v[1], -v[2]).normalize()
    };
    text.lines().map(vector).collect()
}

/// Largest angle (degrees) to the given directions of those found with the sphere's outline from `silhouette`.
fn worst_degrees(folder: &Path, silhouette: &Image<f32>, photos: &[Spots]) -> f64 {
    let projection = Projection::Orthographic { mm_per_px: 1.0 };
    let found = balls::find(silhouette, &projection, 1.0, 1);
    assert_eq!(found.balls.len(), 1, "{:?}", found.rejected);
    let ball = &found.balls[0];
    let sphere = Sphere { center: ball.center, radius: ball.radius };
    let degrees = photos.iter().zip(given(folder)).map(|(photo, given)| {
        let spot = highlight::find(photo, &projection, ball).unwrap();
        assert!(spot.clipped > 0, "the spots of these photographs are clipped");
        let ray = mirror::mirror_ray(&projection, &sphere, spot.at).unwrap();
        ray.direction.angle(&given).to_degrees()
    });
    degrees.fold(0.0, f64::max)
}

#[test]
fn directions_from_the_chrome_sphere() {
    let Some(folder) = photographs() else { return };
    let photos: Vec<Spots> = (0..12).map(|i| read(&folder.join(format!("chrome/chrome.{i}.png")))).collect();
    let outlined = worst_degrees(&folder, &read(&folder.join("chrome/chrome.mask.png")).level, &photos);
    assert!(outlined < 0.5, "{outlined} degrees with the outline picture");
    // The photographs alone show the upper part of the outline at less than one level of 255.
    let mut mean = Image::filled(512, 340, 0.0_f32);
    for photo in &photos {
        mean.pixels.iter_mut().zip(&photo.level.pixels).for_each(|(m, l)| *m += l / 12.0);
    }
    let alone = worst_degrees(&folder, &mean, &photos);
    assert!(alone < 2.0, "{alone} degrees from the photographs alone");
    eprintln!("largest angle: {outlined:.3} degrees with the outline picture, {alone:.3} without");
}

fn save(image: &Image<f32>, path: &Path) {
    let srgb = |l: f32| if l <= 0.003_130_8 { 12.92 * l } else { 1.055 * l.powf(1.0 / 2.4) - 0.055 };
    let bytes: Vec<u8> = image.pixels.iter().map(|l| (255.0 * srgb(*l) + 0.5) as u8).collect();
    let (width, height) = (image.width as u32, image.height as u32);
    image::save_buffer(path, &bytes, width, height, image::ExtendedColorType::L8).unwrap();
}

fn rigd(folder: &Path, camera: &str, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command.args(["calibrate", "lights"]).arg(folder).arg("--camera").arg(folder.join(camera));
    command.args(["--radius-mm", "20"]).args(more).output().unwrap()
}

/// 8-bit pictures in a folder, by the command.
#[test]
fn a_folder_of_pictures_gives_the_lights() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(5);
    let rig = Rig::draw(0.25, &mut random);
    let mut list = String::new();
    for lamp in [0, 2, 3, 4] {
        for (kind, exposure) in [("s", &Exposure::SILHOUETTE), ("h", &Exposure::HIGHLIGHT)] {
            let image = frame(&rig, lamp, exposure, &[[0.0; 2]; 3], &mut random);
            save(&image, &folder.path().join(format!("{kind}{lamp}.png")));
        }
        list += &format!(
            "[[light]]\nangle_deg = {:.1}\nsilhouette = \"s{lamp}.png\"\nhighlight = \"h{lamp}.png\"\n",
            rig.angles_deg[lamp]
        );
    }
    std::fs::write(folder.path().join("lights.toml"), &list).unwrap();
    let Projection::Pinhole { focal_px, principal_px, distortion } = &rig.projection else { panic!() };
    let camera = serde_json::json!({ "width": rig.size.0, "height": rig.size.1, "focal_px": focal_px,
        "principal_px": principal_px, "distortion": distortion, "reprojection_rms_px": 0.1 });
    std::fs::write(folder.path().join("camera.json"), camera.to_string()).unwrap();

    let out = folder.path().join("lights.json");
    let output = rigd(folder.path(), "camera.json", &["--json", "--out", out.to_str().unwrap()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: LightsCalibration = serde_json::from_slice(&output.stdout).unwrap();
    for (light, lamp) in found.lights.iter().zip([0, 2, 3, 4]) {
        let error = (Vec3::from(light.position_mm) - rig.lamps[lamp]).norm();
        assert!(error < 8.0, "{error} mm: {light:?}");
    }
    let written: LightsCalibration = serde_json::from_str(&std::fs::read_to_string(&out).unwrap()).unwrap();
    assert_eq!(written, found);

    let refused = |list: &str, word: &str| {
        std::fs::write(folder.path().join("lights.toml"), list).unwrap();
        let output = rigd(folder.path(), "camera.json", &[]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(word), "{said}");
    };
    refused(&list.replace("angle_deg", "angle"), "angle");
    refused(&list.replace("h3.png", "gone.png"), "gone.png");
    refused(&format!("{list}card = \"h3.png\"\n"), "[card]");
    std::fs::write(folder.path().join("h3.png"), b"\x89PNG\r\n\x1a\n cut").unwrap();
    refused(&list, "h3.png");
    std::fs::remove_file(folder.path().join("lights.toml")).unwrap();
    assert_eq!(rigd(folder.path(), "camera.json", &[]).status.code(), Some(2));
}
