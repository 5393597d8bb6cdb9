//! What a session's journal adds up to. The same fold serves the running session and the ones found on disk.

use super::adaptive::Decisions;
use super::budget::TimeBudget;
use super::calibration::progress::Progress;
use super::calibration::step::Step;
use super::handle::SessionSnapshot;
use super::lamp::drift::{Drift, PatchReading};
use super::plan::PlannedExposure;
use super::state::SessionState;
use super::work::Work;
use crate::store::manifest::Manifest;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// A committed frame: the fields of its `frame.committed` record.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameRecord {
    /// Index of the light station.
    pub station: usize,
    /// Index of the exposure in the bracket.
    pub exposure: usize,
    /// Which shot for this cell of the plan it is, from 1.
    pub attempt: usize,
    /// Which bracket of the session it belongs to, from 1; a bracket shot again replaces the station's frames.
    pub bracket: usize,
    /// File name in `frames/`.
    pub file: String,
    /// Size, bytes.
    pub bytes: u64,
    /// Hash of the file.
    pub blake3: String,
    /// Shutter label.
    pub shutter: String,
    /// Time the shutter really was open, seconds.
    pub true_s: f64,
    /// Where the arm stood by its own status, degrees.
    pub angle_deg: Option<f64>,
    /// When it was asked for and when its file was there, seconds after the arm reported rest; null in journals of earlier versions.
    #[serde(default)]
    pub since_rest_s: Option<[f64; 2]>,
    /// DateTimeOriginal of the frame, as the camera wrote it.
    pub taken: Option<String>,
}

/// The state of a session as its journal tells it.
#[derive(Clone, Debug)]
pub struct Ledger {
    /// For everyone to see; `remaining_s` is filled by who knows the pace.
    pub snapshot: SessionSnapshot,
    /// The steps of a calibration run; a session has none.
    pub progress: Option<Progress>,
    /// Exposures by station.
    exposures: Vec<usize>,
    decisions: Decisions,
    /// The bracket of an adaptive session.
    adaptive: Option<Vec<PlannedExposure>>,
    frames: BTreeMap<(usize, usize), FrameRecord>,
    superseded: Vec<FrameRecord>,
    developed: BTreeSet<usize>,
    drift: Drift,
    /// It was told that the reference patch is not what it was.
    doubts_patch: bool,
    /// A fit described the session, and it was not taken up since.
    described: bool,
    /// How often the lamp was lit anew, now and when each station was shot.
    lighting: usize,
    lit: BTreeMap<usize, usize>,
    /// Take-ups since a frame was last committed.
    taken_up: usize,
    resumes: bool,
}

/// How many parameters of a fit's materials are not called identified.
fn weak(parameters: &Value) -> usize {
    match parameters {
        Value::Array(list) => list.iter().map(weak).sum(),
        Value::Object(fields) => match fields.get("identified") {
            Some(identified) => usize::from(identified != "identified"),
            None => fields.values().map(weak).sum(),
        },
        _ => 0,
    }
}

impl Ledger {
    /// A run of which nothing is journalled yet.
    pub fn new(manifest: &Manifest, work: &Work) -> Self {
        let exposures: Vec<usize> = (0..work.stations()).map(|station| work.exposures(station).len()).collect();
        let snapshot = SessionSnapshot {
            id: manifest.id.clone(),
            name: manifest.name.clone(),
            state: SessionState::Preflight,
            reason: None,
            simulated: manifest.simulated,
            started: manifest.started.clone(),
            ended: None,
            stations: exposures.len(),
            exposures: exposures.iter().copied().max().unwrap_or(0),
            station: 0,
            frames_committed: 0,
            frames_planned: work.frames(),
            saved: None,
            stations_developed: 0,
            remaining_s: None,
            calibration: work.capture().and_then(|plan| plan.calibration.clone()),
            warnings: work.capture().map(|plan| plan.warnings.clone()).unwrap_or_default(),
            refused: 0,
            last_refusal: None,
            interruptions: 0,
            mean_relative_error: None,
            weak_parameters: 0,
            time_budget: None,
            lamp_drift: None,
            last_seq: 0,
        };
        let first =
            |plan: &super::calibration::plan::CalibrationPlan| plan.steps.first().map_or(Step::Done, |s| s.step);
        let progress = work.calibration().map(|plan| Progress::new(first(plan)));
        let adaptive = work.capture().filter(|plan| plan.adaptive.is_some()).map(|plan| plan.exposures.clone());
        let (frames, superseded, developed) = (BTreeMap::new(), Vec::new(), BTreeSet::new());
        let decisions = Decisions::default();
        Self {
            snapshot,
            progress,
            exposures,
            decisions,
            adaptive,
            frames,
            superseded,
            developed,
            drift: Drift::default(),
            doubts_patch: false,
            described: false,
            lighting: 0,
            lit: BTreeMap::new(),
            taken_up: 0,
            resumes: false,
        }
    }

