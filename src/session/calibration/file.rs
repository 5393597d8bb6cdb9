//! calibration.json: what a calibration run measured, and what it means for a rig.

use crate::pipeline::calibration::camera::CameraCalibration;
use crate::pipeline::calibration::lights::LightsCalibration;
use crate::pipeline::calibration::response::ResponseCalibration;
use crate::session::quality::Optics;
use crate::store::files::read_text;
use rig_config::Rig;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Name of the file: in the run's `result/`, and copied into the directory of every session that uses it.
pub const NAME: &str = "calibration.json";
/// Key of its hash (blake3) in what the journal says was found in the last step.
pub const FILE_HASH: &str = "calibration_blake3";

/// Where a run keeps it.
pub fn path(directory: &Path) -> PathBuf {
    directory.join("result").join(NAME)
}

/// A calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationFile {
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
    /// Firmware of the arm.
    pub arm: Option<String>,
    /// Model of the camera.
    pub camera_model: Option<String>,
    /// Body and lens as its frames name them.
    #[serde(default)]
    pub optics: Optics,
    /// Frames it was measured on, by name.
    pub frames: Vec<String>,
    /// Focal length, principal point, distortion.
    pub camera: CameraCalibration,
    /// Response and shutter times.
    pub response: ResponseCalibration,
    /// Light positions and intensities.
    pub lights: LightsCalibration,
    /// What a person should know before using it.
    pub warnings: Vec<String>,
}

/// The lamp at one angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LampThere {
    /// Position, camera frame, mm.
    pub position_mm: [f64; 3],
    /// Radiant intensity per channel, radiance units x mm^2.
    pub intensity: [f64; 3],
}

/// Angles this close are the same station, degrees.
const SAME_ANGLE: f64 = 1e-6;

impl CalibrationFile {
    /// Reads a calibration; its text comes with it.
    ///
    /// # Errors
    /// The file cannot be read or is no calibration; the reason names it.
    pub fn read(path: &Path) -> Result<(Self, String), String> {
        let refuse = |reason: String| {
            format!(
                "{}: {reason}: put the file back from a copy, or calibrate anew (rigd calibrate run)",
                path.display()
            )
        };
        let text = read_text(path, "calibration").map_err(refuse)?;
        let file: Self = serde_json::from_str(&text).map_err(|e| refuse(e.to_string()))?;
        if file.format != 1 {
            return Err(refuse(format!("format {} is not known", file.format)));
        }
        file.response.response().map_err(refuse)?;
        Ok((file, text))
    }

    /// The calibration that the session in `directory` uses: its own copy; none where it uses the rig file.
    ///
    /// # Errors
    /// The copy cannot be read.
    pub fn of_session(directory: &Path) -> Result<Option<Self>, String> {
        let path = directory.join(NAME);
        if !path.exists() {
            return Ok(None);
        }
        Self::read(&path).map(|(file, _)| Some(file))
    }

    /// Refuses a rig that this calibration cannot be of: a real one where this one is of a simulated stage, or the other way round;
    /// one whose frames have another size.
    ///
    /// # Errors
    /// Says what both are.
    pub fn check_rig(&self, rig: &Rig) -> Result<(), String> {
        if self.simulated != rig.is_simulated() {
            let kind = |simulated| if simulated { "a simulated" } else { "a real" };
            let (then, now) = (kind(self.simulated), kind(rig.is_simulated()));
            return Err(format!("calibration {} is of {then} rig, this is {now} one: calibrate anew", self.version));
        }
        let (then, now) = ((self.camera.width, self.camera.height), (rig.camera.width, rig.camera.height));
        if then == now {
            return Ok(());
        }
        let ((w, h), (rig_w, rig_h)) = (then, now);
        Err(format!(
            "calibration {} is of frames of {w} x {h} pixels, the rig file says {rig_w} x {rig_h}: calibrate anew",
            self.version
        ))
    }

    /// The lamp with the arm at `angle_deg`: where it was measured there, else on the arm's circle.
    ///
    /// # Errors
    /// The angle was not measured and there is no circle, or nothing tells the lamp's intensity.
    pub fn lamp(&self, angle_deg: f64) -> Result<LampThere, String> {
        let lights = &self.lights;
        let measured = lights.lights.iter().find(|l| l.angle_deg.is_some_and(|a| (a - angle_deg).abs() < SAME_ANGLE));
        let position_mm = measured
            .map(|light| light.position_mm)
            .or_else(|| Some(lights.circle.as_ref()?.position_mm(angle_deg)))
            .ok_or_else(|| {
                format!(
                    "calibration {} has no light at {angle_deg} degrees and no circle of the arm: take its stations, or calibrate with three \
                     or more",
                    self.version
                )
            })?;
        let intensity = measured
            .and_then(|light| light.intensity)
            .or(lights.bulb_intensity)
            .ok_or_else(|| format!("calibration {} has no intensity of the lamp: calibrate anew", self.version))?;
        Ok(LampThere { position_mm, intensity })
    }

    /// Its name in datasets and reports.
    pub fn title(&self) -> String {
        format!("calibration {} of {} ({})", self.version, self.made, self.id)
    }

    /// The rig with the measured camera in place of the rig file's.
    pub fn applied(&self, rig: &Rig) -> Rig {
        let mut rig = rig.clone();
        rig.camera.focal_px = self.camera.focal_px;
        rig.camera.principal_px = self.camera.principal_px;
        rig.camera.distortion = self.camera.distortion;
        rig
    }
}
