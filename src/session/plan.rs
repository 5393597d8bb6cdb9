//! A capture plan: pure data, checked whole before anything moves.

pub use super::adaptive::{Adaptive, LightTargets};
use super::adaptive::{FIRST_JUDGED, object, spread};
use super::order;
use rig_config::{Rig, Shutter};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What `POST /v1/sessions` may say; everything left out comes from the rig file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StartRequest {
    /// A name for the sampled object, for people; at most 200 characters.
    pub name: Option<String>,
    /// Light stations: arm angles, degrees, in shooting order, also where the rig file's own would be shot in another (`reference_patch`).
    pub stations_deg: Option<Vec<f64>>,
    /// The bracket as shutter labels (`1/100`, `0.4`, `15`), in shooting order.
    pub exposures: Option<Vec<String>>,
    /// The calibration to use: an id, `latest`, or `none` for the rig file's geometry. Left out: the latest that fits, else the rig file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<String>,
    /// What the session may leave out of its plan; nothing if left out.
    #[serde(deserialize_with = "object", skip_serializing_if = "Option::is_none")]
    pub adaptive: Option<Adaptive>,
}

/// One light station of the plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Station {
    /// Arm angle, degrees.
    pub angle_deg: f64,
    /// Light position there, camera frame, mm.
    pub light_position_mm: [f64; 3],
    /// Radiant intensity per channel, radiance units x mm^2; null in plans of earlier versions: the rig file's.
    #[serde(default)]
    pub light_intensity: Option<[f64; 3]>,
}

/// The calibration that a plan uses.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct UsedCalibration {
    /// Its id.
    pub id: String,
    /// Its number.
    pub version: u64,
    /// When it was made, RFC 3339.
    pub made: String,
}

/// One exposure of the bracket.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlannedExposure {
    /// Shutter label as set on the body.
    pub label: String,
    /// Time the shutter really opens, seconds.
    pub true_s: f64,
}

/// A checked plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CapturePlan {
    /// Name of the sampled object.
    pub name: String,
    /// Where the light goes, in shooting order: indices of stations count in this list.
    pub stations: Vec<Station>,
    /// The bracket shot at each.
    pub exposures: Vec<PlannedExposure>,
    /// Frames in all.
    pub frames: usize,
    /// Estimated duration, seconds: motion, settling, exposures, download.
    pub estimated_s: f64,
    /// Estimated disk space, bytes.
    pub estimated_bytes: u64,
    /// Where lights and camera come from; null: from the rig file.
    #[serde(default)]
    pub calibration: Option<UsedCalibration>,
    /// What to know before shooting: a stale calibration, for instance.
    #[serde(default)]
    pub warnings: Vec<String>,
    /// What may be left out of it; figures above are of all of it. Absent where nothing may.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub adaptive: Option<Adaptive>,
}

/// Why a request is no plan: one entry a mistake.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{}", .reasons.join("; "))]
pub struct PlanError {
    /// What is wrong, where, and what to do.
    pub reasons: Vec<String>,
}

/// Most stations a plan may have: frame names hold three digits.
pub const MAX_STATIONS: usize = 1000;
/// Fewest exposures of a bracket that the pipeline can develop.
pub const LEAST_EXPOSURES: usize = crate::numerics::radiometry::response::MIN_FRAMES;
/// Most exposures a bracket may have: frame names hold two digits.
pub const MAX_EXPOSURES: usize = 100;
/// Longest name, characters.
pub const MAX_NAME: usize = 200;
/// Download and bookkeeping of a frame, seconds: a guess, replaced by the measured pace once frames come in.
const DOWNLOAD_S: f64 = 1.5;
/// Bytes of a frame for each pixel: fine JPEGs take about half of it.
pub(super) const FRAME_BYTES_PER_PIXEL: u64 = 1;
/// Bytes of a developed pixel: radiance and variance of three channels and validity, 32-bit.
pub(super) const RADIANCE_BYTES_PER_PIXEL: u64 = 28;
/// Bytes of a result for each pixel of the full frame: weights and their errors of up to three materials, residual, 32-bit, and
/// two small pictures.
const RESULT_BYTES_PER_PIXEL: u64 = 40;
/// Journal, manifest and reports beside the images, bytes.
pub(super) const RECORDS_BYTES: u64 = 1 << 20;

