//! A whole calibration and a session that uses it, through the engine and the real pipeline, on the simulated stage whose truth is hidden.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod stage;

use rigd::numerics::geometry::{Projection, Vec3};
use rigd::session::handle::{CalibrationRequest, CalibrationSnapshot, EngineHandle, Step};
use rigd::session::plan::StartRequest;
use rigd::session::state::{SessionState as S, Verb};
use rigd::sim::stage::{Placed, StageHandle};
use rigd::sim::world::World;
use serde_json::Value;
use stage::{engine, placed, text, turn, until};
use std::time::Instant;

/// Does all that is asked for.
fn calibrate(engine: &EngineHandle, stage: &StageHandle) -> CalibrationSnapshot {
    let id = engine.start_calibration(&CalibrationRequest::default()).unwrap().id;
    loop {
        let now = turn(engine, &id);
        if now.state.is_final() {
            return now;
        }
        if let Some(last) = now.verdicts.last().filter(|last| !last.accepted) {
            panic!("{}: {:?}", last.step.name(), last.reason);
        }
        stage.place(placed(now.step));
        engine.command_calibration(&id, Verb::Shoot).unwrap();
    }
}

#[test]
fn a_calibration_finds_the_hidden_truth_and_a_session_uses_it() {
    let (data, stage) = (tempfile::tempdir().unwrap(), StageHandle::default());
    let (rig, engine) = engine(&text(), data.path(), &stage);
    let world = World::new(&rig, rig.simulation.as_ref().unwrap());
    let begin = Instant::now();

    // What is not there is refused, with the reason, and asked for again.
    let id = engine.start_calibration(&CalibrationRequest::default()).unwrap().id;
    assert_eq!(turn(&engine, &id).verdicts, []);
    stage.place(Placed::Balls);
    engine.command_calibration(&id, Verb::Shoot).unwrap();
    let refused =
        until("the refusal", || Some(engine.calibration(&id).unwrap()).filter(|run| !run.verdicts.is_empty()));
    assert!(!refused.verdicts[0].accepted);
    assert!(refused.verdicts[0].reason.as_ref().unwrap().contains("no board found"), "{:?}", refused.verdicts[0]);
    assert_eq!(turn(&engine, &id).step, Step::Board { view: 1, of: 8 });
    for view in [0, 0] {
        stage.place(Placed::Board { view });
        engine.command_calibration(&id, Verb::Shoot).unwrap();
        turn(&engine, &id);
    }
    let twice = turn(&engine, &id);
    let told = twice.verdicts.last().unwrap();
    assert!(!told.accepted && told.reason.as_ref().unwrap().contains("exactly where"), "{told:?}");
    engine.command_calibration(&id, Verb::Abort).unwrap();
    until("the abort", || (engine.calibration(&id).unwrap().state == S::Aborted).then_some(()));

    let done = calibrate(&engine, &stage);
    println!("calibrated after {:.1} s", begin.elapsed().as_secs_f64());
    assert_eq!((done.state, done.version), (S::Completed, 2), "{:?}", done.reason);
    let result = engine.calibration_result(&done.id).unwrap().unwrap();
    let truth = world.truth();
    for light in result["lights"]["lights"].as_array().unwrap() {
        let angle = light["angle_deg"].as_f64().unwrap();
        let off = (vector(&light["position_mm"]) - truth.lamp.position(angle)).norm();
        println!("{angle}: {off:.2} mm off");
        assert!(off < 2.0, "light at {angle} degrees is {off} mm off");
    }
    let Projection::Pinhole { focal_px, .. } = &truth.projection else { panic!() };
    let focal = result["camera"]["focal_px"][0].as_f64().unwrap() / focal_px[0] - 1.0;
    println!("focal length {:.3} % off", 100.0 * focal);
    assert!(focal.abs() < 0.003);
    let bulb = vector(&result["lights"]["bulb_intensity"]);
    for c in 0..3 {
        let off = bulb[c] / truth.lamp.intensity[c] - 1.0;
        println!("intensity {:.2} % off", 100.0 * off);
        assert!(off.abs() < 0.02);
    }

    stage.place(Placed::Sample);
    let plan = engine.plan(&StartRequest::default()).unwrap();
    let used = plan.calibration.unwrap();
    assert_eq!((&used.id, used.version), (&done.id, 2));
    assert_eq!(plan.warnings, Vec::<String>::new());
    let measured = vector(&result["lights"]["lights"][0]["position_mm"]);
    assert_eq!(Vec3::from(plan.stations[0].light_position_mm), measured);
    let session = engine.start(&StartRequest::default(), None).unwrap().snapshot.id;
    let end = until("the session", || Some(engine.session(&session).unwrap()).filter(|s| s.state.is_final()));
    println!("session after {:.1} s", begin.elapsed().as_secs_f64());
    assert_eq!(end.state, S::Completed, "{:?}", end.reason);
    println!("mean relative error {:?}", end.mean_relative_error);
    let material = engine.material(&session).unwrap().unwrap();
    let provenance = material["material"]["provenance"]["calibration"].as_str().unwrap();
    assert!(provenance.contains(&done.id), "{provenance}");
    let directory = data.path().join("sessions").join(&session);
    let text = std::fs::read_to_string(directory.join("dataset.toml")).unwrap();
    assert!(text.starts_with("# lights and camera: calibration 2 of"), "{text}");
    let dataset: toml::Value = toml::from_str(&text).unwrap();
    let center: Vec<f64> =
        dataset["object"]["center_mm"].as_array().unwrap().iter().map(|v| v.as_float().unwrap()).collect();
    let off = Vec3::from_row_slice(&center) - truth.object.center;
    println!("sample's centre {off:?} off");
    // No light reaches the ball's lower limb, so its outline comes out 0.3 px small: depth is worse than place.
    assert!(off.x.hypot(off.y) < 0.2 && off.z.abs() < 0.004 * truth.object.center.z, "{off:?}");
}

fn vector(value: &Value) -> Vec3 {
    Vec3::from_iterator(value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()))
}
