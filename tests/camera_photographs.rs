//! Camera calibration from picture files: OpenCV's chessboard photographs against OpenCV's result, and rendered boards with every
//! fault an operator makes.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod board_camera;

use board_camera::*;
use rigd::numerics::geometry::{Projection, Vec3};
use rigd::numerics::image::Image;
use rigd::pipeline::calibration::camera::{Board, CameraCalibration, CameraCalibrationError, board_pose, find_board};
use serde_json::Value;
use std::process::Command;

#[test]
fn agrees_with_opencv_on_the_same_photographs() {
    let Some(folder) = photographs() else { return };
    let oracle: Value = serde_json::from_str(include_str!("oracle/camera.json")).unwrap();
    for name in ["left", "right"] {
        let files = side(&folder, name);
        let found = calibrated(&files, &Board { square_mm: 25.0, ..BOARD }).unwrap();
        assert!(found.views.iter().all(|view| view.rejected.is_none() && view.corners == 54), "{:?}", found.views);
        let theirs = &oracle[name]["product_window"][&found.held.join(" ")];
        let number = |value: &Value| value.as_f64().unwrap();
        let rms = found.rms_px / number(&theirs["rms_px"]) - 1.0;
        assert!(rms.abs() < 0.01, "{name}: rms {} px", found.rms_px);
        for window in ["product_window", "usual_window"] {
            let theirs = &oracle[name][window][&found.held.join(" ")];
            for i in 0..2 {
                let focal = found.focal_px[i] / number(&theirs["focal_px"][i]) - 1.0;
                assert!(focal.abs() < 0.003, "{name} {window}: focal length {} px", found.focal_px[i]);
                let principal = found.principal_px[i] - number(&theirs["principal_px"][i]);
                assert!(
                    principal.abs() < 2.0 * found.sigma.principal_px[i],
                    "{name} {window}: {:?}",
                    found.principal_px
                );
            }
        }
    }
}

#[test]
fn corners_of_a_rendered_board_lie_where_they_are() {
    for (i, place) in places(4).iter().enumerate() {
        let found = find_board("rendered", &render(place, CLEAR, i as u64), &BOARD).unwrap();
        let error2 = |corner: &rigd::numerics::calibration::camera::Corner| {
            let [x, y] = CAMERA.project(&place.at(corner.board_mm));
            (corner.pixel[0] - x).powi(2) + (corner.pixel[1] - y).powi(2)
        };
        let worst = found.view.corners.iter().map(error2).fold(0.0, f64::max).sqrt();
        let rms = (found.view.corners.iter().map(error2).sum::<f64>() / 54.0).sqrt();
        println!(
            "view {i}: corners {rms:.3} px rms from the truth, {worst:.3} at worst, edges {:.1} px",
            found.quality.edge_px
        );
        assert!(rms < 0.06, "view {i}: {rms} px");
    }
}

#[test]
fn a_rendered_camera_comes_back_within_its_uncertainty() {
    let found = calibrated(&files(12), &BOARD).unwrap();
    assert!(found.views.iter().all(|view| view.rejected.is_none()), "{:?}", found.views);
    for (value, truth, sigma) in [
        (found.focal_px[0], 900.0, found.sigma.focal_px[0]),
        (found.principal_px[0], 246.0, found.sigma.principal_px[0]),
        (found.principal_px[1], 177.0, found.sigma.principal_px[1]),
        (found.distortion[0], -0.2, found.sigma.distortion[0]),
    ] {
        assert!((value - truth).abs() < 4.0 * sigma, "{value} +- {sigma}, truth {truth}");
    }
    assert!(found.sigma.focal_px[0] / 900.0 < 3e-3 && found.rms_px < 0.06, "{:?} {}", found.sigma, found.rms_px);
    let stored: CameraCalibration = serde_json::from_str(&serde_json::to_string(&found).unwrap()).unwrap();
    assert_eq!(stored, found);
    assert_eq!(
        found.projection(),
        Projection::Pinhole {
            focal_px: found.focal_px,
            principal_px: found.principal_px,
            distortion: found.distortion
        }
    );
}

#[test]
fn the_pose_of_a_board_in_one_picture_is_the_true_one() {
    let place = Place { tilt_deg: 25.0, axis: 1.0, spin: 0.2, middle: [10.0, -5.0, 600.0] };
    let found = board_pose("card", &render(&place, CLEAR, 1), &BOARD, &CAMERA).unwrap();
    let away = (found.pose.place([80.0, 50.0]) - Vec3::from(place.middle)).norm();
    let tilt = found.pose.normal().angle(&(place.rotation() * Vec3::z())).to_degrees();
    assert!(away < 1.0 && tilt < 0.3, "{away} mm, {tilt} degrees");
    // The first corner is told by the colours, so that a card beside the board is found.
    let first = (found.pose.place([0.0, 0.0]) - place.at([0.0, 0.0])).norm();
    assert!(first < 1.5, "{first} mm");
    let upside_down = Place { spin: 0.2 + std::f64::consts::PI, ..place };
    let turned = board_pose("card", &render(&upside_down, CLEAR, 2), &BOARD, &CAMERA).unwrap();
    assert!((turned.pose.place([0.0, 0.0]) - upside_down.at([0.0, 0.0])).norm() < 1.5);
}

