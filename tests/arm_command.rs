//! `rigd simulate arm` as another program meets it. One test, because it ends the command with a signal to this process.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use clap::Parser;
use nix::sys::signal::{Signal, raise};
use rigd::cli::simulate::arm::{Args, run};
use rigd::devices::Cancel;
use rigd::devices::arm::Arm;
use rigd::devices::rigproto::{RigprotoArm, RigprotoSettings};
use std::path::Path;
use std::time::{Duration, Instant};

#[derive(Parser)]
struct Command {
    #[command(flatten)]
    args: Args,
}

#[test]
fn the_command_serves_an_arm_until_a_signal_and_removes_its_link() {
    let rig_file = Path::new(env!("CARGO_MANIFEST_DIR")).join("rig-config/rigs/simulated.toml");
    let directory = tempfile::tempdir().unwrap();
    let link = directory.path().join("arm");
    let words = ["simulate-arm", "--config", rig_file.to_str().unwrap(), "--link", link.to_str().unwrap()];
    let args = Command::parse_from(words).args;
    let command = std::thread::spawn(|| run(args));

    let started = Instant::now();
    while !link.exists() {
        assert!(!command.is_finished(), "{:?}", command.join());
        assert!(started.elapsed() < Duration::from_secs(20), "no link appeared");
        std::thread::sleep(Duration::from_millis(5));
    }
    let rig = rig_config::Rig::read(&rig_file).unwrap();
    let mut arm = RigprotoArm::open(RigprotoSettings::new(link.clone(), &rig.arm)).unwrap();
    assert!(arm.home(&Cancel::default()).unwrap().homed);
    drop(arm);

    // The link exists only once the command listens for signals.
    raise(Signal::SIGTERM).unwrap();
    command.join().unwrap().unwrap();
    assert!(std::fs::symlink_metadata(&link).is_err(), "the link was left behind");

    let missing = Command::parse_from(["simulate-arm", "--config", "no-such-rig.toml"]).args;
    assert!(run(missing).unwrap_err().to_string().contains("no-such-rig.toml"));
}
