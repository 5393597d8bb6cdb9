//! What the handle knows of calibrations: runs, their results, and the one a session is to use.

use super::{EngineError, EngineHandle};
use crate::session::book::{Entry, Inner};
use crate::session::calibration::file::{self, CalibrationFile, FILE_HASH};
use crate::session::calibration::plan::{CalibrationPlan, CalibrationRequest, Kind};
use crate::session::calibration::progress::CalibrationSnapshot;
use crate::session::calibration::step::Step;
use crate::session::calibration::{settle, stale};
use crate::session::plan::{CapturePlan, PlanError, StartRequest, UsedCalibration};
use crate::session::state::{SessionState, Verb};
use crate::session::work::Work;
use crate::store::manifest::Manifest;
use serde_json::Value;

impl EngineHandle {
    /// Starts a calibration run: it asks for its first step once arm, camera and lamp are ready.
    ///
    /// # Errors
    /// No `[calibration]` in the rig file, a busy rig, no room.
    pub fn start_calibration(&self, request: &CalibrationRequest) -> Result<CalibrationSnapshot, EngineError> {
        let plan = CalibrationPlan::new(&self.rig, request)?;
        let mut inner = self.book.lock();
        inner.check_idle()?;
        inner.store.check_space(plan.estimated_bytes)?;
        let last = inner.runs.values().filter_map(|entry| entry.manifest.version).max();
        let manifest = Manifest { version: Some(last.unwrap_or(0) + 1), ..self.manifest(&plan.name, &plan)? };
        let id = manifest.id.clone();
        inner.begin(manifest, Work::Calibration(plan), &[], 1.0 / self.speed)?;
        let snapshot = inner.calibration(&id)?.1;
        drop(inner);
        self.book.tell();
        Ok(snapshot)
    }

    /// Asks something of a calibration run: to shoot, because what is asked for is in place, or to abort.
    ///
    /// # Errors
    /// No such run, or a verb that makes no sense now.
    pub fn command_calibration(&self, id: &str, verb: Verb) -> Result<CalibrationSnapshot, EngineError> {
        self.book.lock().calibration(id)?;
        let unknown = || EngineError::UnknownCalibration { id: id.to_owned() };
        self.book.ask(id, verb, Entry::calibration)?.ok_or_else(unknown)
    }

    /// Every calibration run, newest first.
    pub fn calibrations(&self) -> Vec<CalibrationSnapshot> {
        self.book.lock().runs.values().rev().filter_map(Entry::calibration).collect()
    }

    /// One calibration run.
    ///
    /// # Errors
    /// No such run.
    pub fn calibration(&self, id: &str) -> Result<CalibrationSnapshot, EngineError> {
        self.book.lock().calibration(id).map(|(_, snapshot)| snapshot)
    }

    /// What the running calibration asks for, with its id; none when no calibration runs. [`EngineHandle::changes`] tells when to look
    /// again.
    pub fn calibration_step(&self) -> Option<(String, Step)> {
        let snapshot = self.book.lock().active()?.calibration()?;
        Some((snapshot.id, snapshot.step))
    }

    /// `calibration.json` of a completed run (camera, response and lights with their uncertainties), or `settle.json` of one of kind
    /// `settle`; none while there is none.
    ///
    /// # Errors
    /// No such run, or a file that is damaged or gone.
    pub fn calibration_result(&self, id: &str) -> Result<Option<Value>, EngineError> {
        let (snapshot, directory) = {
            let inner = self.book.lock();
            let (entry, snapshot) = inner.calibration(id)?;
            (snapshot, entry.directory.clone())
        };
        if snapshot.state != SessionState::Completed {
            return Ok(None);
        }
        let CalibrationSnapshot { id, version, kind, .. } = snapshot;
        let damaged = |reason| EngineError::DamagedCalibration { id, version, reason };
        let read = match kind {
            Kind::Rig => CalibrationFile::read(&file::path(&directory))
                .and_then(|(_, text)| serde_json::from_str(&text).map_err(|e| e.to_string())),
            Kind::Settle => settle::read(&settle::path(&directory))
                .and_then(|file| serde_json::to_value(file).map_err(|e| e.to_string())),
        };
        read.map(Some).map_err(damaged)
    }

