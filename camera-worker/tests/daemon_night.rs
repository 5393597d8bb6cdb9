//! A night of the real daemon before simulated hardware, many times faster than real: 181 stations of ten exposures through the real
//! libgphoto2 and a serial port, a fault about every 50 frames. It is completed, its memory stays flat, its watchdog is never late; and
//! when the host dies, the lamp is out and the arm stands within the dead-man's time.
//!
//! The short form has 9 stations. It needs `rigd` beside the tests: `cargo build` makes it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "../../tests/daemon/mod.rs"]
mod daemon;
mod overnight;

use overnight::{Night, SPEED};
use std::time::{Duration, Instant};

/// Frames between two faults, on average.
const FAULT_EVERY: f64 = 50.0;
/// What memory may grow by after the first hour, bytes an hour.
const GROWTH: f64 = 1e6;
/// Lamp out and arm at rest after the host died.
const SAFE: Duration = Duration::from_secs(2);

#[test]
fn a_short_night_is_completed_and_a_killed_host_leaves_the_rig_safe() {
    let mut night = Night::begin(9);
    let story = night.shoot(1, FAULT_EVERY / 3.0);
    println!("{story}");
    assert!(story.longest_silence < overnight::WATCHDOG, "{story}");
    host_dies(&mut night);
}

#[test]
#[ignore = "ten minutes: cargo test -p camera-worker --test daemon_night -- --ignored --nocapture"]
fn a_night_of_1810_frames_is_completed_in_flat_memory() {
    let mut night = Night::begin(181);
    let story = night.shoot(2, FAULT_EVERY);
    println!("{story}");
    assert!(story.longest_silence < overnight::WATCHDOG, "{story}");
    let growth = story.growth_an_hour().expect("the night is longer than an hour");
    println!("memory grew by {:.2} MB an hour after the first", growth / 1e6);
    assert!(growth < GROWTH, "{growth} bytes an hour");
    host_dies(&mut night);
}

/// Kills the daemon while the arm moves with the lamp lit.
fn host_dies(night: &mut Night) {
    // A few stations: the card has no room for a second night.
    let session = night.begin_another(r#"{"stations_deg": [0.0, 30.0, 60.0]}"#);
    night.wait_until_it_moves(&session);
    night.daemon.kill();
    let died = Instant::now();
    while !night.is_safe() {
        assert!(died.elapsed() < SAFE, "{:?} after the host died: {:?}", died.elapsed(), night.pose.get());
        std::thread::sleep(Duration::from_millis(5));
    }
    println!(
        "safe {:.2} s after the host died (the rig is {SPEED} times faster than real)",
        died.elapsed().as_secs_f64()
    );
}
