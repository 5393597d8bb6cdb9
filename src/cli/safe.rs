//! `rigd safe`: arm stopped and parked, lamp off, without a daemon.

use super::daemon;
use super::error::print_line;
use super::on_rig::OnRig;
use crate::devices::Cancel;
use crate::session::bench::Bench;
use crate::store::Store;
use anyhow::{Context, bail};

/// Stop the arm, switch the lamp off and park, where no daemon does.
///
/// rigd.service runs it after every end of the daemon, however that came about. An arm that lost its home position is stopped, not moved.
/// Exit status: 0 the arm's own status says that all is safe, 1 it is not or a daemon has the data directory, 2 wrong usage or a bad
/// rig file.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    on: OnRig,
}

/// Runs the command.
///
/// # Errors
/// A daemon that runs, or what could not be done, and what to do by hand.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let rig = args.on.read()?;
    // Held until the end: a daemon that starts meanwhile must not meet a moving arm.
    let _held = Store::open(&rig.storage.data, 0).context("nothing was touched")?;
    let (open_arm, open_camera) = daemon::devices(&rig)?;
    let faults = Bench::new(rig, open_arm, open_camera, Vec::new(), true, &Cancel::default()).clean_up();
    if !faults.is_empty() {
        bail!("{}", faults.join("; "));
    }
    Ok(print_line("the arm stands and the lamp is off")?)
}