impl CapturePlan {
    /// Checks `request` against the rig; lists every mistake at once.
    pub fn new(rig: &Rig, request: &StartRequest) -> Result<Self, PlanError> {
        let mut reasons = Vec::new();
        let name = request.name.clone().unwrap_or_else(|| rig.name.clone());
        check_name(&name, &mut reasons);
        let angles = request.stations_deg.clone().unwrap_or_else(|| rig.plan.stations_deg.clone());
        check_stations(&angles, rig, &mut reasons);
        let shutters = match &request.exposures {
            Some(labels) => read_labels(labels, &mut reasons),
            None => rig.plan.exposures.clone(),
        };
        check_bracket(&shutters, &mut reasons);
        let lights = request.adaptive.as_ref().inspect(|adaptive| adaptive.check(&mut reasons)).and_then(|a| a.lights);
        if !reasons.is_empty() {
            return Err(PlanError { reasons });
        }
        let angles = match &request.stations_deg {
            _ if lights.is_some() => spread(&angles),
            Some(asked) => asked.clone(),
            None => order::of_rig(rig),
        };
        let station = |&angle_deg: &f64| Station {
            angle_deg,
            light_position_mm: rig.lamp.position_mm(angle_deg),
            light_intensity: Some(rig.lamp.intensity),
        };
        let mut plan = Self {
            name,
            stations: angles.iter().map(station).collect(),
            exposures: shutters.iter().map(PlannedExposure::from).collect(),
            frames: angles.len() * shutters.len(),
            estimated_s: 0.0,
            estimated_bytes: 0,
            calibration: None,
            warnings: Vec::new(),
            adaptive: request.adaptive.clone(),
        };
        if lights.is_some() && angles.len() <= FIRST_JUDGED {
            plan.warnings.push(format!(
                "adaptive.lights: {} stations are shot in any case, more than {FIRST_JUDGED} are needed to leave one out",
                angles.len()
            ));
        }
        let mut tally = Tally::new(rig);
        plan.stations.iter().for_each(|station| tally.station(station.angle_deg, &plan.exposures));
        // One frame before the lamp is lit shows the room.
        let room_s = plan.exposures.iter().map(PlannedExposure::seconds).fold(0.0, f64::max);
        plan.estimated_s = room_s + rig.lamp.steady_s + tally.seconds();
        plan.estimated_bytes = plan.bytes(rig, false);
        Ok(plan)
    }

    /// Estimated disk space, bytes; `calibrated`: the sample is yet to be found in the frames.
    pub fn bytes(&self, rig: &Rig, calibrated: bool) -> u64 {
        frames_bytes(rig, self.frames, 0, 0) + processing_bytes(rig, self.stations.len(), calibrated)
    }
}

impl PlannedExposure {
    /// Time it takes with download, seconds.
    pub fn seconds(&self) -> f64 {
        self.true_s + DOWNLOAD_S
    }
}

/// Adds up what a run takes: soak, every move with its settling, every frame, and the way back to the park position.
pub(super) struct Tally<'a> {
    rig: &'a Rig,
    seconds: f64,
    at_deg: f64,
}

impl<'a> Tally<'a> {
    pub fn new(rig: &'a Rig) -> Self {
        Self { rig, seconds: rig.lamp.soak_s, at_deg: rig.arm.park_deg }
    }

    /// A bracket at `angle_deg`.
    pub fn station(&mut self, angle_deg: f64, exposures: &[PlannedExposure]) {
        self.travel(angle_deg);
        self.seconds += self.rig.arm.settle_s + exposures.iter().map(PlannedExposure::seconds).sum::<f64>();
    }

    /// A wait at `angle_deg`.
    pub fn wait(&mut self, angle_deg: f64, seconds: f64) {
        self.travel(angle_deg);
        self.seconds += seconds;
    }

    /// All of it, seconds.
    pub fn seconds(mut self) -> f64 {
        self.travel(self.rig.arm.park_deg);
        self.seconds
    }

    fn travel(&mut self, angle_deg: f64) {
        let arm = &self.rig.arm;
        self.seconds += move_s(angle_deg - self.at_deg, arm.speed_deg_s, arm.acceleration_deg_s2);
        self.at_deg = angle_deg;
    }
}

