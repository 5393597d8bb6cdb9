//! The camera's adjustment against OpenCV's on the same corners, and against simulated truth (`tests/oracle/camera.py`).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use nalgebra::Rotation3;
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use rigd::numerics::calibration::camera::{
    BadView, Calibrated, CameraError, Corner, Freedom, NAMES, Size, Verdict, View, board_pose, calibrate,
};
use rigd::numerics::geometry::{Projection, Vec3};
use serde_json::Value;

/// The rig's 5D with its 200 mm lens; principal point off the centre, a few tenths of a percent of distortion.
const LONG: Projection = Projection::Pinhole {
    focal_px: [24_390.0; 2],
    principal_px: [2_192.0, 1_445.0],
    distortion: [0.4, 0.0, 0.0, 0.0, 0.0],
};
const LONG_SIZE: Size = Size { width: 4368, height: 2912 };
const SHORT: Projection = Projection::Pinhole {
    focal_px: [700.0, 714.0],
    principal_px: [322.0, 236.0],
    distortion: [-0.3, 0.12, 0.002, -0.001, 0.0],
};
const SHORT_SIZE: Size = Size { width: 640, height: 480 };

/// A board of 10 x 7 corners, 18 mm, its middle at `middle`, tilted about an axis in its plane.
fn view(
    name: &str,
    camera: &Projection,
    tilt_deg: f64,
    axis: f64,
    middle: Vec3,
    noise: &mut dyn FnMut() -> f64,
) -> View {
    let tilt = Rotation3::from_scaled_axis(Vec3::new(axis.cos(), axis.sin(), 0.0) * tilt_deg.to_radians());
    let corner = |k: usize| {
        let board_mm = [(k % 10) as f64 * 18.0, (k / 10) as f64 * 18.0];
        let [x, y] = camera.project(&(tilt * Vec3::new(board_mm[0] - 81.0, board_mm[1] - 54.0, 0.0) + middle));
        Corner { board_mm, pixel: [x + noise(), y + noise()], sigma_px: 0.1 }
    };
    View { name: name.into(), corners: (0..70).map(corner).collect() }
}

fn views(camera: &Projection, count: usize, tilt_deg: f64, noise_px: f64, seed: u64) -> Vec<View> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut errors = Xoshiro256PlusPlus::seed_from_u64(seed ^ 0xdead);
    let mut noise = || noise_px * Distribution::<f64>::sample(&StandardNormal, &mut errors);
    let Projection::Pinhole { focal_px: [f, _], .. } = *camera else { panic!("a pinhole") };
    (0..count)
        .map(|i| {
            let tilt = tilt_deg * random.random_range(0.1..1.0);
            let axis = random.random_range(0.0..std::f64::consts::TAU);
            // As far as keeps the board in the picture.
            let z = f * random.random_range(0.078..0.088);
            let reach = if f > 10_000.0 { [80.0, 50.0] } else { [0.18 * z * 640.0 / f, 0.12 * z * 480.0 / f] };
            let z = if f > 10_000.0 { z } else { z * 7.0 };
            let middle =
                Vec3::new(random.random_range(-reach[0]..reach[0]), random.random_range(-reach[1]..reach[1]), z);
            view(&format!("view {i}"), camera, tilt, axis, middle, &mut noise)
        })
        .collect()
}

fn held(found: &Calibrated) -> Vec<&'static str> {
    let held = found.verdicts.iter().filter(|(_, verdict)| !verdict.is_free());
    held.flat_map(|(freedom, _)| freedom.unknowns()).map(|&i| NAMES[i]).collect()
}

