//! Plans: every mistake at once, honest estimates, and the part of the frame that is kept.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use rig_config::{ReferencePatch, Rig};
use rigd::numerics::geometry::{Projection, Sphere, Vec3};
use rigd::session::crop;
use rigd::session::handle::{FitRequest, check_rig};
use rigd::session::plan::{Adaptive, CapturePlan, LightTargets, StartRequest};
use support::rig;

#[test]
fn an_empty_request_is_the_rigs_own_plan() {
    let plan = CapturePlan::new(&rig(), &StartRequest::default()).unwrap();
    assert_eq!((plan.name.as_str(), plan.frames, plan.stations.len()), ("fake rig", 6, 3));
    assert_eq!(plan.exposures[0].label, "1/100");
    assert!((plan.exposures[0].true_s - 1.0 / 101.594).abs() < 1e-6);
    // 15 degrees on a circle of 600 mm about (0, 0, 1500).
    let [x, y, z] = plan.stations[1].light_position_mm;
    assert!((x - 155.291).abs() < 1e-3 && y == 0.0 && (z - 920.444).abs() < 1e-3);
}

#[test]
fn the_estimate_adds_up() {
    let plan = CapturePlan::new(&rig(), &StartRequest::default()).unwrap();
    // By hand: 30 deg/s and 60 deg/s^2 make ramps of 15 degrees, so a move of a >= 15 degrees takes (a + 15) / 30 s.
    // From the park position (-60): 40, 35, 35 degrees, and 110 back.
    let moves = (40.0 + 35.0 + 35.0 + 110.0 + 4.0 * 15.0) / 30.0;
    let exposures = 3.0 * (1.0 / 101.594 + 0.39685);
    // The room is seen in the longer exposure.
    let known = 0.39685 + 60.0 + moves + 3.0 * 0.5 + exposures;
    let download = (plan.estimated_s - known) / 7.0;
    assert!((0.5..5.0).contains(&download), "{download} s for a download");
    assert!(plan.estimated_bytes >= 6 * 32 * 24 && plan.estimated_bytes < 2 << 20);
}

/// A rig without a patch has the order of its file; with one, only what somebody names keeps an order that goes one way.
#[test]
fn the_stations_of_a_rig_with_a_patch_go_out_back_and_out_again_unless_they_are_named() {
    let shipped = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap().1;
    let bare = Rig::from_toml(shipped, "simulated.toml").unwrap();
    let patch = ReferencePatch { center_mm: [-47.0, 25.0, 1460.0], normal: [0.34, 0.0, -0.94], diameter_mm: 22.0 };
    let rig = Rig { reference_patch: Some(patch), ..bare.clone() };
    let planned = |rig: &Rig, request: &StartRequest| {
        let plan = CapturePlan::new(rig, request).unwrap();
        (plan.stations.iter().map(|station| station.angle_deg).collect::<Vec<_>>(), plan.estimated_s)
    };
    let (own, named) = (StartRequest::default(), bare.plan.stations_deg.clone());
    let (as_written, short_s) = planned(&bare, &own);
    assert_eq!(as_written, named);
    let (in_three, long_s) = planned(&rig, &own);
    assert_eq!(in_three, [-55.0, 50.0, 140.0, 85.0, -20.0, 15.0, 115.0]);
    // By hand: 55 + 195 + 140 degrees one way, 55 + 105 + 90 + 55 + 105 + 35 + 100 + 115 in three, at 30 degrees a second.
    assert!((long_s - short_s - (660.0 - 390.0) / 30.0).abs() < 1e-9, "{short_s} {long_s}");
    let asked = StartRequest { stations_deg: Some(named.clone()), ..StartRequest::default() };
    assert_eq!(planned(&rig, &asked), (named, short_s));
    let lights = Some(LightTargets { left_out_error: 0.04, parameter_error: 0.05 });
    let sparing = StartRequest { adaptive: Some(Adaptive { lights, ..Adaptive::default() }), ..own };
    assert_eq!(planned(&rig, &sparing).0, planned(&bare, &sparing).0);
}

#[test]
fn every_mistake_is_listed_at_once() {
    let request = StartRequest {
        name: Some("x".repeat(201) + "\n"),
        stations_deg: Some(vec![0.0, f64::NAN, 171.0, f64::INFINITY, 0.01, -91.0]),
        exposures: Some(["1/100", "1/90", "bulb", "10", "10.3"].map(String::from).to_vec()),
        calibration: None,
        adaptive: None,
    };
    let error = CapturePlan::new(&rig(), &request).unwrap_err();
    let expected = [
        "name: 202 characters",
        "name: it holds a control",
        "stations_deg[1]: NaN",
        "stations_deg[2]: 171",
        "stations_deg[3]: inf",
        "stations_deg[4]: 0.01 repeats stations_deg[0]",
        "stations_deg[5]: -91",
        "exposures[1]: ",
        "exposures[2]: ",
        "exposures: 10.3 repeats 10",
    ];
    assert_eq!(error.reasons.len(), expected.len(), "{:#?}", error.reasons);
    for (reason, start) in error.reasons.iter().zip(expected) {
        assert!(reason.starts_with(start), "{reason} does not start with {start}");
    }
}