/// Disk space of `frames` frames and of `developed` stations developed to `pixels` pixels, bytes.
pub(super) fn frames_bytes(rig: &Rig, frames: usize, developed: usize, pixels: u64) -> u64 {
    let shot = frames as u64 * frame_pixels(rig) * FRAME_BYTES_PER_PIXEL;
    shot + developed as u64 * pixels * RADIANCE_BYTES_PER_PIXEL
}

/// Disk space that developing `stations` stations and a fit need, bytes; `calibrated` as in [`CapturePlan::bytes`].
pub fn processing_bytes(rig: &Rig, stations: usize, calibrated: bool) -> u64 {
    let pixels = frame_pixels(rig);
    let developed = super::crop::of_session(rig, calibrated).map_or(pixels, |c| c.width as u64 * c.height as u64);
    stations as u64 * developed * RADIANCE_BYTES_PER_PIXEL + pixels * RESULT_BYTES_PER_PIXEL + RECORDS_BYTES
}

pub(super) fn frame_pixels(rig: &Rig) -> u64 {
    rig.camera.width as u64 * rig.camera.height as u64
}

/// Time of a move with constant acceleration up to a greatest speed, seconds.
fn move_s(angle_deg: f64, speed_deg_s: f64, acceleration_deg_s2: f64) -> f64 {
    let angle = angle_deg.abs();
    let ramps = speed_deg_s * speed_deg_s / acceleration_deg_s2;
    if angle < ramps { 2.0 * (angle / acceleration_deg_s2).sqrt() } else { (angle + ramps) / speed_deg_s }
}

pub(super) fn check_name(name: &str, reasons: &mut Vec<String>) {
    if name.trim().is_empty() {
        reasons.push("name: it is empty: give a name or leave the key out".into());
    }
    let length = name.chars().count();
    if length > MAX_NAME {
        reasons.push(format!("name: {length} characters, at most {MAX_NAME}: shorten it"));
    }
    if name.chars().any(char::is_control) {
        reasons.push("name: it holds a control character: remove it".into());
    }
}

fn check_stations(angles: &[f64], rig: &Rig, reasons: &mut Vec<String>) {
    if angles.is_empty() || angles.len() > MAX_STATIONS {
        reasons.push(format!("stations_deg: {} stations, from 1 to {MAX_STATIONS} are possible", angles.len()));
        return;
    }
    let [low, high] = rig.arm.travel_deg;
    for (i, &angle) in angles.iter().enumerate() {
        if !(low..=high).contains(&angle) {
            reasons.push(format!("stations_deg[{i}]: {angle} is outside the arm's travel of {low} to {high} degrees"));
        } else if let Some(j) = angles.iter().take(i).position(|&a| (a - angle).abs() <= rig.arm.tolerance_deg) {
            reasons.push(format!("stations_deg[{i}]: {angle} repeats stations_deg[{j}]: remove one"));
        }
    }
}

fn read_labels(labels: &[String], reasons: &mut Vec<String>) -> Vec<Shutter> {
    let mut shutters = Vec::new();
    for (i, label) in labels.iter().enumerate() {
        match Shutter::from_label(label) {
            Ok(shutter) => shutters.push(shutter),
            Err(error) => reasons.push(format!("exposures[{i}]: {error}")),
        }
    }
    shutters
}

fn check_bracket(shutters: &[Shutter], reasons: &mut Vec<String>) {
    if shutters.is_empty() && reasons.iter().all(|r| !r.starts_with("exposures")) || shutters.len() > MAX_EXPOSURES {
        reasons.push(format!("exposures: {} exposures, from 1 to {MAX_EXPOSURES} are possible", shutters.len()));
        return;
    }
    for (i, shutter) in shutters.iter().enumerate() {
        if let Some(earlier) = shutters.iter().take(i).find(|s| third_stop(s.true_s) == third_stop(shutter.true_s)) {
            reasons.push(format!("exposures: {} repeats {}: remove one", shutter.label, earlier.label));
        }
    }
}

/// Index k of the third stop nearest to `seconds`: the true time is 2^(k/3) s. Times are compared by it, because bodies and
/// EXIF round them differently (15 and 16 s are the same shutter speed).
pub fn third_stop(seconds: f64) -> i64 {
    (3.0 * seconds.log2()).round() as i64
}
