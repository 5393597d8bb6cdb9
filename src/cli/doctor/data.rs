//! The data directory: whether it can be written, has room for the rig file's plan, and is free. And whether the memory suffices.

use crate::devices::inspect::{Finding, Host, holders};
use crate::session::plan::{CapturePlan, StartRequest};
use crate::session::preflight;
use crate::store::{Disk, memory as store_memory};
use rig_config::Rig;
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

/// Whether the rig's sessions have room. Nothing is made or written.
pub fn room(host: &Host, rig: &Rig, disk: &dyn Disk) -> Finding {
    let data = &rig.storage.data;
    let place = data.display();
    let there = nearest(data);
    if !(host.may_use)(&there) {
        let what = format!("this user may not write to {}", there.display());
        return Finding::error(place, what, "change its owner, or choose another with storage.data or --data");
    }
    let plan = match CapturePlan::new(rig, &StartRequest::default()) {
        Ok(plan) => plan,
        Err(error) => return Finding::error("plan", error.to_string(), "correct the rig file"),
    };
    let needed = plan.bytes(rig, rig.calibration.is_some()).saturating_add(rig.storage.reserve_bytes);
    match disk.free_bytes(&there) {
        Ok(free) if free >= needed => {
            Finding::ok(place, format!("{} are free, the plan and the reserve need {}", gb(free), gb(needed)))
        }
        Ok(free) => {
            let what = format!("only {} are free, the plan and the reserve need {}", gb(free), gb(needed));
            Finding::error(place, what, "make room, or choose another directory with storage.data or --data")
        }
        Err(error) => {
            Finding::error(place, format!("its free space is not known: {error}"), "check that its disk is mounted")
        }
    }
}

/// Whether the rig file's plan can be developed and fitted in the memory that is left; nothing where the plan is none.
pub fn memory(host: &Host, rig: &Rig) -> Option<Finding> {
    let plan = CapturePlan::new(rig, &StartRequest::default()).ok()?;
    Some(match store_memory::available(&host.proc) {
        Ok(available) => match preflight::lack_of_memory(rig, &plan, available) {
            Some(what) => Finding::warning("memory", what, "a night that runs out of memory ends the daemon"),
            None => {
                let needed = preflight::memory_bytes(rig, &plan);
                Finding::ok("memory", format!("{} are available, the plan takes up to {}", gb(available), gb(needed)))
            }
        },
        Err(error) => Finding::warning("memory", format!("how much is left is not known: {error}"), "mount /proc"),
    })
}

/// Another rigd that has the data directory, if there is one. Nothing is made or written.
pub fn holder(host: &Host, data: &Path) -> Option<Finding> {
    let held = File::open(data).is_ok_and(|lock| matches!(lock.try_lock_shared(), Err(TryLockError::WouldBlock)));
    held.then(|| {
        let who = holders::of(host, data).found.first().map_or("another rigd".into(), ToString::to_string);
        let what = format!("in use by {who}; arm and camera are its own and were not opened");
        Finding::warning(
            data.display(),
            what,
            "start sessions there; a second rigd serve needs another --data and another rig",
        )
    })
}

/// The directory, or the nearest one above it that there is.
fn nearest(directory: &Path) -> PathBuf {
    let absolute = std::path::absolute(directory).unwrap_or_else(|_| directory.to_path_buf());
    absolute.ancestors().find(|path| path.exists()).unwrap_or(Path::new("/")).to_path_buf()
}

fn gb(bytes: u64) -> String {
    format!("{:.2} GB", bytes as f64 / 1e9)
}
