//! What the index says of a run: its manifest, and its journal added up. The same account is made while a session goes on, at a
//! rebuild, and to check what the index says.

use crate::session::calibration::plan::{CalibrationPlan, Kind};
use crate::session::ledger::{FrameRecord, Ledger};
use crate::session::work::Work;
use crate::store::StoreError;
use crate::store::index::{FitRow, FrameRow, Rows, RunRow};
use crate::store::journal::{self, Follower, Head};
use crate::store::manifest::Manifest;
use serde::Deserialize;
use serde_json::Value;
use std::path::Path;

/// The account of a run, as far as its journal was read.
pub(super) struct Account {
    follower: Follower,
    ledger: Ledger,
    fits: Vec<FitRow>,
    kind: &'static str,
    version: Option<u64>,
    rig: Option<String>,
}

impl Account {
    /// Nothing is read yet.
    pub(super) fn new(directory: &Path, manifest: &Manifest, work: &Work) -> Self {
        let kind = match work.calibration().map(CalibrationPlan::kind) {
            None => "session",
            Some(Kind::Rig) => "calibration",
            Some(Kind::Settle) => "settle",
        };
        let rig = manifest.rig_file.parse::<toml::Table>().ok();
        Self {
            follower: Follower::new(directory.join(journal::FILE)),
            ledger: Ledger::new(manifest, work),
            fits: Vec::new(),
            kind,
            version: manifest.version,
            rig: rig.and_then(|rig| rig.get("name")?.as_str().map(str::to_owned)),
        }
    }

    /// How far the journal was read.
    pub(super) fn head(&self) -> &Head {
        self.follower.head()
    }

    /// Reads the journal on, up to record number `last`.
    ///
    /// # Errors
    /// It cannot be read.
    pub(super) fn read_to(&mut self, last: u64) -> Result<(), StoreError> {
        for record in self.follower.read_to(last)? {
            self.ledger.apply(&record);
            if record["type"] == "fit.finished"
                && record["error"].is_null()
                && let Ok(fit) = FitRow::deserialize(record)
            {
                self.fits.push(fit);
            }
        }
        Ok(())
    }

    /// What is to be said; `fault`: why the journal cannot be trusted beyond the last record that counts, if so.
    pub(super) fn rows(&self, fault: Option<&String>) -> Rows {
        let snapshot = &self.ledger.snapshot;
        let head = self.head();
        let used = snapshot.calibration.as_ref();
        let run = RunRow {
            kind: self.kind.into(),
            name: snapshot.name.clone(),
            state: snapshot.state.to_string(),
            reason: snapshot.reason.clone(),
            simulated: snapshot.simulated,
            started: snapshot.started.clone(),
            ended: snapshot.ended.clone(),
            rig: self.rig.clone(),
            calibration: used.map(|used| used.id.clone()),
            calibration_version: used.map(|used| used.version).or(self.version).map(number),
            stations: number(snapshot.stations),
            frames_planned: number(snapshot.frames_planned),
            frames_committed: number(snapshot.frames_committed),
            records: number(head.records),
            hash: head.hash.clone(),
            fault: fault.or(head.fault.as_ref()).cloned(),
        };
        let mut frames: Vec<_> = self.ledger.labelled().into_iter().map(|(frame, state)| row(frame, state)).collect();
        frames.sort_by(|a, b| a.file.cmp(&b.file));
        // The engine gives each frame a name of its own; a journal that somebody wrote may not.
        frames.dedup_by(|a, b| a.file == b.file);
        Rows { id: snapshot.id.clone(), run, frames, fits: self.fits.clone() }
    }
}

fn row(frame: &FrameRecord, state: &str) -> FrameRow {
    FrameRow {
        file: frame.file.clone(),
        station: number(frame.station),
        exposure: number(frame.exposure),
        attempt: number(frame.attempt),
        bracket: number(frame.bracket),
        // SQLite keeps no sign of a zero.
        angle_deg: frame.angle_deg.map(|angle| angle + 0.0),
        shutter: frame.shutter.clone(),
        true_s: frame.true_s,
        bytes: number(frame.bytes),
        blake3: frame.blake3.clone(),
        taken: frame.taken.clone(),
        state: state.into(),
    }
}

/// A count as SQLite has it.
fn number(count: impl TryInto<i64>) -> i64 {
    count.try_into().unwrap_or(i64::MAX)
}

/// Column by column, in what two rows differ; the names of the columns, what the first says and what the second.
pub(super) fn differences(said: &impl serde::Serialize, told: &impl serde::Serialize) -> Vec<(String, Value, Value)> {
    let (Ok(Value::Object(said)), Ok(Value::Object(mut told))) =
        (serde_json::to_value(said), serde_json::to_value(told))
    else {
        return Vec::new();
    };
    let pairs = said.into_iter().map(|(name, said)| {
        let told = told.remove(&name).unwrap_or_default();
        (name, said, told)
    });
    pairs.filter(|(_, said, told)| said != told).collect()
}