#[test]
fn counts_have_limits() {
    let many: Vec<f64> = (0..1001).map(|i| f64::from(i) * 0.1).collect();
    let labels = vec!["1".to_owned(); 101];
    let request = |stations_deg, exposures| StartRequest { stations_deg, exposures, ..StartRequest::default() };
    for (request, reason) in [
        (request(Some(vec![]), None), "stations_deg: 0 stations"),
        (request(Some(many.clone()), None), "stations_deg: 1001 stations"),
        (request(None, Some(vec![])), "exposures: 0 exposures"),
        (request(None, Some(labels)), "exposures: 101 exposures"),
    ] {
        let error = CapturePlan::new(&rig(), &request).unwrap_err();
        assert!(error.reasons.len() == 1 && error.reasons[0].starts_with(reason), "{error}");
    }
    assert!(CapturePlan::new(&rig(), &request(Some(many[..1000].to_vec()), None)).is_ok());
}

/// The oracle asks every pixel of the frame whether its ray meets the sphere.
#[test]
fn the_crop_holds_every_pixel_that_sees_the_sphere_and_little_more() {
    let mut rig = rig();
    (rig.camera.width, rig.camera.height) = (180, 120);
    type Case = ([f64; 3], f64, [f64; 5], [f64; 2]);
    let cases: [Case; 4] = [
        ([0.0, 0.0, 1500.0], 30.0, [0.0; 5], [90.0, 60.0]),
        ([40.0, -20.0, 900.0], 60.0, [0.0; 5], [70.0, 70.0]),
        ([-80.0, 60.0, 600.0], 50.0, [0.08, -0.02, 0.001, -0.002, 0.0], [90.0, 60.0]),
        ([100.0, 0.0, 400.0], 120.0, [0.0; 5], [90.0, 60.0]),
    ];
    for (center_mm, radius_mm, distortion, principal_px) in cases {
        rig.object = rig_config::Sphere { center_mm, radius_mm };
        (rig.camera.distortion, rig.camera.principal_px) = (distortion, principal_px);
        let crop = crop::of_object(&rig).unwrap();
        let projection = Projection::Pinhole { focal_px: rig.camera.focal_px, principal_px, distortion };
        let sphere = Sphere { center: Vec3::from(center_mm), radius: radius_mm };
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        for (x, y) in (0..180).flat_map(|x| (0..120).map(move |y| (x, y))) {
            if sphere.intersect(&projection.ray(x as f64 + 0.5, y as f64 + 0.5)).is_some() {
                (low, high) = ([low[0].min(x), low[1].min(y)], [high[0].max(x), high[1].max(y)]);
            }
        }
        let (start, end) = ([crop.x, crop.y], [crop.x + crop.width, crop.y + crop.height]);
        for axis in 0..2 {
            let size = [180, 120][axis];
            assert!(start[axis] <= low[axis] && high[axis] < end[axis], "{crop:?} cuts {low:?} to {high:?}");
            assert!(start[axis] + 11 > low[axis], "{crop:?} is too wide for {low:?}");
            assert!(end[axis] < high[axis] + 12 || end[axis] == size, "{crop:?} is too wide for {high:?}");
        }
    }
    rig.object.center_mm = [0.0, 0.0, -500.0];
    assert_eq!(crop::of_object(&rig), None);
}

#[test]
fn a_fit_that_no_fit_can_be_is_refused_before_anything_moves() {
    let mut rig = support::rig();
    assert_eq!(check_rig(&rig.fit), Ok(()));
    rig.fit = rig_config::Fit {
        materials: Some(9),
        model: "plastic".into(),
        lobe: "auto".into(),
        gains: "auto".into(),
        solver: "magic".into(),
        objective: "beauty".into(),
        ..rig.fit
    };
    let reasons = check_rig(&rig.fit).unwrap_err().reasons;
    assert_eq!(reasons.len(), 4);
    for (reason, key) in reasons.iter().zip(["fit.materials", "fit.model", "fit.solver", "fit.objective"]) {
        assert!(reason.starts_with(key), "{reason}");
    }
    let every = FitRequest { leave_out: Some(vec![0, 1, 2]), materials: Some(5), ..FitRequest::default() };
    assert_eq!(every.check(3).unwrap_err().reasons.len(), 2);
    assert_eq!(every.check(4).unwrap_err().reasons.len(), 1);
}