#[test]
fn every_bad_photograph_is_named_and_left_out() {
    let mut all = files(7);
    let places = places(12);
    let mut add = |name: &str, bytes: Vec<u8>| all.push((name.to_owned(), bytes));
    add("blurred.png", png(&render(&places[7], Look { blur: 9, ..CLEAR }, 1)));
    add("bright.png", png(&render(&places[8], Look { white: 900.0, black: 400.0, ..CLEAR }, 1)));
    add("dark.png", png(&render(&places[9], Look { white: 14.0, black: 12.0, ..CLEAR }, 1)));
    add("cut.png", png(&render(&Place { middle: [75.0, 0.0, 600.0], ..places[10] }, CLEAR, 1)));
    let clear = render(&places[11], CLEAR, 1);
    let upright = (0..SIZE.0 * SIZE.1).map(|p| *clear.at(p / SIZE.1, p % SIZE.1)).collect();
    add("upright.png", png(&Image { width: SIZE.1, height: SIZE.0, pixels: upright }));
    let crop = Image { height: SIZE.1 - 8, pixels: clear.pixels[..SIZE.0 * (SIZE.1 - 8)].to_vec(), ..clear };
    add("cropped.png", png(&crop));
    add("again.png", png(&render(&places[2], CLEAR, 99)));
    let short = png(&render(&places[3], CLEAR, 3));
    add("short.png", short[..short.len() / 2].to_vec());
    add("text.png", b"not a picture".to_vec());
    let found = calibrated(&all, &BOARD).unwrap();
    let reason = |name: &str| {
        let view = found.views.iter().find(|view| view.name == name).unwrap();
        view.rejected.clone().unwrap_or_else(|| panic!("{name} was used"))
    };
    for (name, words) in [
        ("blurred.png", "blurred"),
        ("bright.png", "expose less"),
        ("dark.png", "expose more"),
        ("cut.png", "out of view"),
        ("upright.png", "turned against the others"),
        ("cropped.png", "it is 480x352, most are 480x360"),
        ("again.png", "exactly where view02.png does"),
        ("short.png", "damaged or cut short"),
        ("text.png", "neither JPEG"),
    ] {
        assert!(reason(name).contains(words), "{name}: {}", reason(name));
    }
    assert_eq!(found.views.iter().filter(|view| view.rejected.is_none()).count(), 7);
    assert!(found.warnings.iter().any(|warning| warning.contains("only 7 views")), "{:?}", found.warnings);
}

#[test]
fn a_wrong_board_or_too_few_views_are_refused() {
    let all = files(4);
    let error = calibrated(&all[..2], &BOARD).unwrap_err().to_string();
    assert!(error.contains("2 good photographs of the board out of 2"), "{error}");
    for (columns, rows, words) in [(8, 5, "larger than the board named"), (10, 7, "corners found"), (2, 6, "3 to 60")] {
        let error = calibrated(&all, &Board { columns, rows, ..BOARD }).unwrap_err().to_string();
        assert!(error.contains(words), "{columns}x{rows}: {error}");
    }
    for square_mm in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(calibrated(&all, &Board { square_mm, ..BOARD }), Err(CameraCalibrationError::Board(_))));
    }
}

#[test]
fn views_that_never_turn_leave_the_focal_length_open() {
    let flat = |i: usize| Place {
        tilt_deg: 0.0,
        axis: 0.0,
        spin: 0.0,
        middle: [6.0 * i as f64 - 12.0, 9.0 - 5.0 * i as f64, 600.0 + i as f64],
    };
    let all: Vec<_> = (0..5).map(|i| (format!("flat{i}.png"), png(&render(&flat(i), CLEAR, i as u64)))).collect();
    let error = calibrated(&all, &BOARD).unwrap_err().to_string();
    assert!(error.contains("tilt the board"), "{error}");
}

#[test]
fn the_command_writes_the_report_and_refuses_in_words() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files(8) {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let run = |extra: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        command.args(["calibrate", "camera"]).arg(folder.path()).args(extra).output().unwrap()
    };
    let out = folder.path().join("camera.json");
    let board = ["--board", "9x6", "--square-mm", "20"];
    let done = run(&[&board[..], &["--json", "--out", out.to_str().unwrap()]].concat());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let printed: CameraCalibration = serde_json::from_slice(&done.stdout).unwrap();
    let written: CameraCalibration = serde_json::from_slice(&std::fs::read(out).unwrap()).unwrap();
    assert_eq!(printed, written);
    let text = String::from_utf8(run(&board).stdout).unwrap();
    assert!(text.contains("8 of 8 photographs used") && text.contains("tangential distortion p1, p2"), "{text}");
    for (arguments, words) in [
        (["--board", "9by6", "--square-mm", "20"], "COLUMNSxROWS"),
        (["--board", "9x6", "--square-mm", "-3"], "square"),
        (["--board", "12x9", "--square-mm", "20"], "good photographs"),
    ] {
        let refused = run(&arguments);
        assert_eq!(refused.status.code(), Some(2));
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(said.contains(words), "{said}");
    }
}

/// The guide's picture: `cargo test --test camera_photographs -- --ignored picture` writes it again.
#[test]
#[ignore = "writes docs/camera-corners.png, by hand when the picture is to change: cargo test --test camera_photographs -- --ignored"]
fn picture_of_found_corners() {
    let place = Place { tilt_deg: 28.0, axis: 0.9, spin: 0.15, middle: [0.0, 0.0, 560.0] };
    let mut picture = render(&place, Look { noise: 0.0, ..CLEAR }, 1);
    let found = find_board("rendered", &picture, &BOARD).unwrap();
    for (i, corner) in found.view.corners.iter().enumerate() {
        // The first corner blue, its row green, the others red.
        let colour = if i == 0 { [40, 90, 255] } else { [[220, 30, 30], [0, 170, 60]][usize::from(i < BOARD.columns)] };
        let [x, y] = corner.pixel.map(|v| v as usize);
        for d in 0..9 {
            picture.pixels[(y + d - 4) * SIZE.0 + x] = colour;
            picture.pixels[y * SIZE.0 + x + d - 4] = colour;
        }
    }
    std::fs::write("docs/camera-corners.png", png(&picture)).unwrap();
}
