//! Sessions that are removed after their time, and all those that are not.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod power;
mod support;

use power::clock::VirtualClock;
use power::disk::{Forgets, PowerDisk};
use power::faults::{Chance, Counts};
use power::turns::Turns;
use rand::SeedableRng;
use rand::rngs::StdRng;
use rig_config::Rig;
use rigd::session::handle::EngineHandle;
use rigd::session::state::{SessionState as S, Verb};
use rigd::session::verify::verify;
use rigd::store::Store;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use support::{Fakes, begin, rig, until, wait_for};

/// As long as everything here is older than it.
const NO_TIME: f64 = 1e-12;

fn keeping(keep_days: f64) -> Rig {
    let mut rig = rig();
    rig.storage.keep_days = Some(keep_days);
    rig
}

fn completed(engine: &EngineHandle) -> String {
    let id = begin(engine);
    wait_for(engine, &id, S::Completed);
    id
}

fn rigd(command: &str, arguments: &[&Path]) -> (Option<i32>, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_rigd")).arg(command).args(arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (out.status.code(), text(&out.stdout) + &text(&out.stderr))
}

/// The shipped rig file with a time to keep sessions.
fn rig_file(folder: &Path, keep_days: &str) -> std::path::PathBuf {
    let (_, text) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap();
    let (path, edited) =
        (folder.join("rig.toml"), text.replace("# keep_days = 90", &format!("keep_days = {keep_days}")));
    assert_ne!(*text, edited);
    std::fs::write(&path, edited).unwrap();
    path
}

#[test]
fn only_what_is_completed_old_and_verified_as_it_stands_goes() {
    let (fakes, folder) = (Fakes::default(), tempfile::tempdir().unwrap());
    let data = folder.path().join("data");
    let engine = fakes.engine(&data);
    let [goes, refitted] = [(); 2].map(|()| completed(&engine));
    let gate = fakes.gate_at(13);
    let aborted = begin(&engine);
    gate.reached();
    engine.command(&aborted, Verb::Abort).unwrap();
    gate.open();
    wait_for(&engine, &aborted, S::Aborted);
    let (status, said) = rigd("verify", &[&data]);
    assert_eq!(status, Some(0), "{said}");
    let unverified = completed(&engine);
    let before = engine.session(&refitted).unwrap().last_seq;
    engine.refit(&refitted, &Default::default()).unwrap();
    until("the refit", || {
        let fits = support::events(&engine, &refitted, "fit.finished");
        engine.session(&refitted).unwrap().last_seq > before && fits.len() == 2
    });
    engine.shutdown().unwrap();

    let config = rig_file(folder.path(), "1e-9");
    let arguments = [Path::new("--config"), &config, Path::new("--data"), &data];
    let (status, listed) = rigd("retention", &arguments);
    assert_eq!(status, Some(0), "{listed}");
    for (id, verdict) in [
        (&goes, "goes, ended "),
        (&refitted, "stays: it was not verified as it stands"),
        (&aborted, "stays: it is aborted"),
        (&unverified, "stays: it was not verified as it stands"),
    ] {
        assert!(listed.lines().any(|line| line.starts_with(&format!("{id}  {verdict}"))), "{id} {verdict}: {listed}");
    }
    rig_file(folder.path(), "100");
    let (_, listed) = rigd("retention", &arguments);
    assert!(listed.contains(&format!("{goes}  stays: it ended 0.0 days ago and is kept for 100")), "{listed}");

    // Everything is there until the daemon comes whose rig file says so.
    let engine = fakes.try_engine(&data, keeping(100.0)).unwrap();
    assert_eq!(engine.sessions().len(), 4);
    engine.shutdown().unwrap();
    let engine = fakes.try_engine(&data, keeping(NO_TIME)).unwrap();
    until("the removal", || engine.session(&goes).is_err());
    until("the files to go", || !names(&data).iter().any(|name| name.contains(&goes)));
    let stay = [refitted, aborted, unverified];
    assert!(stay.iter().all(|id| engine.session(id).is_ok()));
    engine.shutdown().unwrap();
    assert_eq!(names(&data), stay);
}

/// Names in the folder of sessions, oldest first.
fn names(data: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(data.join("sessions")).unwrap();
    let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// A completed session on a disk that loses power.
fn session_on(root: &Path) -> (PowerDisk, String) {
    let (fakes, rig) = (Fakes::default(), rig());
    let turns = Arc::new(Turns::new(0, rig.plan.exposures.len(), None));
    let (clock, chance) = (Arc::new(VirtualClock::new(0)), Arc::new(Chance::new(0, None, Counts::default())));
    let disk = Arc::new(PowerDisk::new(root, |_| false, turns, clock, chance));
    let store = Store::open_on(&root.join("data"), 0, disk.clone()).unwrap();
    let engine = rigd::session::engine::start(fakes.parts(store, rig, "")).unwrap();
    let id = completed(&engine);
    engine.shutdown().unwrap();
    let whole = disk.image(&mut StdRng::seed_from_u64(0), &root.with_extension("whole"));
    (whole, id)
}

/// Removes the session on copies of the disk whose power goes at every operation of it; how often the session was found in part.
fn parts_left(folder: &Path, forgets: Forgets) -> usize {
    let (base, id) = session_on(&folder.join("disk"));
    let (mut parts, mut whole, mut gone) = (0, 0, 0);
    for seed in 0..60 {
        let mut random = StdRng::seed_from_u64(seed);
        let (at, after) = (folder.join(format!("{seed}")), folder.join(format!("{seed}-after")));
        let disk = Arc::new(base.image(&mut random, &at).forgetting(forgets));
        let store = Store::open_on(&at.join("data"), 0, disk.clone()).unwrap();
        disk.arm(Some(seed % 4), seed % 8 < 4);
        let grave = store.take_out(&at.join("data/sessions").join(&id));
        if let Ok(grave) = grave {
            let _ = rigd::store::Disk::remove_directory(disk.as_ref(), &grave);
        }
        disk.image(&mut random, &after);
        let data = after.join("data");
        let store = Store::open(&data, 0).unwrap();
        let (found, unreadable) = store.runs().unwrap();
        let sound =
            |run: &rigd::store::sessions::Found| verify(&run.directory).is_ok_and(|found| found.faults.is_empty());
        match found.first() {
            _ if !unreadable.is_empty() => parts += 1,
            Some(run) if sound(run) => whole += 1,
            Some(_) => parts += 1,
            None => gone += 1,
        }
        // What a cut left half removed is removed at the start.
        assert_eq!(names(&data).len(), found.len() + unreadable.len(), "seed {seed}");
    }
    assert!(whole > 0 && gone > 0, "{whole} whole, {gone} gone: the cuts met nothing");
    parts
}

#[test]
fn a_power_cut_leaves_a_removed_session_whole_or_gone() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(parts_left(folder.path(), |_| false), 0);
    // A disk that forgets the new name while the files go is caught.
    let folder = tempfile::tempdir().unwrap();
    assert!(parts_left(folder.path(), |path| path.ends_with("sessions")) > 0);
}
