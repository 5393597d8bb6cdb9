//! A whole acquisition of the daemon's engine through the real libgphoto2 in its worker process: a simulated EOS on PTP/IP, a simulated
//! arm on a PTY, one simulated world, time running 40 times faster. The material is held against the truth as the demo does.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod rig;

use rig::{Rigged, SPEED};
use rigd::cli::demo::truth::compare;
use rigd::session::plan::StartRequest;
use rigd::session::state::SessionState;
use rigd::store::result;

/// The paper's error for the marble ball (section 4), and the demo's limit for relighting.
const LIMITS: (f64, f64) = (0.0589, 0.03);

#[test]
fn seven_stations_of_ten_exposures_give_the_material_back() {
    let rigged = Rigged::whole(SPEED);
    let ended = rigged.run(&StartRequest::default());
    assert_eq!(ended.state, SessionState::Completed, "{:?}", ended.reason);
    assert_eq!(ended.frames_committed, 70);
    let result = rigged.directory(&ended.id).join("result");
    let stored = result::read_material(&result).unwrap();
    let verdict = compare(&rigged.truth, &stored, ended.mean_relative_error.unwrap(), LIMITS).unwrap();
    let mut told = Vec::new();
    verdict.print(&mut told).unwrap();
    println!("time x {SPEED}\n{}", String::from_utf8(told).unwrap());
    assert!(verdict.recovered());
    // Every frame says where the arm stood, by its own status.
    let frames = rigged.events(&ended.id, "frame.committed");
    assert_eq!(frames.len(), 70);
    let angles = &rigged.truth.plan.stations_deg;
    for frame in &frames {
        let planned = angles[frame["station"].as_u64().unwrap() as usize];
        assert!((frame["angle_deg"].as_f64().unwrap() - planned).abs() <= rigged.truth.arm.tolerance_deg);
    }
    let budget = ended.time_budget.unwrap();
    let open_s: f64 = frames.iter().map(|frame| frame["true_s"].as_f64().unwrap()).sum();
    assert!((budget.shutter_s - open_s / SPEED).abs() < 1e-6, "{budget:?}");
    let (motion, settling) = (budget.motion_s * SPEED, budget.settling_s * SPEED);
    assert!(motion > 0.0 && settling >= 7.0 * rigged.truth.arm.settle_s && budget.transfer_s > 0.0, "{budget:?}");
    assert!(budget.camera_s > 0.0 && budget.storing_s > 0.0 && budget.recovery_s == 0.0 && budget.held_s == 0.0);
}

/// What a perfect rig would not need is a tenth of what it would.
#[test]
#[ignore = "five minutes: cargo test -p camera-worker --test acquisition -- --ignored --nocapture"]
fn overhead_in_real_time_is_a_tenth_at_most() {
    let rigged = Rigged::whole(1.0);
    let ended = rigged.run(&StartRequest::default());
    assert_eq!(ended.state, SessionState::Completed, "{:?}", ended.reason);
    let budget = ended.time_budget.unwrap();
    println!("{budget}");
    assert!(budget.overhead.unwrap() <= 0.10, "{budget:?}");
}
