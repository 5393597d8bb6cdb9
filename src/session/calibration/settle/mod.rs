//! The settle time of the arm: judged when all bursts are in, kept as settle.json, and held against the rig file before a session.

pub mod plan;

use super::measure::{Stop, fail, write};
use super::plan::PlannedStep;
use crate::pipeline::settle::{Photograph, Series, SettleReport, Shots, settle_time};
use crate::session::crop;
use crate::session::ledger::FrameRecord;
use crate::session::processing::{StepJob, read_frame};
use crate::store::files::read_text;
use crate::store::manifest::Manifest;
use rig_config::{Arm, Rig};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Name of the file in the run's `result/`.
const NAME: &str = "settle.json";
/// What must at least be seen, degrees: light positions are known to a millimetre at about 600. A rig that is content with less says so
/// by `arm.tolerance_deg`.
const MUST_SEE_DEG: f64 = 0.1;

/// A measured settle time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SettleFile {
    /// Version of this file's shape.
    pub format: u32,
    /// Id of the run.
    pub id: String,
    /// Its consecutive number.
    pub version: u64,
    /// When it was measured, RFC 3339.
    pub made: String,
    /// Program and version.
    pub software: String,
    /// True when arm or camera is simulated.
    pub simulated: bool,
    /// Shutter label of the frames.
    pub exposure: String,
    /// Arm angle at which they were shot, degrees.
    pub station_deg: f64,
    /// arm.settle_s of the rig file, seconds.
    pub rig_settle_s: f64,
    /// What was measured.
    pub report: SettleReport,
}

/// Where a run keeps it.
pub fn path(directory: &Path) -> PathBuf {
    directory.join("result").join(NAME)
}

/// Reads it.
///
/// # Errors
/// The file cannot be read or is none; the reason names it.
pub fn read(path: &Path) -> Result<SettleFile, String> {
    let refuse = |reason: String| format!("{}: {reason}: measure anew (rigd calibrate settle)", path.display());
    let text = read_text(path, "settle time").map_err(refuse)?;
    let file: SettleFile = serde_json::from_str(&text).map_err(|e| refuse(e.to_string()))?;
    if file.format == 1 { Ok(file) } else { Err(refuse(format!("format {} is not known", file.format))) }
}

/// Judges the bursts and writes settle.json. What they do not show another run may show, after something was changed: this one ends.
pub(super) fn judge(rig: &Rig, job: &StepJob) -> Result<Value, Stop> {
    let step = job.plan.steps.get(job.step).ok_or_else(|| fail("the plan has no such step"))?;
    let series = series(rig, step, &job.frames).ok_or_else(|| fail("the plan has no bursts"))?;
    let record = |name: &str| job.frames.iter().flatten().find(|frame| frame.file == name);
    let load = |name: &str| read_frame(&job.directory, record(name).ok_or("there is no such frame")?);
    let report = settle_time(&series, &load).map_err(|reason| fail(format!("no settle time: {reason}")))?;
    let Manifest { id, version, software, simulated, .. } = job.manifest.clone();
    let file = SettleFile {
        format: 1,
        id,
        version: version.unwrap_or_default(),
        made: jiff::Timestamp::now().to_string(),
        software,
        simulated,
        exposure: step.exposures.first().map(|exposure| exposure.label.clone()).unwrap_or_default(),
        station_deg: series.station_deg,
        rig_settle_s: rig.arm.settle_s,
        report,
    };
    let text = serde_json::to_string_pretty(&file).map_err(fail)?;
    let hash = write(job, NAME, &text)?;
    let SettleReport { settle_s, uncertainty_s, recommended_s, smallest_seen_deg, .. } = file.report;
    Ok(json!({
        "settle_s": settle_s, "uncertainty_s": uncertainty_s, "recommended_s": recommended_s, "rig_settle_s": file.rig_settle_s,
        "smallest_seen_deg": smallest_seen_deg, "warnings": file.report.warnings, "settle_blake3": hash,
    }))
}

/// The bursts of the step: the first beside, the others at the station.
fn series(rig: &Rig, step: &PlannedStep, frames: &[Vec<FrameRecord>]) -> Option<Series> {
    let photograph = |frame: &FrameRecord| Photograph {
        since_rest_s: frame.since_rest_s.unwrap_or_default(),
        name: frame.file.clone(),
    };
    let mut bursts: Vec<Shots> = step
        .approaches
        .iter()
        .zip(frames)
        .map(|(approach, frames)| Shots {
            from_deg: approach.from_deg,
            photographs: frames.iter().map(photograph).collect(),
        })
        .collect();
    let (beside_deg, station_deg) = (*step.stations_deg.first()?, *step.stations_deg.last()?);
    let beside = (bursts.len() > 1).then(|| bursts.remove(0))?;
    Some(Series {
        station_deg,
        beside_deg,
        beside,
        bursts,
        exposure_s: step.exposures.first()?.true_s,
        crop: crop::of_object(rig),
        must_see_deg: MUST_SEE_DEG.max(rig.arm.tolerance_deg),
    })
}

/// What a session on `rig` must be told of a measured settle time: nothing if the rig file waits as long, or if the arm is another one
/// by now.
pub fn warning(rig: &Rig, file: &SettleFile, manifest: &Manifest) -> Option<String> {
    let then = Rig::from_toml(&manifest.rig_file, "the settle time's rig file").ok()?;
    let same_arm = then.arm == Arm { settle_s: then.arm.settle_s, park_deg: then.arm.park_deg, ..rig.arm.clone() };
    let SettleReport { settle_s, recommended_s, .. } = file.report;
    let too_short = rig.arm.settle_s < settle_s;
    (too_short && same_arm && file.simulated == rig.is_simulated()).then(|| {
        format!(
            "arm.settle_s is {} s, but the arm was seen to need {settle_s:.2} s (calibration {} of {}): frames may show it swinging; set arm.settle_s = {recommended_s:.2}, or measure again (rigd calibrate settle)",
            rig.arm.settle_s, file.version, file.made
        )
    })
}