    /// Takes one journal record into account; unknown types and fields are passed over.
    pub fn apply(&mut self, record: &Value) {
        let station = || record["station"].as_u64().and_then(|s| usize::try_from(s).ok());
        if let Some(progress) = &mut self.progress {
            progress.apply(record);
        }
        self.snapshot.last_seq = record["seq"].as_u64().unwrap_or(self.snapshot.last_seq);
        match record["type"].as_str() {
            Some("session.state") => self.apply_state(record),
            Some("arm.moved") => self.snapshot.station = station().unwrap_or(self.snapshot.station),
            Some("frame.committed") => {
                if let Ok(frame) = FrameRecord::deserialize(record) {
                    self.apply_frame(frame);
                }
            }
            Some("station.developed") => {
                self.developed.extend(station());
                self.snapshot.stations_developed = self.developed.len();
                self.apply_patch(station(), PatchReading::deserialize(&record["patch"]).ok());
            }
            Some("calibration.doubted" | "session.doubted" | "lamp.unsteady" | "ambient.measured") => self.warn(record),
            Some("patch.doubted") => {
                self.doubts_patch = true;
                self.warn(record);
            }
            Some(kind @ ("frame.rejected" | "bracket.rejected")) => self.apply_refusal(kind, record),
            // An arm that was brought back lit the lamp anew.
            Some("fault.cleared") => self.lighting += usize::from(record["device"] == "arm"),
            Some("frame.lost") => self.lose_frame(record),
            Some("exposures.enough" | "lights.judged") => {
                self.decisions.apply(record);
                self.count_saved();
            }
            Some("time.budget") => self.snapshot.time_budget = TimeBudget::deserialize(record).ok(),
            Some("fit.finished") => {
                self.described |= record["error"].is_null();
                if let Some(error) = record["mean_relative_error"].as_f64() {
                    self.snapshot.mean_relative_error = Some(error);
                    self.snapshot.weak_parameters = weak(&record["parameters"]);
                }
            }
            _ => {}
        }
    }

    /// A session that was taken up again is told the same once more: it counts once.
    fn warn(&mut self, record: &Value) {
        let warnings = record["warnings"].as_array().into_iter().flatten().filter_map(Value::as_str);
        for warning in warnings {
            if !self.snapshot.warnings.iter().any(|known| known == warning) {
                self.snapshot.warnings.push(warning.to_owned());
            }
        }
    }

    /// What the reference patch says by now takes the place of what it said before.
    fn apply_patch(&mut self, station: Option<usize>, reading: Option<PatchReading>) {
        let (Some(station), said) = (station, self.drift.warnings()) else { return };
        self.drift.take(station, reading, self.lit.get(&station).copied().unwrap_or_default());
        self.snapshot.lamp_drift = self.drift.summary();
        self.snapshot.warnings.retain(|warning| !said.contains(warning));
        self.snapshot.warnings.extend(self.drift.warnings());
    }

    /// How bright the lamp was at the first stations, relative to the very first, by the reference patch.
    pub fn brightness(&self, stations: usize) -> Vec<[f64; 3]> {
        self.drift.of_stations(stations)
    }

    /// True when dataset.toml says what is so: a fit after the session went on must describe it anew.
    pub fn is_described(&self) -> bool {
        self.described
    }

    /// What to know before trusting a fit.
    pub fn warnings(&self) -> Vec<String> {
        self.snapshot.warnings.iter().cloned().chain(self.drift.untold()).collect()
    }

    fn apply_refusal(&mut self, kind: &str, record: &Value) {
        self.snapshot.refused += 1;
        let what = if kind == "bracket.rejected" { "bracket" } else { "frame" };
        if record["whole"] == true
            && let Some(station) = record["station"].as_u64().and_then(|s| usize::try_from(s).ok())
        {
            self.refuse_bracket(station);
        }
        let reason = record["reason"].as_str().unwrap_or_default();
        self.snapshot.last_refusal = Some(format!("station {}: {what} refused: {reason}", record["station"]));
    }

    /// None of its frames counts, though they are all there.
    fn refuse_bracket(&mut self, station: usize) {
        let cells: Vec<_> = self.frames.range((station, 0)..=(station, usize::MAX)).map(|(&cell, _)| cell).collect();
        self.superseded.extend(cells.iter().filter_map(|cell| self.frames.remove(cell)));
        self.snapshot.frames_committed = self.frames.len();
        self.outdate(station);
    }

    fn apply_state(&mut self, record: &Value) {
        if let Ok(state) = SessionState::deserialize(&record["state"]) {
            if state == SessionState::Preflight && self.snapshot.state == SessionState::Interrupted {
                self.taken_up += 1;
                self.snapshot.interruptions += 1;
                self.lighting += 1;
                self.described = false;
                self.snapshot.ended = None;
            }
            self.resumes = record["resumes"] == true;
            self.snapshot.state = state;
            self.snapshot.reason = record["reason"].as_str().map(str::to_owned);
            if state.is_final() {
                self.snapshot.ended = record["time"].as_str().map(str::to_owned);
            }
        }
    }

