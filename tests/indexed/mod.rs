//! Data directories whose index is kept, and what it says of them.
#![allow(dead_code, reason = "each test file uses its part")]

use crate::support::{self, Fakes, begin, events, until, wait_for};
use rig_config::{Calibration, Rig, Shutter};
use rigd::devices::camera::CameraError;
use rigd::session::engine::start;
use rigd::session::handle::{CalibrationRequest, EngineHandle};
use rigd::session::state::{SessionState as S, Verb};
use rigd::store::Store;
use rigd::store::index::{FILE, Reader, Rows};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use support::Act;

/// The rig of the fakes, which can be calibrated: one view of the board, a card, balls; two stations, of which one lights the card.
pub fn rig() -> Rig {
    let labels = ["1/100", "0.4", "1"].map(|label| Shutter::from_label(label).unwrap());
    let calibration = Calibration {
        board_columns: 9,
        board_rows: 6,
        square_mm: 5.0,
        board_views: 1,
        board_exposure: labels[1].clone(),
        board_station_deg: 15.0,
        card_reflectance: 0.18,
        card_reflectance_sigma: 0.02,
        card_side_mm: 40.0,
        balls: 3,
        ball_radius_mm: 10.0,
        stations_deg: vec![-20.0, 110.0],
        exposures: labels.to_vec(),
        max_age_days: 30.0,
    };
    Rig { calibration: Some(calibration), ..support::rig() }
}

/// An engine that keeps an index.
pub fn engine(fakes: &Fakes, data: &Path, rig: Rig) -> EngineHandle {
    let store = Store::open_on(data, 1000, fakes.disk.clone()).unwrap().with_index();
    start(fakes.parts(store, rig, "name = \"fake rig\"")).unwrap()
}

/// Where small files cost least.
pub fn folder() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() { tempfile::tempdir_in(memory).unwrap() } else { tempfile::tempdir().unwrap() }
}

/// All that the index says, by run.
pub fn dump(data: &Path) -> Vec<Rows> {
    let reader = Reader::open(data).unwrap();
    reader.heads().unwrap().keys().map(|id| reader.rows(id).unwrap().unwrap()).collect()
}

/// The same of an index that is made anew from a copy of the journals, without any daemon.
pub fn from_journals(data: &Path) -> Vec<Rows> {
    let copy = folder();
    for run in runs(data) {
        let there = copy.path().join(run.strip_prefix(data).unwrap());
        std::fs::create_dir_all(&there).unwrap();
        for file in ["manifest.json", "journal.jsonl"] {
            std::fs::copy(run.join(file), there.join(file)).unwrap();
        }
    }
    rigd::session::index::rebuild(copy.path()).unwrap();
    dump(copy.path())
}

/// Directories of all runs.
pub fn runs(data: &Path) -> Vec<PathBuf> {
    let shelves = ["sessions", "calibrations"].map(|shelf| data.join(shelf));
    let of = |shelf: &PathBuf| std::fs::read_dir(shelf).unwrap().map(|entry| entry.unwrap().path()).collect();
    let mut runs: Vec<PathBuf> = shelves.iter().flat_map::<Vec<_>, _>(of).collect();
    runs.sort();
    runs
}

/// The index's files that are there, with their bytes.
pub fn files(data: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let names = ["", "-wal", "-shm"].map(|ending| data.join(format!("{FILE}{ending}")));
    names.into_iter().filter_map(|path| std::fs::read(&path).ok().map(|bytes| (path, bytes))).collect()
}

/// Puts these files in place of what is there.
pub fn restore(data: &Path, kept: &[(PathBuf, Vec<u8>)]) {
    files(data).iter().for_each(|(path, _)| std::fs::remove_file(path).unwrap());
    kept.iter().for_each(|(path, bytes)| std::fs::write(path, bytes).unwrap());
}

/// Runs of every kind, in two lives of a daemon. What they were, in the order in which they began.
pub struct Lived {
    /// Interrupted in the middle of its second station and taken up: one frame of it is superseded. Fitted twice.
    pub resumed: String,
    pub stopped: String,
    pub calibration: String,
}

/// Lives them, and leaves the second daemon running.
pub fn live(fakes: &Fakes, data: &Path) -> (EngineHandle, Lived) {
    fakes.on_shot(|_, count, cancel| {
        if count == 3 {
            until("the cancel", || cancel.is_cancelled());
            return Act::Fail(CameraError::Cancelled);
        }
        Act::Good
    });
    let first = engine(fakes, data, rig());
    let resumed = begin(&first);
    until("the shot", || fakes.world().shots.len() == 4);
    first.shutdown().unwrap();
    fakes.on_shot(|_, _, _| Act::Good);
    let engine = engine(fakes, data, rig());
    wait_for(&engine, &resumed, S::Completed);

    let gate = fakes.gate_at(fakes.world().shots.len() + 3);
    let stopped = begin(&engine);
    gate.reached();
    engine.command(&stopped, Verb::Stop).unwrap();
    gate.open();
    wait_for(&engine, &stopped, S::Stopped);

    let calibration = engine.start_calibration(&CalibrationRequest::default()).unwrap().id;
    until("the calibration", || {
        let now = engine.calibration(&calibration).unwrap();
        if now.state == S::Awaiting {
            // Refused when it has gone on since.
            let _ = engine.command_calibration(&calibration, Verb::Shoot);
        }
        assert!(!now.state.is_final() || now.state == S::Completed, "{:?}: {:?}", now.state, now.reason);
        now.state == S::Completed
    });
    engine.refit(&resumed, &Default::default()).unwrap();
    until("the refit", || events(&engine, &resumed, "fit.finished").len() == 2);
    (engine, Lived { resumed, stopped, calibration })
}

pub fn rigd(arguments: &[&str], data: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rigd")).args(arguments).arg(data).env("TZ", "UTC").output().unwrap()
}

/// Exit status and all that was said.
pub fn said(out: &Output) -> (Option<i32>, String) {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (out.status.code(), text(&out.stdout) + &text(&out.stderr))
}
