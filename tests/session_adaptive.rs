//! Adaptive sessions on fakes: what is shot, what is left out, what the journal and the figures say, and how such a session goes on.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use rigd::numerics::radiometry::metering::Worth;
use rigd::session::adaptive::Weighed;
use rigd::session::handle::EngineHandle;
use rigd::session::plan::{Adaptive, CapturePlan, LightTargets, StartRequest};
use rigd::session::processing::Next;
use rigd::session::state::SessionState as S;
use rigd::session::verify::verify;
use support::{Fakes, ended_after, events, rig, wait_for};

const LABELS: [&str; 5] = ["1/100", "1/20", "1/4", "1.3", "6"];
const WORTH: Worth = Worth { sigma: 0.012, sigma_whole: 0.009 };

/// Five exposures at every angle of the fake rig, or at these.
fn request(stations_deg: Option<Vec<f64>>, adaptive: Adaptive) -> StartRequest {
    let exposures = Some(LABELS.map(String::from).to_vec());
    StartRequest { exposures, stations_deg, adaptive: Some(adaptive), ..StartRequest::default() }
}

/// Station 1 needs exposures 3, 1 and 2, station 2 exposures 2 and 4.
fn needed(station: usize) -> &'static [usize] {
    if station == 1 { &[3, 1, 2] } else { &[2, 4] }
}

/// Fakes that meter so, and hold the frames they are given against those that were asked for.
fn metering() -> Fakes {
    let fakes = Fakes::default();
    fakes.on_meter(|bracket| {
        let needed = needed(bracket.number);
        let shot: Vec<usize> = bracket.frames.iter().map(|frame| frame.exposure).collect();
        assert_eq!(shot, needed[..shot.len()]);
        assert!(bracket.frames.iter().all(|frame| frame.station == bracket.number));
        Ok(needed.get(shot.len()).map_or(Next::Enough(WORTH), |&exposure| Next::Shoot(exposure)))
    });
    fakes
}

fn cells(fakes: &Fakes) -> Vec<(usize, usize)> {
    fakes.world().shots.iter().map(|shot| (shot.0, shot.1)).collect()
}

fn expected_cells() -> Vec<(usize, usize)> {
    let mut cells: Vec<(usize, usize)> = (0..5).map(|exposure| (0, exposure)).collect();
    cells.extend([1, 2].into_iter().flat_map(|s| needed(s).iter().map(move |&e| (s, e))));
    cells
}

fn assert_thrifty(engine: &EngineHandle, id: &str) {
    let end = engine.session(id).unwrap();
    assert_eq!((end.frames_committed, end.frames_planned, end.stations_developed), (10, 10, 3));
    let saved = end.saved.unwrap();
    assert_eq!((saved.exposures, saved.stations), (5, 0));
    // Station 1 left out 1/100 and 6, station 2 1/100, 1/20 and 1.3, as third stops.
    let third_stop = |k: i32| 2_f64.powf(f64::from(k) / 3.0);
    let shutter_s = 2.0 * third_stop(-20) + third_stop(8) + third_stop(-13) + third_stop(1);
    assert!((saved.shutter_s - shutter_s).abs() < 1e-9, "{} {shutter_s}", saved.shutter_s);
    assert_eq!((saved.sigma, saved.sigma_whole), (Some(0.012), Some(0.009)));
    assert_eq!(saved.lights, None);
}

#[test]
fn a_plan_that_asks_for_nothing_meters_nothing_and_says_nothing_of_it() {
    let (fakes, data) = (metering(), tempfile::tempdir().unwrap());
    let engine = fakes.engine(data.path());
    let whole = StartRequest { adaptive: None, ..request(None, Adaptive::default()) };
    let id = engine.start(&whole, None).unwrap().snapshot.id;
    let end = wait_for(&engine, &id, S::Completed);
    assert_eq!((end.frames_committed, end.frames_planned, end.saved), (15, 15, None));
    assert!(events(&engine, &id, "exposures.enough").is_empty());
    let manifest = std::fs::read_to_string(data.path().join("sessions").join(&id).join("manifest.json")).unwrap();
    assert!(!manifest.contains("adaptive"));
}