fn sigma(found: &Calibrated, i: usize) -> f64 {
    found.covariance[(i, i)].sqrt()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

#[test]
fn agrees_with_opencv_on_the_same_corners() {
    let oracle: Value = serde_json::from_str(include_str!("oracle/camera.json")).unwrap();
    for side in ["left", "right"] {
        let camera = &oracle[side];
        let square = oracle["square_mm"].as_f64().unwrap();
        let view = |(name, corners): (&Value, &Value)| {
            let corners = corners.as_array().unwrap().iter().enumerate().map(|(i, pixel)| {
                let board_mm = [(i % 9) as f64 * square, (i / 9) as f64 * square];
                let pixel = numbers(pixel);
                Corner { board_mm, pixel: [pixel[0], pixel[1]], sigma_px: 0.1 }
            });
            View { name: name.to_string(), corners: corners.collect() }
        };
        let (names, corners) = (camera["names"].as_array().unwrap(), camera["corners_px"].as_array().unwrap());
        let views: Vec<View> = names.iter().zip(corners).map(view).collect();
        let found = calibrate(&views, SHORT_SIZE).unwrap();
        assert!(found.rejected.is_empty());
        let model = held(&found).join(" ");
        let theirs = &camera["usual_window"][&model];
        assert!(theirs.is_object(), "{side}: OpenCV was not asked for the model that holds {model}");
        let near = |what: &str, ours: f64, theirs: f64, tolerance: f64| {
            assert!((ours - theirs).abs() <= tolerance, "{side} {what}: {ours} against {theirs}");
        };
        near("rms", found.rms_px, theirs["rms_px"].as_f64().unwrap(), 1e-5);
        let values = found.interior.values();
        let expected = ["focal_px", "principal_px", "distortion"].map(|key| numbers(&theirs[key])).concat();
        let sigmas = numbers(&theirs["sigma"]);
        for i in 0..9 {
            // A hundredth of its own uncertainty.
            near(NAMES[i], values[i], expected[i], 0.01 * sigma(&found, i).max(1e-6));
            // Where fx = fy OpenCV reports the one's sigma and 0 for the other.
            if sigmas[i] > 0.0 {
                near(&format!("sigma of {}", NAMES[i]), sigma(&found, i), sigmas[i], 0.02 * sigmas[i]);
            }
        }
        for (used, theirs) in found.views.iter().zip(numbers(&theirs["view_rms_px"])) {
            near(&views[used.index].name, used.rms_px, theirs, 1e-4);
        }
    }
}

#[test]
fn standard_deviations_of_a_long_lens_cover_the_truth() {
    let seeds = 200;
    let inside: Vec<[bool; 4]> = (0..seeds)
        .into_par_iter()
        .map(|seed| {
            let found = calibrate(&views(&LONG, 20, 30.0, 0.1, seed), LONG_SIZE).unwrap();
            assert_eq!(held(&found), ["k2", "p1", "p2", "k3", "fy"], "seed {seed}");
            let values = found.interior.values();
            let truth = [(0, 24_390.0), (2, 2_192.0), (3, 1_445.0), (4, 0.4)];
            truth.map(|(i, truth)| (values[i] - truth).abs() < 1.96 * sigma(&found, i))
        })
        .collect();
    let shares: Vec<f64> = (0..4).map(|k| inside.iter().filter(|seed| seed[k]).count() as f64 / seeds as f64).collect();
    println!("truth within 1.96 sigma for f, cx, cy, k1: {shares:?}");
    assert!(shares.iter().all(|share| (0.92..=0.98).contains(share)), "f, cx, cy, k1: {shares:?}");
}

#[test]
fn the_views_decide_the_model() {
    let verdict = |found: &Calibrated, freedom: Freedom| found.verdicts.iter().find(|(f, _)| *f == freedom).unwrap().1;
    // Tangential terms of a long lens take the principal point with them.
    let long = calibrate(&views(&LONG, 20, 30.0, 0.1, 1), LONG_SIZE).unwrap();
    assert!(matches!(verdict(&long, Freedom::Tangential), Verdict::PrincipalUncertain { .. }), "{:?}", long.verdicts);
    assert!(matches!(verdict(&long, Freedom::K2), Verdict::NoGain { .. }));
    assert!(sigma(&long, 0) / 24_390.0 < 1e-3, "f to 0.1 %");
    // Twelve noisy views do not determine the principal point: the centre is taken, and the focal length stays good.
    let noisy = calibrate(&views(&LONG, 12, 25.0, 0.2, 1), LONG_SIZE).unwrap();
    assert!(matches!(verdict(&noisy, Freedom::PrincipalPoint), Verdict::PrincipalUncertain { .. }));
    assert_eq!(noisy.interior.values()[2..4], [2184.0, 1456.0]);
    assert!((noisy.interior.values()[0] / 24_390.0 - 1.0).abs() < 0.005);
    // A lens without distortion gets none; a short one with all of it gets what it has.
    let Projection::Pinhole { focal_px, principal_px, .. } = LONG else { panic!("a pinhole") };
    let plain = Projection::Pinhole { focal_px, principal_px, distortion: [0.0; 5] };
    let plain = calibrate(&views(&plain, 20, 30.0, 0.1, 2), LONG_SIZE).unwrap();
    assert!(matches!(verdict(&plain, Freedom::K1), Verdict::NoGain { .. }), "{:?}", plain.verdicts);
    let short = calibrate(&views(&SHORT, 20, 35.0, 0.1, 3), SHORT_SIZE).unwrap();
    for freedom in [Freedom::PrincipalPoint, Freedom::K1, Freedom::Aspect] {
        assert!(verdict(&short, freedom).is_free(), "{freedom:?}: {:?}", short.verdicts);
    }
    let found = short.interior.values();
    assert!((found[0] - 700.0).abs() < 4.0 * sigma(&short, 0) && (found[1] - 714.0).abs() < 4.0 * sigma(&short, 1));
}

#[test]
fn a_mislabelled_view_is_named_and_left_out() {
    let clean = views(&LONG, 15, 30.0, 0.1, 5);
    let mut spoilt = clean.clone();
    // One row of labels slipped by a corner, as a detector does it.
    for k in 30..40 {
        spoilt[4].corners[k].pixel = clean[4].corners[(k + 1).min(39)].pixel;
    }
    let found = calibrate(&spoilt, LONG_SIZE).unwrap();
    assert_eq!(found.rejected.len(), 1);
    assert!(matches!(found.rejected[0], (4, BadView::Misfit { .. })), "{:?}", found.rejected);
    assert_eq!(found.views.len(), 14);
    assert!((found.interior.values()[0] / 24_390.0 - 1.0).abs() < 3e-3);
}

#[test]
fn views_that_do_not_determine_the_camera_are_refused_in_words() {
    let mut noise = || 0.0;
    let (axis, z) = (0.3, 2000.0);
    let flat = |tilt: f64, n: usize, seed: u64| -> Vec<View> {
        let mut errors = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut noise = || 0.1 * Distribution::<f64>::sample(&StandardNormal, &mut errors);
        let at = |i: usize| Vec3::new(-60.0 + 12.0 * i as f64, 5.0 * i as f64 - 20.0, z + 10.0 * i as f64);
        (0..n).map(|i| view(&format!("view {i}"), &LONG, tilt, axis, at(i), &mut noise)).collect()
    };
    let error = calibrate(&flat(0.0, 10, 1), LONG_SIZE).unwrap_err();
    assert!(matches!(error, CameraError::Parallel { .. } | CameraError::FocalOpen { .. }), "{error}");
    assert!(error.to_string().contains("tilt the board"), "{error}");
    assert!(matches!(calibrate(&flat(25.0, 1, 1), LONG_SIZE), Err(CameraError::TooFewViews { good: 1, .. })));
    assert!(matches!(calibrate(&[], LONG_SIZE), Err(CameraError::TooFewViews { good: 0, .. })));
    let nothing = Size { width: 0, height: 0 };
    assert!(matches!(calibrate(&flat(25.0, 5, 1), nothing), Err(CameraError::NoPicture { .. })));
    let grazing = view("grazing", &LONG, 84.0, axis, Vec3::new(0.0, 0.0, z), &mut noise);
    let mut with = views(&LONG, 12, 30.0, 0.1, 9);
    with.push(grazing);
    let found = calibrate(&with, LONG_SIZE).unwrap();
    assert!(matches!(found.rejected[..], [(12, BadView::Oblique { .. })]), "{:?}", found.rejected);
}

#[test]
fn hostile_corners_are_refused_and_never_panic() {
    let good = views(&LONG, 6, 30.0, 0.1, 7);
    let spoil = |change: &dyn Fn(&mut Corner)| {
        let mut views = good.clone();
        views[2].corners.iter_mut().for_each(change);
        let found = calibrate(&views, LONG_SIZE).unwrap();
        assert_eq!(found.views.len(), 5, "{:?}", found.rejected);
        found.rejected[0].1.clone()
    };
    for value in [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e300] {
        assert_eq!(spoil(&|c| c.pixel[0] = value), BadView::NotNumbers);
        assert_eq!(spoil(&|c| c.board_mm[1] = value), BadView::NotNumbers);
        assert_eq!(spoil(&|c| c.sigma_px = value), BadView::NotNumbers);
    }
    assert_eq!(spoil(&|c| c.sigma_px = 0.0), BadView::NotNumbers);
    assert_eq!(spoil(&|c| c.pixel[1] = 2.0 * c.pixel[0]), BadView::Degenerate);
    assert_eq!(spoil(&|c| c.pixel = [100.0; 2]), BadView::Degenerate);
    assert_eq!(spoil(&|c| c.board_mm = [0.0; 2]), BadView::Degenerate);
    let empty = View { name: "empty".into(), corners: Vec::new() };
    assert_eq!(board_pose(&empty, &LONG).unwrap_err(), BadView::TooFewCorners { found: 0 });
    let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
    for _ in 0..20 {
        let mut views = good.clone();
        for corner in views.iter_mut().flat_map(|v| &mut v.corners) {
            corner.pixel = [random.random_range(-1e4..1e4), random.random_range(-1e4..1e4)];
        }
        let _ = calibrate(&views, LONG_SIZE);
    }
}

#[test]
fn a_pose_under_a_known_camera_is_the_true_one() {
    for (camera, z) in [(&LONG, 2000.0), (&SHORT, 380.0)] {
        for (i, tilt) in [2.0, 20.0, 40.0].into_iter().enumerate() {
            let middle = Vec3::new(5.0, -8.0, z);
            let axis = 0.4 + i as f64;
            let found = board_pose(&view("board", camera, tilt, axis, middle, &mut || 0.0), camera).unwrap();
            let vector = Vec3::new(axis.cos(), axis.sin(), 0.0) * tilt.to_radians();
            let truth = Rotation3::from_scaled_axis(vector);
            let angle = (found.pose.rotation.matrix() - truth.matrix()).norm();
            assert!((found.pose.rotation_vector() - vector).norm() < 1e-6);
            assert!(
                angle < 1e-6,
                "tilt {tilt}: {angle} rad off, {} px, mirrored {} px",
                found.rms_px,
                found.mirrored_rms_px
            );
            assert!((found.pose.place([81.0, 54.0]) - middle).norm() < 1e-5, "tilt {tilt}");
            assert!(found.rms_px < 1e-7 && found.mirrored_rms_px > found.rms_px);
        }
    }
}

#[test]
fn the_same_views_give_the_same_bits() {
    let views = views(&LONG, 10, 30.0, 0.1, 11);
    let run = || calibrate(&views, LONG_SIZE).unwrap();
    let (a, b) = (run(), run());
    assert_eq!(a.interior, b.interior);
    assert_eq!(a.covariance, b.covariance);
}
