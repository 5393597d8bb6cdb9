//! Power cuts on a model of a disk that keeps only what POSIX promises (`power/disk.rs`): at random operations of capture, commit,
//! develop and fit, several in one session. Nothing that was acknowledged is lost, every session goes on and is completed.
//!
//! A failure names its seed; `POWER_SEED=n cargo test --test power_cut ten_thousand` lives through that one again.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod power;
mod support;

use power::clock::VirtualClock;
use power::course::Course;
use power::disk::{Forgets, PowerDisk};
use power::faults::{Chance, Counts};
use power::lives::{Tally, live_through};
use power::turns::Turns;
use rand::SeedableRng;
use rand::rngs::StdRng;
use rig_config::{Rig, Shutter};
use rigd::session::engine::{EngineParts, start};
use rigd::session::processing::PipelineProcessing;
use rigd::session::state::SessionState as S;
use rigd::sim::camera::{CameraFaults, SimulatedCamera};
use rigd::sim::pose::SharedPose;
use rigd::store::{Store, result};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;
use support::sighted::Sighted;
use support::{Fakes, wait_for};

const NOTHING: Forgets = |_| false;
/// Sessions at a time: each waits for its own threads most of the time.
const AT_ONCE: u64 = 6;
/// Cuts after which a long run says where it is.
const PROGRESS: u64 = 100_000;

/// Sessions from `seed` on until there were `cuts`; broken promises by their seeds.
fn cut_often(seed: u64, cuts: u64, in_turn: bool) {
    let (next, total, begin) = (AtomicU64::new(seed), Mutex::new(Tally::default()), Instant::now());
    let broken = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..AT_ONCE {
            scope.spawn(|| {
                while total.lock().unwrap().cuts < cuts && broken.lock().unwrap().is_empty() {
                    let seed = next.fetch_add(1, Ordering::SeqCst);
                    match live_through(seed, Course::brief(), NOTHING, in_turn) {
                        Ok(tally) => {
                            let mut total = total.lock().unwrap();
                            total.cuts += tally.cuts;
                            total.frames += tally.frames;
                            total.repeated += tally.repeated;
                            if total.cuts / PROGRESS > (total.cuts - tally.cuts) / PROGRESS {
                                println!("{} cuts, {:.0} s", total.cuts, begin.elapsed().as_secs_f64());
                            }
                        }
                        Err(reason) => broken.lock().unwrap().push(format!("seed {seed}: {reason}")),
                    }
                }
            });
        }
    });
    let (total, broken) = (total.into_inner().unwrap(), broken.into_inner().unwrap());
    assert!(broken.is_empty(), "{}", broken.join("\n"));
    println!(
        "{} cuts in {} sessions, {} acknowledged frames, {} exposures repeated: nothing lost, {:.1} s",
        total.cuts,
        next.into_inner() - seed,
        total.frames,
        total.repeated,
        begin.elapsed().as_secs_f64()
    );
}

#[test]
fn ten_thousand_cuts_at_random_lose_nothing() {
    match std::env::var("POWER_SEED") {
        Ok(seed) => drop(live_through(seed.parse().unwrap(), Course::brief(), NOTHING, true).unwrap()),
        Err(_) => cut_often(0, 10_000, true),
    }
}

/// Here chance decides when the worker develops beside the shooting, so a seed need not bring a failure back.
#[test]
fn cuts_with_engine_and_worker_side_by_side_lose_nothing() {
    cut_often(1 << 40, 1_000, false);
}

#[test]
#[ignore = "an hour: cargo test --release --test power_cut a_million -- --ignored --nocapture"]
fn a_million_cuts_at_random_lose_nothing() {
    cut_often(1 << 32, 1_000_000, true);
}

#[test]
fn a_seed_is_the_same_cuts_at_the_same_operations_and_the_same_journal() {
    for seed in 0..20 {
        let live = || live_through(seed, Course::brief(), NOTHING, true).unwrap();
        let (first, second) = (live(), live());
        let differs = first.trace.iter().zip(&second.trace).position(|(one, other)| one != other);
        assert!(first.trace.len() == second.trace.len() && differs.is_none(), "seed {seed}: operation {differs:?}");
        assert!(first.journals == second.journals, "seed {seed}: the journals differ");
    }
}

/// Seeds enough that each of the syncs below is met by a cut that matters.
const SEEDS: Range<u64> = 0..300;

fn within(path: &Path, directory: &str) -> bool {
    path.parent().is_some_and(|parent| parent.ends_with(directory))
}

