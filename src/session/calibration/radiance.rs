//! The brackets of a calibration run: their response, the exposures that show balls, and radiance on disk.

use super::plan;
use crate::numerics::calibration::lights::highlight::Spots;
use crate::numerics::image::RadianceImage;
use crate::numerics::radiometry::noise::SensorNoise;
use crate::numerics::radiometry::response::Response;
use crate::pipeline::calibration::lights::LightFrames;
use crate::pipeline::calibration::lights::frames::through_response;
use crate::pipeline::calibration::response::{Method, ResponseCalibration, calibrate};
use crate::pipeline::decode::decode;
use crate::pipeline::develop::{BracketFrame, Known, develop, read_bracket};
use crate::session::ledger::FrameRecord;
use crate::session::plan::LEAST_EXPOSURES;
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

/// The exposure for outlines is the longest with no larger a share of clipped pixels: those of highlights.
const MOST_CLIPPED: f64 = 0.002;

/// Where a station's radiance is, below the run's directory.
pub fn file(station: usize) -> String {
    format!("radiance/{station:03}.exr")
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

    /// The response measured at the most frontal of the stations, by the rig file's rough geometry: there the bracket shows most of what
    /// stands there, from bright to dark.
    pub fn response(&self, stations: Range<usize>) -> Result<ResponseCalibration, RadianceError> {
        let frontal = |station: &usize| plan::frontality(self.rig, self.angle_deg(*station));
        let station = stations.max_by(|a, b| frontal(a).total_cmp(&frontal(b)));
        let station = station.ok_or_else(|| RadianceError::Frames("no bracket was shot".into()))?;
        let files = self.files(station)?;
        let unusable = |reason: String| RadianceError::Frames(format!("no response at station {station}: {reason}"));
        let frames = lit(&files).map_err(unusable)?;
        let bracket = read_bracket(&frames, None).map_err(|e| unusable(e.to_string()))?;
        calibrate(bracket, Method::Debevec).map(|found| found.calibration).map_err(|e| unusable(e.to_string()))
    }

    /// The exposures that show balls best: one for their outlines, one for their highlights.
    pub fn of_balls(&self, station: usize, response: &Response) -> Result<LightFrames, RadianceError> {
        let mut frames: Vec<&FrameRecord> = self.frames(station).iter().collect();
        frames.sort_by(|a, b| a.true_s.total_cmp(&b.true_s));
        let (mut silhouette, mut highlight) = (None, None);
        for frame in frames {
            let clipped = self.spots(frame, response).map_err(RadianceError::Frames)?.clipped.pixels;
            let count = clipped.iter().filter(|clipped| **clipped).count();
            if count == 0 || highlight.is_none() {
                highlight = Some(frame);
            }
            if count as f64 <= MOST_CLIPPED * clipped.len() as f64 || silhouette.is_none() {
                silhouette = Some(frame);
            }
        }
        let name = |frame: Option<&FrameRecord>| frame.map(|frame| frame.file.clone());
        let none = || RadianceError::Frames(format!("station {station} has no frame"));
        Ok(LightFrames {
            angle_deg: Some(self.angle_deg(station)),
            silhouette: name(silhouette).ok_or_else(none)?,
            highlight: name(highlight).ok_or_else(none)?,
        })
    }

    /// A frame by its name, as the ball finder takes it.
    pub fn spots_of(&self, name: &str, response: &Response) -> Result<Spots, String> {
        let mut frames = self.job.frames.iter().flatten();
        let frame = frames.find(|frame| frame.file == name).ok_or("there is no such frame")?;
        self.spots(frame, response)
    }

    fn spots(&self, frame: &FrameRecord, response: &Response) -> Result<Spots, String> {
        let bytes = read_frame(&self.job.directory, frame)?;
        decode(&bytes).map(|picture| through_response(&picture, response)).map_err(|e| e.to_string())
    }

    fn angle_deg(&self, station: usize) -> f64 {
        self.job.plan.station(station).map_or(0.0, |(_, angle)| angle)
    }

    fn frames(&self, station: usize) -> &'a [FrameRecord] {
        self.job.frames.get(station).map_or(&[][..], Vec::as_slice)
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
            let (disk, path) = (self.job.disk.as_ref(), self.job.directory.join(file(station)));
            write_radiance(disk, &path, &developed.image, (0, 0), camera, &attributes).map_err(RadianceError::Disk)?;
        }
        Ok(())
    }

    /// Radiance by the name of [`file`].
    pub fn radiance(&self, name: &str) -> Result<RadianceImage, String> {
        let size = (self.rig.camera.width, self.rig.camera.height);
        read_radiance(&self.job.directory.join(name), size).map_err(|e| e.reason)
    }

    fn files(&self, station: usize) -> Result<Vec<Shot<'_>>, RadianceError> {
        let read = |frame: &'a FrameRecord| {
            let bytes = read_frame(&self.job.directory, frame).map_err(RadianceError::Disk)?;
            Ok(Shot { name: &frame.file, bytes, time_s: frame.true_s })
        };
        self.frames(station).iter().map(read).collect()
    }
}

/// Green pixels above this level that a frame must show to say anything of response and times.
const LIT_LEVEL: u8 = 20;
const LEAST_LIT: usize = 1000;

/// The frames that show enough to measure times on. The shortest ones of the bracket are there for the highlights on balls: of all
/// else they show the rims of these, where a pixel mixes very different radiances. Such pixels contradict the ratios of all frames by
/// many times their noise, as if the lamp flickered, and spoil the times of the others.
fn lit<'a>(files: &'a [Shot<'_>]) -> Result<Vec<BracketFrame<'a>>, String> {
    let mut frames = Vec::new();
    for shot in files {
        let picture = decode(&shot.bytes).map_err(|e| format!("{}: {e}", shot.name))?;
        if picture.pixels.iter().filter(|pixel| pixel[1] > LIT_LEVEL).count() >= LEAST_LIT {
            frames.push(shot.frame());
        }
    }
    // Too few: the response's own words on all of them say what is wrong.
    Ok(if frames.len() < LEAST_EXPOSURES { files.iter().map(Shot::frame).collect() } else { frames })
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