    /// What the newest measured settle time says against the rig file.
    pub(super) fn settle_warning(&self, inner: &Inner) -> Option<String> {
        let entry = latest(inner, Kind::Settle)?;
        match settle::read(&settle::path(&entry.directory)) {
            Ok(file) => settle::warning(&self.rig, &file, &entry.manifest),
            Err(damaged) => Some(damaged),
        }
    }

    /// Puts the calibration that `request` means into `plan`; its text, for the session's directory.
    pub(super) fn use_calibration(
        &self,
        inner: &Inner,
        request: &StartRequest,
        plan: &mut CapturePlan,
    ) -> Result<Option<String>, PlanError> {
        let refuse = |reason: String| PlanError { reasons: vec![format!("calibration: {reason}")] };
        match request.calibration.as_deref() {
            Some("none") => Ok(None),
            None => match latest(inner, Kind::Rig) {
                None => {
                    if self.rig.calibration.is_some() {
                        let words =
                            "lights and camera are the rig file's: there is no calibration yet (rigd calibrate run)";
                        plan.warnings.push(words.into());
                    }
                    Ok(None)
                }
                Some(entry) => self.put(entry, plan).or_else(|reason| {
                    let id = &entry.manifest.id;
                    plan.warnings
                        .push(format!("lights and camera are the rig file's, not calibration {id}'s: {reason}"));
                    Ok(None)
                }),
            },
            Some("latest") => match latest(inner, Kind::Rig) {
                None => Err(refuse("there is none yet: make one (rigd calibrate run), or do not name one".into())),
                Some(entry) => self.put(entry, plan).map_err(refuse),
            },
            Some(id) => match inner.calibration(id) {
                Ok((_, of)) if of.kind == Kind::Settle => {
                    Err(refuse(format!("{} measured a settle time only: name one of camera and lights", of.id)))
                }
                Ok((entry, of)) if of.state == SessionState::Completed => self.put(entry, plan).map_err(refuse),
                Ok((_, of)) => Err(refuse(format!("{} is {}: name one that is completed", of.id, of.state))),
                Err(error) => Err(refuse(error.to_string())),
            },
        }
    }

    fn put(&self, entry: &Entry, plan: &mut CapturePlan) -> Result<Option<String>, String> {
        let damaged = |reason| {
            let (id, version) = (entry.manifest.id.clone(), entry.manifest.version.unwrap_or_default());
            EngineError::DamagedCalibration { id, version, reason }.to_string()
        };
        let (found, text) = CalibrationFile::read(&file::path(&entry.directory)).map_err(damaged)?;
        let journalled = entry.ledger.progress.as_ref().and_then(|progress| progress.verdicts.last());
        let hash = journalled.and_then(|verdict| verdict.found[FILE_HASH].as_str());
        if hash.is_some_and(|hash| hash != blake3::hash(text.as_bytes()).to_hex().as_str()) {
            let path = file::path(&entry.directory);
            return Err(damaged(format!(
                "{}: it is not what was measured (its hash is not the journal's): put the file back from a copy, or calibrate anew",
                path.display()
            )));
        }
        found.check_rig(&self.rig)?;
        let mut stations = plan.stations.clone();
        for station in &mut stations {
            let lamp = found.lamp(station.angle_deg)?;
            (station.light_position_mm, station.light_intensity) = (lamp.position_mm, Some(lamp.intensity));
        }
        plan.stations = stations;
        plan.warnings.extend(stale::warnings(&self.rig, &found, &entry.manifest));
        plan.estimated_bytes = plan.bytes(&found.applied(&self.rig), true);
        let CalibrationFile { id, version, made, .. } = found;
        plan.calibration = Some(UsedCalibration { id, version, made });
        Ok(Some(text))
    }
}

/// The newest completed calibration of this kind.
fn latest(inner: &Inner, kind: Kind) -> Option<&Entry> {
    let of_kind = |entry: &Entry| entry.work.calibration().is_some_and(|plan| plan.kind() == kind);
    inner.runs.values().rev().find(|entry| of_kind(entry) && entry.state() == SessionState::Completed)
}