#[test]
fn the_first_station_is_whole_and_the_others_have_what_metering_asks_for() {
    let (fakes, data) = (metering(), tempfile::tempdir().unwrap());
    let engine = fakes.engine(data.path());
    let id = engine.start(&request(None, Adaptive::default()), None).unwrap().snapshot.id;
    wait_for(&engine, &id, S::Completed);
    assert_eq!(cells(&fakes), expected_cells());
    assert_eq!(fakes.world().developed, [(0, 5), (1, 3), (2, 2)]);
    assert_thrifty(&engine, &id);
    let enough = events(&engine, &id, "exposures.enough");
    assert_eq!(enough.len(), 2);
    assert_eq!(enough[0]["left_out"], serde_json::json!(["1/100", "6"]));
    assert_eq!((&enough[1]["sigma"], &enough[1]["sigma_whole"]), (&0.012.into(), &0.009.into()));
    assert_eq!(verify(&data.path().join("sessions").join(&id)).unwrap().faults, [""; 0]);
    fakes.assert_safe();
}

#[test]
fn a_bracket_that_cannot_be_metered_is_shot_whole() {
    let (fakes, data) = (metering(), tempfile::tempdir().unwrap());
    fakes.on_meter(|bracket| match (bracket.number, bracket.frames.len()) {
        (1, 0) => Ok(Next::Shoot(2)),
        (1, _) => Err("the sun went down".into()),
        (_, 0) => Ok(Next::Shoot(0)),
        _ => Ok(Next::Enough(WORTH)),
    });
    let engine = fakes.engine(data.path());
    let id = engine.start(&request(None, Adaptive::default()), None).unwrap().snapshot.id;
    let end = wait_for(&engine, &id, S::Completed);
    assert_eq!(cells(&fakes)[5..], [(1, 2), (1, 0), (1, 1), (1, 3), (1, 4), (2, 0)]);
    assert_eq!((end.frames_committed, end.frames_planned), (11, 11));
    let failed = events(&engine, &id, "metering.failed");
    assert!(failed.len() == 1 && failed[0]["reason"] == "the sun went down", "{failed:?}");
}

#[test]
fn it_goes_on_with_the_first_bracket_that_is_not_whole_and_decides_the_same() {
    for frames in 0..10 {
        let (fakes, data) = (metering(), tempfile::tempdir().unwrap());
        let id = ended_after(&fakes, data.path(), &request(None, Adaptive::default()), frames);
        fakes.world().shots.clear();
        let engine = fakes.engine(data.path());
        wait_for(&engine, &id, S::Completed);
        // Frames before each station.
        let from = [0, 5, 8].into_iter().rfind(|&start| start <= frames).unwrap();
        assert_eq!(cells(&fakes), expected_cells()[from..], "{frames} frames before");
        assert_thrifty(&engine, &id);
        fakes.assert_safe();
    }
}

#[test]
fn a_frame_that_is_lost_costs_its_thinned_bracket_and_no_other() {
    let (fakes, data) = (metering(), tempfile::tempdir().unwrap());
    let id = ended_after(&fakes, data.path(), &request(None, Adaptive::default()), 9);
    fakes.world().shots.clear();
    std::fs::remove_file(data.path().join("sessions").join(&id).join("frames/001-02.jpg")).unwrap();
    let engine = fakes.engine(data.path());
    wait_for(&engine, &id, S::Completed);
    assert_eq!(cells(&fakes), expected_cells()[5..]);
    assert_thrifty(&engine, &id);
}

const TARGETS: LightTargets = LightTargets { left_out_error: 0.03, parameter_error: 0.05 };

fn angles() -> Vec<f64> {
    (0..13).map(|i| -60.0 + 10.0 * f64::from(i)).collect()
}

fn lights_only() -> StartRequest {
    request(Some(angles()), Adaptive { exposures: false, lights: Some(TARGETS) })
}

/// Errors that meet the targets from so many stations on.
fn weighing(enough: usize) -> Fakes {
    let fakes = Fakes::default();
    fakes.on_weigh(move |stations| {
        if stations < 9 {
            return Err("it did not converge".into());
        }
        let left_out_error = Some(if stations < enough { 0.031 } else { 0.03 });
        Ok(Weighed { left_out_error, left_out_highlight_error: None, parameter_error: Some(0.02) })
    });
    fakes
}

