//! The brackets of a calibration run: their response, and their radiance on disk.

use crate::numerics::image::RadianceImage;
use crate::numerics::radiometry::noise::SensorNoise;
use crate::pipeline::calibration::response::{Method, ResponseCalibration, calibrate};
use crate::pipeline::develop::{BracketFrame, Known, develop, read_bracket};
use crate::session::processing::{StepJob, read_frame, write_radiance};
use crate::store::exr::read_radiance;
use rig_config::Rig;
use std::ops::Range;

/// Why brackets give no radiance.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RadianceError {
    /// The frames do not serve.
    #[error("{0}")]
    Frames(String),
    /// They cannot be read or written.
    #[error("{0}")]
    Disk(String),
}

/// A station's place on disk.
pub struct Station;

impl Station {
    /// Its radiance, below the run's directory.
    pub fn file(station: usize) -> String {
        format!("radiance/{station:03}.exr")
    }
}

/// The stations of a run.
pub struct Stations<'a> {
    job: &'a StepJob,
    rig: &'a Rig,
}

impl<'a> Stations<'a> {
    /// Those shot up to the step of `job`.
    pub fn of(job: &'a StepJob, rig: &'a Rig) -> Self {
        Self { job, rig }
    }

    /// The response measured on the one of the stations whose bracket tells most: the one with most pixels exposed in two frames.
    pub fn best_response(&self, stations: Range<usize>) -> Result<ResponseCalibration, RadianceError> {
        let (mut best, mut refused) = (None::<(usize, ResponseCalibration)>, None);
        for station in stations {
            match self.response(station)? {
                Ok(found) => {
                    let overlap = found.exposures.iter().map(|time| time.overlap_pixels).sum();
                    if best.as_ref().is_none_or(|(most, _)| overlap > *most) {
                        best = Some((overlap, found));
                    }
                }
                Err(reason) => refused = Some(reason),
            }
        }
        let nothing = || RadianceError::Frames(refused.unwrap_or_else(|| "no bracket was shot".into()));
        best.map(|(_, response)| response).ok_or_else(nothing)
    }

    /// The response one bracket tells, or why it tells none: a lamp behind the object leaves it dark.
    fn response(&self, station: usize) -> Result<Result<ResponseCalibration, String>, RadianceError> {
        let files = self.files(station)?;
        let frames: Vec<_> = files.iter().map(Shot::frame).collect();
        let bracket = read_bracket(&frames, None).map_err(|e| RadianceError::Frames(e.to_string()))?;
        Ok(calibrate(bracket, Method::Debevec).map(|found| found.calibration).map_err(|e| e.to_string()))
    }

    /// Develops whole frames with this response; their radiance goes to disk.
    pub fn develop(&self, stations: Range<usize>, response: &ResponseCalibration) -> Result<(), RadianceError> {
        let camera = &self.rig.camera;
        let noise = SensorNoise { full_well_e: camera.full_well_e, read_noise_e: camera.read_noise_e };
        for station in stations {
            let files = self.files(station)?;
            let frames: Vec<_> = files.iter().map(Shot::frame).collect();
            let expected: Vec<f64> = files.iter().map(|shot| shot.time_s).collect();
            let known = Known::of(response, &expected).map_err(RadianceError::Frames)?;
            let developed =
                develop(&frames, None, Some(&known), &noise).map_err(|e| RadianceError::Frames(e.to_string()))?;
            let attributes = [("rigd.session", self.job.manifest.id.clone()), ("rigd.station", station.to_string())];
            write_radiance(
                &self.job.directory.join(Station::file(station)),
                &developed.image,
                (0, 0),
                camera,
                &attributes,
            )
            .map_err(RadianceError::Disk)?;
        }
        Ok(())
    }

    /// Radiance by the name of [`Station::file`].
    pub fn radiance(&self, name: &str) -> Result<RadianceImage, String> {
        let size = (self.rig.camera.width, self.rig.camera.height);
        read_radiance(&self.job.directory.join(name), size).map_err(|e| e.reason)
    }

    fn files(&self, station: usize) -> Result<Vec<Shot<'_>>, RadianceError> {
        let frames = self.job.frames.get(station).map_or(&[][..], Vec::as_slice);
        let read = |frame: &'a crate::session::ledger::FrameRecord| {
            let bytes = read_frame(&self.job.directory, frame).map_err(RadianceError::Disk)?;
            Ok(Shot { name: &frame.file, bytes, time_s: frame.true_s })
        };
        frames.iter().map(read).collect()
    }
}

/// A frame in memory.
struct Shot<'a> {
    name: &'a str,
    bytes: Vec<u8>,
    time_s: f64,
}

impl Shot<'_> {
    fn frame(&self) -> BracketFrame<'_> {
        BracketFrame { name: self.name, bytes: &self.bytes, time_s: self.time_s }
    }
}