/// The session's directory, before and after it has its name.
fn is_session(path: &Path) -> bool {
    within(path, "sessions")
}

/// Every sync of the protocol is one that the model misses: a disk that forgets it breaks a promise.
#[test]
fn a_disk_that_forgets_any_one_sync_is_caught() {
    let syncs: [(&str, Forgets); 12] = [
        ("frames", |path| within(path, "frames")),
        ("names of frames", |path| path.ends_with("frames")),
        ("journal", |path| path.ends_with("journal.jsonl")),
        ("manifest", |path| path.ends_with(".manifest.json.tmp")),
        ("names in a session", is_session),
        ("names of sessions", |path| path.ends_with("sessions")),
        ("names in the data directory", |path| path.ends_with("data")),
        ("radiance", |path| within(path, "radiance")),
        ("names of radiance", |path| path.ends_with("radiance")),
        ("dataset.toml", |path| path.ends_with(".unfinished-dataset.toml")),
        ("files of a result", |path| within(path, ".unfinished-result")),
        ("names in a result", |path| path.ends_with(".unfinished-result")),
    ];
    for (what, forgets) in syncs {
        let broken = SEEDS
            .into_iter()
            .find_map(|seed| live_through(seed, Course::brief(), forgets, true).err().map(|why| (seed, why)));
        let (seed, why) = broken.unwrap_or_else(|| panic!("no cut misses the sync of {what}"));
        println!("{what}: seed {seed}: {why}");
    }
}

/// The simulated rig with small frames, short brackets and three stations.
fn simulated() -> Rig {
    let (_, text) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap();
    let mut rig = Rig::from_toml(text, "simulated.toml").unwrap();
    (rig.camera.width, rig.camera.height) = (144, 96);
    (rig.camera.focal_px, rig.camera.principal_px) = ([1650.0; 2], [72.0, 48.0]);
    rig.plan.stations_deg = vec![-55.0, 15.0, 85.0];
    rig.plan.exposures = ["1/40", "1/8", "0.6", "3.2"].map(|label| Shutter::from_label(label).unwrap()).to_vec();
    rig.simulation.as_mut().unwrap().speed = f64::INFINITY;
    rig
}

/// The real pipeline's files: all that a completed session has must be on every disk that is possible after a cut.
#[test]
fn what_the_pipeline_made_of_a_session_survives_a_cut_whole() {
    let (folder, fakes, rig) = (tempfile::tempdir().unwrap(), Fakes::default(), simulated());
    let turns = Arc::new(Turns::new(0, rig.plan.exposures.len(), None));
    let (clock, chance) = (Arc::new(VirtualClock::new(0)), Arc::new(Chance::new(0, None, Counts::default())));
    let root = folder.path().join("before");
    let disk = Arc::new(PowerDisk::new(&root, NOTHING, turns, clock, chance));
    let store = Store::open_on(&root.join("data"), 0, disk.clone()).unwrap();
    let (sight, of_camera) = (fakes.clone(), rig.clone());
    let engine = start(EngineParts {
        open_camera: Box::new(move |_| {
            let (simulation, pose) = (of_camera.simulation.as_ref().unwrap(), SharedPose::default());
            let camera = SimulatedCamera::new(&of_camera, simulation, pose.clone(), CameraFaults::default());
            Ok(Box::new(Sighted(camera, sight.clone(), pose)))
        }),
        processing: Box::new(PipelineProcessing::new(&rig)),
        ..fakes.parts(store, rig, "")
    })
    .unwrap();
    let id = support::begin(&engine);
    wait_for(&engine, &id, S::Completed);
    engine.shutdown().unwrap();
    let session = Path::new("data/sessions").join(&id);
    let mut files: Vec<PathBuf> = result::FILES.iter().map(|name| Path::new("result").join(name)).collect();
    files.extend(["manifest.json", "journal.jsonl", "dataset.toml", "frames/002-03.jpg"].map(PathBuf::from));
    files.extend((0..3).map(|station| PathBuf::from(format!("radiance/{station:02}.exr"))));
    for seed in 0..50 {
        let after = folder.path().join(seed.to_string());
        disk.image(&mut StdRng::seed_from_u64(seed), &after);
        for file in &files {
            let read = |root: &Path| std::fs::read(root.join(&session).join(file)).unwrap_or_default();
            let (before, after) = (read(&root), read(&after));
            assert!(!before.is_empty() && before == after, "seed {seed}: {}", file.display());
        }
        std::fs::remove_dir_all(after).unwrap();
    }
}