#[test]
fn stations_are_spread_and_end_when_their_fit_meets_the_targets() {
    let (fakes, data) = (weighing(11), tempfile::tempdir().unwrap());
    let engine = fakes.engine(data.path());
    let id = engine.start(&lights_only(), None).unwrap().snapshot.id;
    let end = wait_for(&engine, &id, S::Completed);
    let shot: Vec<f64> = fakes.world().shots.iter().step_by(5).map(|shot| shot.3).collect();
    assert_eq!((shot.len(), &shot[..3]), (11, &[-60.0, 60.0, 0.0][..]));
    assert_eq!((end.frames_committed, end.frames_planned, end.stations), (55, 55, 13));
    let saved = end.saved.unwrap();
    assert_eq!((saved.exposures, saved.stations), (10, 2));
    let lights = saved.lights.unwrap();
    assert_eq!((lights.stations, lights.left_out_error, lights.enough), (11, Some(0.03), true));
    let judged = events(&engine, &id, "lights.judged");
    let numbers: Vec<_> = judged.iter().map(|e| (e["stations"].as_u64().unwrap(), e["enough"] == true)).collect();
    assert_eq!(numbers, [(7, false), (9, false), (11, true)]);
    assert_eq!(judged[0]["reason"], "it did not converge");
    assert_eq!(judged[2]["targets"]["left_out_error"], 0.03);
    assert_eq!(fakes.world().fitted, [11]);
    fakes.assert_safe();
}

#[test]
fn what_lights_were_found_to_suffice_still_do_after_a_restart() {
    // In the middle of station 8 (of the eleven), then after the decision, in the fit.
    let (fakes, data) = (weighing(11), tempfile::tempdir().unwrap());
    let id = ended_after(&fakes, data.path(), &lights_only(), 42);
    fakes.world().shots.clear();
    let engine = fakes.engine(data.path());
    let end = wait_for(&engine, &id, S::Completed);
    assert_eq!((end.frames_committed, fakes.world().shots.len()), (55, 15));
    engine.shutdown().unwrap();
    drop(engine);
    let path = data.path().join("sessions").join(&id).join("journal.jsonl");
    let text = std::fs::read_to_string(&path).unwrap();
    let fitting = text.lines().position(|line| line.contains("\"state\":\"fitting\"")).unwrap();
    let kept: Vec<&str> = text.lines().take(fitting + 1).collect();
    std::fs::write(&path, kept.join("\n") + "\n").unwrap();
    let engine = fakes.engine(data.path());
    let end = wait_for(&engine, &id, S::Completed);
    assert_eq!((end.frames_committed, end.frames_planned, fakes.world().shots.len()), (55, 55, 15));
    assert_eq!(fakes.world().fitted.last(), Some(&11));
}

#[test]
fn targets_that_none_can_be_are_refused_and_few_stations_are_warned_of() {
    let plan = |left_out_error, parameter_error, stations: usize| {
        let lights = Some(LightTargets { left_out_error, parameter_error });
        let request = request(Some(angles()[..stations].to_vec()), Adaptive { exposures: true, lights });
        CapturePlan::new(&rig(), &request)
    };
    for bad in [0.0, -0.1, 1.01, f64::NAN, f64::INFINITY] {
        let reasons = plan(bad, bad, 13).unwrap_err().reasons;
        assert!(reasons.len() == 2 && reasons[0].starts_with("adaptive.lights.left_out_error"), "{reasons:?}");
        assert!(reasons[1].starts_with("adaptive.lights.parameter_error"), "{reasons:?}");
    }
    assert_eq!(plan(0.03, 1.0, 8).unwrap().warnings, [""; 0]);
    let few = plan(0.03, 1.0, 7).unwrap();
    assert!(few.warnings.len() == 1 && few.warnings[0].contains("7 stations are shot in any case"), "{few:?}");
    let read = |text: &str| serde_json::from_str::<StartRequest>(text).map_err(|e| e.to_string());
    assert_eq!(read(r#"{"adaptive": {}}"#).unwrap().adaptive, Some(Adaptive { exposures: true, lights: None }));
    assert_eq!(read(r#"{"adaptive": null}"#).unwrap().adaptive, None);
    for bad in [r#"{"adaptive": [true]}"#, r#"{"adaptive": {"lights": [0.1, 0.1]}}"#, r#"{"adaptive": {"light": {}}}"#]
    {
        assert!(read(bad).is_err(), "{bad}");
    }
}