    fn apply_frame(&mut self, frame: FrameRecord) {
        self.taken_up = 0;
        let station = frame.station;
        self.lit.insert(station, self.lighting);
        let old: Vec<_> = self.frames.range((station, 0)..=(station, usize::MAX)).map(|(&cell, _)| cell).collect();
        for cell in old {
            let replaced = self.frames.get(&cell).is_some_and(|f| f.bracket != frame.bracket);
            if replaced || cell.1 == frame.exposure {
                self.superseded.extend(self.frames.remove(&cell));
            }
        }
        self.decisions.begin(station, frame.bracket);
        self.frames.insert((station, frame.exposure), frame);
        self.snapshot.frames_committed = self.frames.len();
        self.outdate(station);
        self.count_saved();
    }

    /// Radiance of frames that no longer count does not count; all stations are developed through the response of the first.
    fn outdate(&mut self, station: usize) {
        self.developed.retain(|&developed| station > 0 && developed != station);
        self.snapshot.stations_developed = self.developed.len();
    }

    /// What an adaptive session leaves out is not to come.
    fn count_saved(&mut self) {
        let Some(exposures) = &self.adaptive else { return };
        let saved = self.decisions.saved(self.exposures.len(), exposures);
        self.snapshot.frames_planned = self.exposures.iter().sum::<usize>() - saved.exposures;
        self.snapshot.saved = Some(saved);
    }

    /// A committed frame whose file is no longer what it was does not count.
    fn lose_frame(&mut self, record: &Value) {
        let lost: Vec<_> =
            self.frames.iter().filter(|(_, f)| record["file"] == f.file).map(|(&cell, _)| cell).collect();
        for cell in lost {
            self.superseded.extend(self.frames.remove(&cell));
            self.outdate(cell.0);
        }
        self.snapshot.frames_committed = self.frames.len();
    }

    /// True when it was told that the reference patch is not what it was.
    pub fn doubts_patch(&self) -> bool {
        self.doubts_patch
    }

    /// How often the session was taken up again since a frame was last committed.
    pub fn taken_up(&self) -> usize {
        self.taken_up
    }

    /// True when the daemon's end interrupted it and it goes on at the next start.
    pub fn resumes(&self) -> bool {
        self.resumes
    }

    /// The last attempt of every cell that was ever committed, and the last bracket.
    pub fn attempts(&self) -> (BTreeMap<(usize, usize), usize>, usize) {
        let (mut attempts, mut bracket) = (BTreeMap::new(), 0);
        for frame in self.every_frame() {
            let last = attempts.entry((frame.station, frame.exposure)).or_insert(0);
            *last = frame.attempt.max(*last);
            bracket = frame.bracket.max(bracket);
        }
        (attempts, bracket)
    }

    /// True when the journal knows this file of `frames/`.
    pub fn has_file(&self, name: &str) -> bool {
        self.every_frame().any(|frame| frame.file == name)
    }

    /// The frame of a cell of the plan that counts.
    pub fn frame(&self, station: usize, exposure: usize) -> Option<&FrameRecord> {
        self.frames.get(&(station, exposure))
    }

    /// The frames that count, by station and exposure.
    pub fn frames(&self) -> impl Iterator<Item = &FrameRecord> {
        self.frames.values()
    }

    /// Every frame that was ever committed.
    pub fn every_frame(&self) -> impl Iterator<Item = &FrameRecord> {
        self.frames.values().chain(&self.superseded)
    }

    /// Stations of the plan that are to be shot: all, unless fewer were found to suffice.
    pub fn stations(&self) -> usize {
        self.decisions.stations(self.exposures.len())
    }

    /// True when this exposure of the plan was found to be dispensable.
    pub fn left_out(&self, station: usize, exposure: usize) -> bool {
        self.decisions.left_out(self.exposures.len(), station, exposure)
    }

    /// The bracket of a station in the order of the plan, if every exposure of it is there that was not left out.
    pub fn bracket(&self, station: usize) -> Option<Vec<FrameRecord>> {
        let frames: Vec<_> =
            self.frames.range((station, 0)..=(station, usize::MAX)).map(|(_, frame)| frame.clone()).collect();
        let whole = match self.decisions.exposures(station) {
            Some(shot) => frames.len() == shot.len() && frames.iter().all(|frame| shot.contains(&frame.exposure)),
            None => Some(&frames.len()) == self.exposures.get(station),
        };
        whole.then_some(frames)
    }

    /// True when the station's radiance is on disk.
    pub fn is_developed(&self, station: usize) -> bool {
        self.developed.contains(&station)
    }

    /// Every frame ever committed, by station, exposure and attempt, each with its state: `committed`, or `superseded`.
    pub fn labelled(&self) -> Vec<(&FrameRecord, &'static str)> {
        let mut list: Vec<_> = self.frames.values().map(|frame| (frame, "committed")).collect();
        list.extend(self.superseded.iter().map(|frame| (frame, "superseded")));
        list.sort_by_key(|(frame, _)| (frame.station, frame.exposure, frame.attempt));
        list
    }

    /// The same as JSON, the state in the field `state`.
    pub fn frame_list(&self) -> Vec<Value> {
        let json = |(frame, state): (&FrameRecord, &str)| {
            let mut value = serde_json::to_value(frame).unwrap_or_default();
            value["state"] = json!(state);
            value
        };
        self.labelled().into_iter().map(json).collect()
    }
}
