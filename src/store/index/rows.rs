//! What the index says of a run: facts of its manifest, and what its journal adds up to.

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A row of `runs`, but for the run's id.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunRow {
    /// `session`, `calibration`, or `settle`.
    pub kind: String,
    /// Name of the sampled object, or of the calibration.
    pub name: String,
    /// State, as on the wire.
    pub state: String,
    /// Why it stands there, where that needs a reason.
    pub reason: Option<String>,
    /// True when arm or camera is simulated.
    pub simulated: bool,
    /// Start, RFC 3339.
    pub started: String,
    /// End, RFC 3339; null while it runs.
    pub ended: Option<String>,
    /// Name of the rig, by the rig file of the manifest; null where that holds none.
    pub rig: Option<String>,
    /// Id of the calibration that a session uses; null: geometry of the rig file.
    pub calibration: Option<String>,
    /// Number of that calibration; of a calibration its own.
    pub calibration_version: Option<i64>,
    /// Light stations of the plan.
    pub stations: i64,
    /// Frames of the plan, without those that an adaptive session left out.
    pub frames_planned: i64,
    /// Frames that count.
    pub frames_committed: i64,
    /// Records of the journal that are accounted for here.
    pub records: i64,
    /// Hash of the last one's line.
    pub hash: Option<String>,
    /// Why the rest of the journal cannot be trusted; null where it can, or there is none.
    pub fault: Option<String>,
}

/// A row of `frames`, but for the run's id: the fields of a `frame.committed` record.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameRow {
    /// Name in `frames/`.
    pub file: String,
    /// Index of the light station.
    pub station: i64,
    /// Index of the exposure in the bracket.
    pub exposure: i64,
    /// Which shot for this cell of the plan it is, from 1.
    pub attempt: i64,
    /// Which bracket of the run it belongs to, from 1.
    pub bracket: i64,
    /// Where the arm stood by its own status, degrees.
    pub angle_deg: Option<f64>,
    /// Shutter label.
    pub shutter: String,
    /// Time the shutter really was open, seconds.
    pub true_s: f64,
    /// Size, bytes.
    pub bytes: i64,
    /// Hash of the file.
    pub blake3: String,
    /// DateTimeOriginal, as the camera wrote it.
    pub taken: Option<String>,
    /// `committed`, or `superseded`: a later attempt counts, or none.
    pub state: String,
}

/// A row of `fits`, but for the run's id: the fields of a `fit.finished` record without an error.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitRow {
    /// Number of the record.
    pub seq: i64,
    /// When it was written, RFC 3339.
    pub time: String,
    /// BRDF model; null in journals of earlier versions, like the parameters.
    pub model: Option<String>,
    /// Number of materials.
    pub materials: Option<i64>,
    /// Mean of |I - model| / I over the samples in use.
    pub mean_relative_error: Option<f64>,
    /// The same on the lights left out.
    pub left_out_relative_error: Option<f64>,
    /// Iterations of the solver.
    pub iterations: Option<i64>,
    /// Why it ended.
    pub termination: Option<String>,
    /// `materials` of material.json: every parameter with its standard error and how well the data determine it.
    #[serde(default)]
    pub parameters: Value,
}

/// All that the index says of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    /// Its id.
    pub id: String,
    /// The run.
    pub run: RunRow,
    /// Every frame that was ever committed, by name.
    pub frames: Vec<FrameRow>,
    /// Every fit, by the number of its record.
    pub fits: Vec<FitRow>,
}

impl Rows {
    /// A hash over all of it, which lies beside it: a page that rotted, or came back from before, is seen.
    pub(super) fn digest(&self) -> Result<String, serde_json::Error> {
        let mut hasher = blake3::Hasher::new();
        serde_json::to_writer(&mut hasher, &(&self.id, &self.run, &self.frames, &self.fits))?;
        Ok(hasher.finalize().to_hex().to_string())
    }
}
