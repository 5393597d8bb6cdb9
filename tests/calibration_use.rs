//! What a session makes of a calibration: which one it takes, what it takes from it, and when it warns or refuses.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use rig_config::Rig;
use rigd::session::calibration::file::{CalibrationFile, NAME};
use rigd::session::calibration::stale;
use rigd::session::handle::{CalibrationRequest, EngineError, EngineHandle};
use rigd::session::plan::{CapturePlan, StartRequest};
use rigd::session::quality::Optics;
use rigd::session::state::{SessionState as S, Verb};
use serde_json::{Value, json};
use support::{Fakes, until, wait_for};

/// The shipped rig, cut down to the fake camera's frames.
fn text() -> String {
    let (_, text) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated-calibration").unwrap();
    let mut text = (*text).to_owned();
    for (from, to) in [
        ("width = 1536", "width = 32"),
        ("height = 1024", "height = 24"),
        ("focal_px = [4200.0, 4200.0]", "focal_px = [200.0, 200.0]"),
        ("principal_px = [768.0, 512.0]", "principal_px = [16.0, 12.0]"),
        ("board_views = 12", "board_views = 3"),
    ] {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    text
}

/// Lights at -55 and 15 degrees; on a circle of radius 500 mm about (0, 0, 900) mm, where there is one.
fn measured(circle: bool, bulb: bool) -> CalibrationFile {
    let light = |angle: f64, x: f64, intensity: Value| {
        json!({
            "angle_deg": angle, "position_mm": [x, 2.0, 3.0], "covariance_mm2": ([[0.0; 3]; 3]), "circle_residual_mm": null,
            "balls_used": 3, "intensity": intensity, "intensity_sigma": null, "warnings": []
        })
    };
    let circle = circle.then(|| {
        json!({
            "center_mm": [0.0, 0.0, 900.0], "center_sigma_mm": ([0.1; 3]), "axis": [0.0, 1.0, 0.0], "axis_sigma_deg": 0.1,
            "zero": [0.0, 0.0, -1.0], "radius_mm": 500.0, "radius_sigma_mm": 0.1
        })
    });
    let curve: Vec<f64> = (0..256).map(|level| f64::from(level) / 64.0 - 2.0).collect();
    serde_json::from_value(json!({
        "format": 1, "id": "", "version": 0, "made": jiff::Timestamp::now().to_string(), "software": "test", "simulated": true,
        "arm": null, "camera_model": null, "frames": [], "warnings": [],
        "camera": {
            "width": 32, "height": 24, "focal_px": [210.0, 211.0], "principal_px": [15.0, 13.0], "distortion": [0.1, 0.0, 0.0, 0.0, 0.0],
            "sigma": {"focal_px": [0.1, 0.1], "principal_px": [0.1, 0.1], "distortion": ([0.0; 5])}, "held": [], "decisions": [],
            "covariance": ([[0.0; 9]; 9]), "rms_px": 0.1, "board": {"columns": 9, "rows": 6, "square_mm": 15.0}, "views": [], "warnings": []
        },
        "response": {
            "method": "debevec", "log_exposure": [curve, curve, curve], "active_constraints": [0, 0, 0], "pixels": 1, "exposures": [],
            "reference": "a", "expected": "power_of_two", "gauge": "", "exponent_sigma": 0.0, "scatter_nominal": null,
            "scatter_power_of_two": null, "warnings": []
        },
        "lights": {
            "lights": [light(-55.0, 1.0, json!([5.0, 6.0, 7.0])), light(15.0, 4.0, Value::Null)], "circle": circle,
            "bulb_intensity": bulb.then_some([8.0, 9.0, 10.0]), "balls": [], "rms_px": 0.1, "reduced_chi2": 1.0,
            "highlight_sigma_factor": 1.0, "warnings": []
        }
    }))
    .unwrap()
}

struct Setup {
    data: tempfile::TempDir,
    fakes: Fakes,
}

impl Setup {
    fn new() -> Self {
        Self { data: tempfile::tempdir().unwrap(), fakes: Fakes::default() }
    }

    fn engine(&self, text: &str) -> EngineHandle {
        self.fakes.engine_of(self.data.path(), Rig::from_toml(text, "test").unwrap(), text).unwrap()
    }

    /// Runs a calibration that measures `found`; its id.
    fn calibrate(&self, engine: &EngineHandle, found: CalibrationFile) -> String {
        *self.fakes.measured.lock().unwrap() = Some(found);
        let id = engine.start_calibration(&CalibrationRequest::default()).unwrap().id;
        until("the calibration's end", || {
            let now = engine.calibration(&id).unwrap();
            if now.state == S::Awaiting {
                engine.command_calibration(&id, Verb::Shoot).unwrap();
            }
            assert!(now.state == S::Completed || !now.state.is_final(), "{:?}", now.reason);
            now.state == S::Completed
        });
        id
    }
}

fn request(calibration: Option<&str>) -> StartRequest {
    StartRequest {
        stations_deg: Some(vec![-55.0, 15.0]),
        calibration: calibration.map(str::to_owned),
        ..StartRequest::default()
    }
}

fn used(plan: &CapturePlan) -> Option<&str> {
    plan.calibration.as_ref().map(|used| used.id.as_str())
}

fn refusal(engine: &EngineHandle, request: &StartRequest) -> String {
    match engine.plan(request) {
        Err(EngineError::Plan(error)) => error.to_string(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_latest_is_used_unless_another_or_none_is_named() {
    let setup = Setup::new();
    let engine = setup.engine(&text());
    assert_eq!(used(&engine.plan(&request(None)).unwrap()), None);
    let first = setup.calibrate(&engine, measured(true, true));
    let second = setup.calibrate(&engine, measured(true, true));
    let aborted = engine.start_calibration(&CalibrationRequest::default()).unwrap().id;
    engine.command_calibration(&aborted, Verb::Abort).unwrap();
    until("the abort", || engine.calibration(&aborted).unwrap().state == S::Aborted);
    for (name, expected) in [
        (None, Some(&second)),
        (Some("latest"), Some(&second)),
        (Some(first.as_str()), Some(&first)),
        (Some("none"), None),
    ] {
        let plan = engine.plan(&request(name)).unwrap();
        assert_eq!((used(&plan), &plan.warnings[..]), (expected.map(String::as_str), &[][..]), "{name:?}");
    }
    assert!(refusal(&engine, &request(Some(&aborted))).contains("is aborted: name one that is completed"));
    assert!(refusal(&engine, &request(Some("me"))).contains("no calibration me"));
}

#[test]
fn lights_come_from_where_they_were_measured_or_from_the_circle() {
    let setup = Setup::new();
    let engine = setup.engine(&text());
    let id = setup.calibrate(&engine, measured(true, true));
    let asked = StartRequest { stations_deg: Some(vec![-55.0, 15.0, 90.0]), ..StartRequest::default() };
    let plan = engine.plan(&asked).unwrap();
    let lights: Vec<_> = plan.stations.iter().map(|s| (s.light_position_mm, s.light_intensity.unwrap())).collect();
    assert_eq!(lights[0], ([1.0, 2.0, 3.0], [5.0, 6.0, 7.0]), "measured there");
    assert_eq!(lights[1], ([4.0, 2.0, 3.0], [8.0, 9.0, 10.0]), "its intensity is the bulb's");
    // A right-handed quarter turn about +y takes -z to -x.
    let off: f64 = lights[2].0.iter().zip([-500.0, 0.0, 900.0]).map(|(a, b)| (a - b).abs()).sum();
    assert!(off < 1e-9, "{:?}", lights[2]);

    let session = engine.start(&asked, None).unwrap().snapshot;
    assert_eq!(session.calibration.as_ref().unwrap().id, id);
    wait_for(&engine, &session.id, S::Completed);
    let directory = setup.data.path().join("sessions").join(&session.id);
    let kept: CalibrationFile = serde_json::from_slice(&std::fs::read(directory.join(NAME)).unwrap()).unwrap();
    assert_eq!((kept.id, kept.version), (id.clone(), 1));
    let manifest: Value = serde_json::from_slice(&std::fs::read(directory.join("manifest.json")).unwrap()).unwrap();
    assert_eq!(manifest["plan"]["calibration"]["id"], json!(id));
    let rig = Rig::from_toml(&text(), "test").unwrap();
    assert_eq!(measured(true, true).applied(&rig).camera.focal_px, [210.0, 211.0]);
}

#[test]
fn what_a_calibration_cannot_give_is_refused_by_name_and_passed_over_otherwise() {
    let setup = Setup::new();
    let engine = setup.engine(&text());
    let id = setup.calibrate(&engine, measured(false, true));
    let far = StartRequest { stations_deg: Some(vec![-55.0, 90.0]), ..StartRequest::default() };
    let plan = engine.plan(&far).unwrap();
    assert_eq!(used(&plan), None);
    assert!(plan.warnings[0].contains("no light at 90 degrees and no circle"), "{:?}", plan.warnings);
    assert_eq!(plan.stations[0].light_position_mm, Rig::from_toml(&text(), "test").unwrap().lamp.position_mm(-55.0));
    let named = StartRequest { calibration: Some(id), ..far };
    assert!(refusal(&engine, &named).contains("no circle of the arm"));

    setup.calibrate(&engine, measured(true, false));
    assert!(refusal(&engine, &request(Some("latest"))).contains("no intensity of the lamp"));

    let mut other = measured(true, true);
    other.camera.width = 64;
    setup.calibrate(&engine, other);
    assert!(refusal(&engine, &request(Some("latest"))).contains("64 x 24 pixels, the rig file says 32 x 24"));
    let id = setup.calibrate(&engine, measured(true, true));
    let path = setup.data.path().join("calibrations").join(id).join("result").join(NAME);
    std::fs::write(path, "{").unwrap();
    assert!(refusal(&engine, &request(Some("latest"))).contains("calibrate anew"));
    assert_eq!(engine.plan(&request(None)).unwrap().warnings.len(), 1, "a session can still be shot");
}

#[test]
fn an_old_calibration_and_a_changed_rig_file_are_told() {
    let setup = Setup::new();
    let engine = setup.engine(&text());
    let days_ago = |days: i64| (jiff::Timestamp::now() - jiff::SignedDuration::from_hours(24 * days)).to_string();
    setup.calibrate(&engine, CalibrationFile { made: days_ago(29), ..measured(true, true) });
    assert_eq!(engine.plan(&request(None)).unwrap().warnings, Vec::<String>::new());
    setup.calibrate(&engine, CalibrationFile { made: days_ago(40), ..measured(true, true) });
    let warnings = engine.plan(&request(None)).unwrap().warnings;
    assert_eq!(warnings.len(), 1);
    assert!(warnings[0].contains("is 40 days old, more than 30"), "{warnings:?}");
    setup.calibrate(&engine, measured(true, true));
    engine.shutdown().unwrap();
    // Waits and the park position are no part of what was measured.
    let mut waits = text();
    for (from, to) in [
        ("soak_s = 5.0", "soak_s = 6.0"),
        ("settle_s = 0.5", "settle_s = 0.75"),
        ("park_deg = 0.0", "park_deg = 1.0"),
        ("home_timeout_s = 60.0", "home_timeout_s = 61.0"),
    ] {
        assert!(waits.contains(from), "{from}");
        waits = waits.replace(from, to);
    }
    let engine = setup.engine(&waits);
    assert_eq!(engine.plan(&request(None)).unwrap().warnings, Vec::<String>::new());
    engine.shutdown().unwrap();
    let changes = [
        ("[arm]", "tolerance_deg = 0.05", "tolerance_deg = 0.1"),
        ("[lamp]", "level_permille = 800", "level_permille = 700"),
        ("[camera]", "f_number = 5.6", "f_number = 8.0"),
    ];
    for (section, from, to) in changes {
        assert!(text().contains(from), "{from}");
        let engine = setup.engine(&text().replace(from, to));
        let warnings = engine.plan(&request(None)).unwrap().warnings;
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        assert!(warnings[0].contains(section) && warnings[0].contains("calibrate anew"), "{warnings:?}");
        engine.shutdown().unwrap();
    }
}

#[test]
fn an_age_below_two_days_is_told_in_hours() {
    let setup = Setup::new();
    let engine = setup.engine(&text().replace("max_age_days = 30.0", "max_age_days = 0.5"));
    let made = (jiff::Timestamp::now() - jiff::SignedDuration::from_mins(18 * 60 + 10)).to_string();
    setup.calibrate(&engine, CalibrationFile { made, ..measured(true, true) });
    let warnings = engine.plan(&request(None)).unwrap().warnings;
    assert!(warnings[0].contains("is 18.2 hours old, more than 0.5 days"), "{warnings:?}");
}

#[test]
fn a_damaged_or_lost_calibration_is_named_and_the_others_stay() {
    let setup = Setup::new();
    let engine = setup.engine(&text());
    let sound = setup.calibrate(&engine, measured(true, true));
    let damaged = setup.calibrate(&engine, measured(true, true));
    let path = setup.data.path().join("calibrations").join(&damaged).join("result").join(NAME);
    for content in [Some("{"), Some("{\"format\": 1}"), Some(""), None] {
        match content {
            Some(text) => std::fs::write(&path, text).unwrap(),
            None => std::fs::remove_file(&path).unwrap(),
        }
        let reason = match engine.calibration_result(&damaged) {
            Err(EngineError::DamagedCalibration { id, version: 2, reason }) if id == damaged => reason,
            other => panic!("{other:?}"),
        };
        assert!(reason.contains(path.to_str().unwrap()) && reason.contains("calibrate anew"), "{reason}");
        let refused = refusal(&engine, &request(Some("latest")));
        assert!(refused.contains(&format!("calibration 2 ({damaged}) cannot be used")), "{refused}");
        let plan = engine.plan(&request(None)).unwrap();
        assert_eq!(used(&plan), None);
        assert!(
            plan.warnings[0].contains(&damaged) && plan.warnings[0].contains("the rig file's"),
            "{:?}",
            plan.warnings
        );
        assert_eq!(used(&engine.plan(&request(Some(&sound))).unwrap()), Some(sound.as_str()));
        assert_eq!(engine.calibrations().len(), 2);
    }
    assert!(engine.calibration_result(&sound).unwrap().is_some());
}

#[test]
fn other_devices_are_told_in_the_session_once_they_answer() {
    let setup = Setup::new();
    let engine = setup.engine(&text());
    let id = setup.calibrate(&engine, measured(true, true));
    let path = setup.data.path().join("calibrations").join(id).join("result").join(NAME);
    let mut found: CalibrationFile = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    assert_eq!((found.arm.as_deref(), found.camera_model.as_deref()), (Some("fake 1.0"), Some("Fake EOS")));
    found.camera_model = Some("Another EOS".into());
    std::fs::write(&path, serde_json::to_vec(&found).unwrap()).unwrap();
    let session = engine.start(&request(None), None).unwrap().snapshot;
    assert_eq!(session.warnings, Vec::<String>::new());
    let end = wait_for(&engine, &session.id, S::Completed);
    assert_eq!(end.warnings.len(), 1);
    assert!(end.warnings[0].contains("`Fake EOS`") && end.warnings[0].contains("`Another EOS`"), "{:?}", end.warnings);
}

#[test]
fn another_body_and_a_zoomed_lens_are_told_where_the_frames_name_them() {
    let optics = |serial: Option<&str>, focal_mm| Optics { body_serial: serial.map(str::to_owned), focal_mm };
    let file = CalibrationFile { optics: optics(Some("0420"), Some(70.0)), ..measured(true, true) };
    for (now, told) in [
        (optics(Some("0420"), Some(70.0)), 0),
        (optics(None, None), 0),
        (optics(Some("0421"), Some(70.0)), 1),
        (optics(Some("0421"), Some(85.0)), 2),
    ] {
        let warnings = stale::other_optics(&file, &now);
        assert_eq!(warnings.len(), told, "{warnings:?}");
        assert!(warnings.iter().all(|warning| warning.ends_with("calibrate anew")), "{warnings:?}");
    }
    assert_eq!(stale::other_optics(&measured(true, true), &optics(Some("1"), Some(50.0))), Vec::<String>::new());
}

/// What was measured on a simulated stage says nothing of a real rig, nor the other way round.
#[test]
fn a_simulated_calibration_is_not_for_a_real_rig() {
    let of = |text: &str| Rig::from_toml(text, "test").unwrap();
    let simulated = measured(true, true);
    let real = CalibrationFile { simulated: false, ..measured(true, true) };
    let (_, paper) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "zheng-2008").unwrap();
    let (stage, lab) = (of(&text()), of(paper));
    assert!(stage.is_simulated() && !lab.is_simulated());
    assert_eq!(simulated.check_rig(&stage), Ok(()));
    assert!(simulated.check_rig(&lab).unwrap_err().contains("of a simulated rig"));
    assert!(real.check_rig(&stage).unwrap_err().contains("of a real rig"));
}
