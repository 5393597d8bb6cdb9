//! The index's file: what is written is what is read, by readers beside the writer as well.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rigd::store::index::{FILE, FitRow, FrameRow, Index, IndexError, Reader, Rows, RunRow, Wanted};
use serde_json::json;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// A run after so many frames: what it says follows from that number.
fn rows(id: &str, frames: i64) -> Rows {
    let run = RunRow {
        kind: "session".into(),
        name: "marble 'ball'; \u{1f526}".into(),
        state: if frames % 2 == 0 { "running" } else { "paused" }.into(),
        reason: (frames % 3 == 0).then(|| format!("after {frames}")),
        simulated: frames % 2 == 0,
        started: "2026-11-30T20:00:00Z".into(),
        ended: None,
        rig: None,
        calibration: None,
        calibration_version: Some(7),
        stations: 7,
        frames_planned: 70,
        frames_committed: frames,
        records: 3 * frames,
        hash: Some(blake3::hash(&frames.to_le_bytes()).to_hex().to_string()),
        fault: None,
    };
    let frame = |number: i64| FrameRow {
        file: format!("{:03}-{:02}.jpg", number / 10, number % 10),
        station: number / 10,
        exposure: number % 10,
        attempt: 1,
        bracket: 1 + number / 10,
        angle_deg: (number % 4 > 0).then_some(0.1 * number as f64),
        shutter: "1/100".into(),
        true_s: 0.1 + 0.2,
        bytes: i64::MAX - number,
        blake3: blake3::hash(&number.to_le_bytes()).to_hex().to_string(),
        taken: None,
        // The last one of every earlier state counts no more.
        state: if number + 1 < frames && number % 5 == 0 { "superseded" } else { "committed" }.into(),
    };
    let fit = |seq: i64| FitRow {
        seq,
        time: "2026-11-30T21:00:00Z".into(),
        model: (seq % 2 == 0).then(|| "ward".into()),
        materials: Some(2),
        mean_relative_error: Some(1.0),
        left_out_relative_error: None,
        iterations: Some(12),
        termination: Some("converged".into()),
        parameters: json!([{"rho_d": [{"value": 1e-7, "standard_error": null}], "share": 0.30000000000000004}]),
    };
    Rows { id: id.into(), run, frames: (0..frames).map(frame).collect(), fits: (0..frames / 20).map(fit).collect() }
}

fn all(data: &Path) -> Vec<Rows> {
    let reader = Reader::open(data).unwrap();
    reader.heads().unwrap().keys().map(|id| reader.rows(id).unwrap().unwrap()).collect()
}

#[test]
fn what_is_written_is_read_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path();
    let mut index = Index::open(data).unwrap();
    let [before, after, other] = [rows("a", 40), rows("a", 70), rows("b", 3)];
    index.put(&before).unwrap();
    index.put(&other).unwrap();
    index.put(&after).unwrap();
    assert_eq!(all(data), [after.clone(), other.clone()], "beside the writer");
    drop(index);
    assert_eq!(all(data), [after.clone(), other.clone()], "after it");
    let mut index = Index::open(data).unwrap();
    assert_eq!(all(data), [after.clone(), other.clone()], "opened again it is taken as it is");
    // Nothing is left of what was there.
    index.put(&other).unwrap();
    index.put(&Rows { id: "a".into(), ..other.clone() }).unwrap();
    assert_eq!(all(data)[0], Rows { id: "a".into(), ..other.clone() });
    index.remove("a").unwrap();
    assert_eq!(all(data), [other]);
    let reader = Reader::open(data).unwrap();
    let asked = |wanted: Wanted| reader.runs(&wanted).unwrap().len();
    assert_eq!(asked(Wanted { calibration: Some("7".into()), ..Wanted::default() }), 1);
    assert_eq!(asked(Wanted { state: Some("running".into()), ..Wanted::default() }), 0);
    let hash = blake3::hash(&2_i64.to_le_bytes()).to_hex().to_string();
    let found = reader.runs(&Wanted { frame: Some(hash), ..Wanted::default() }).unwrap();
    assert_eq!(found[0].frames.iter().map(|frame| &*frame.file).collect::<Vec<_>>(), ["000-02.jpg"]);
}

#[test]
fn another_version_and_rows_that_were_not_written_here_are_not_believed() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path();
    assert!(matches!(Reader::open(data), Err(IndexError::Missing { .. })));
    for change in [
        "PRAGMA user_version = 2",
        "UPDATE frames SET state = 'committed' WHERE file = '000-00.jpg'",
        "UPDATE runs SET state = 'completed'",
        "DELETE FROM fits WHERE seq = 0",
        "INSERT INTO frames (run, file) VALUES ('c', '000-00.jpg')",
        "DELETE FROM runs",
        "UPDATE frames SET run = 'c'",
        "DROP TABLE fits",
    ] {
        Index::make(data).unwrap().put(&rows("a", 41)).unwrap();
        let foreign = rusqlite::Connection::open(data.join(FILE)).unwrap();
        foreign.execute_batch(change).unwrap();
        drop(foreign);
        drop(Index::open(data).unwrap());
        let made = rusqlite::Connection::open(data.join(FILE)).unwrap();
        let rows = "SELECT (SELECT count(*) FROM runs) + (SELECT count(*) FROM frames) + (SELECT count(*) FROM fits)";
        assert_eq!(made.query_row(rows, [], |row| row.get(0)), Ok(0), "{change}");
    }
}

/// Two readers ask while a session grows: each answer is one that was written as a whole, and none is older than the one before.
#[test]
fn readers_beside_the_writer_see_whole_states_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path();
    let mut index = Index::open(data).unwrap();
    index.put(&rows("a", 0)).unwrap();
    let ended = AtomicBool::new(false);
    let read = || {
        let (mut last, mut states) = (0, 0);
        loop {
            let ending = ended.load(Ordering::SeqCst);
            let seen = Reader::open(data).unwrap().rows("a").unwrap().unwrap();
            let frames = seen.run.frames_committed;
            assert_eq!(seen, rows("a", frames));
            assert!(frames >= last, "{frames} after {last}");
            states += usize::from(frames > last);
            last = frames;
            if ending {
                return (last, states);
            }
        }
    };
    std::thread::scope(|scope| {
        let readers = [scope.spawn(read), scope.spawn(read)];
        for frames in 1..=150 {
            index.put(&rows("a", frames)).unwrap();
        }
        ended.store(true, Ordering::SeqCst);
        for reader in readers {
            let (last, states) = reader.join().unwrap();
            assert!(last == 150 && states > 1, "{states} states seen, the last of {last} frames");
        }
    });
}
