//! From committed frames to a fitted material: which pipeline steps the worker runs, on which files.

mod metered;

use super::adaptive::{Saved, Weighed};
use super::calibration::file::CalibrationFile;
use super::calibration::measure::Measuring;
use super::calibration::plan::CalibrationPlan;
use super::calibration::sample;
use super::crop;
use super::handle::FitRequest;
use super::lamp::patch;
use super::ledger::FrameRecord;
use super::plan::{LEAST_EXPOSURES, PlannedExposure, Station};
use crate::numerics::image::RadianceImage;
use crate::numerics::radiometry::metering::Worth;
use crate::numerics::radiometry::noise::SensorNoise;
use crate::pipeline::develop::{BracketFrame, Developed, Known, develop};
use crate::pipeline::fit::{FitError, FitOptions, FitProgress, FitResult, FitStep, OnProgress, cpu_seconds, fit};
use crate::pipeline::metering::Metering;
use crate::store::dataset::SessionLight;
use crate::store::files::{read_bytes, read_text};
use crate::store::manifest::Manifest;
use crate::store::{self, Disk, keep};
use rig_config::Rig;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// A complete bracket of a session.
#[derive(Clone, Debug)]
pub struct Bracket {
    /// Session id.
    pub session: String,
    /// Its directory.
    pub directory: PathBuf,
    /// The disk it lies on.
    pub disk: Arc<dyn Disk>,
    /// Index of the light station.
    pub station: usize,
    /// Where the light stood there, by the plan.
    pub light: Station,
    /// The frames, in shooting order.
    pub frames: Vec<FrameRecord>,
}

/// A bracket of an adaptive session that is being shot.
#[derive(Clone, Debug)]
pub struct OpenBracket {
    /// Session id.
    pub session: String,
    /// Its directory.
    pub directory: PathBuf,
    /// Index of the light station.
    pub number: usize,
    /// The station.
    pub station: Station,
    /// The exposures of the plan.
    pub exposures: Vec<PlannedExposure>,
    /// The frames so far, in the order in which they were shot.
    pub frames: Vec<FrameRecord>,
}

/// What an adaptive bracket needs next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Next {
    /// This exposure of the plan.
    Shoot(usize),
    /// Nothing; the frames that are there are worth this.
    Enough(Worth),
}

/// A fit of the stations that are developed.
#[derive(Clone, Debug)]
pub struct FitJob {
    /// The session's directory.
    pub directory: PathBuf,
    /// The disk it lies on.
    pub disk: Arc<dyn Disk>,
    /// The developed stations.
    pub stations: Vec<Station>,
    /// How bright the lamp was at each of them, red green blue, relative to the first of the session, by the reference patch.
    pub brightness: Vec<[f64; 3]>,
    /// What the report must say before its own warnings.
    pub warnings: Vec<String>,
    /// The dataset.toml that is there describes these stations; an operator may have changed it.
    pub described: bool,
    /// What differs from the rig file.
    pub request: FitRequest,
    /// What the session left out of its plan.
    pub saved: Option<Saved>,
}

/// A step of a calibration run that was shot.
#[derive(Clone, Debug)]
pub struct StepJob {
    /// The run's directory.
    pub directory: PathBuf,
    /// The disk it lies on.
    pub disk: Arc<dyn Disk>,
    /// Its manifest.
    pub manifest: Manifest,
    /// Its plan.
    pub plan: CalibrationPlan,
    /// Index of the step.
    pub step: usize,
    /// The frames of every station up to this step's last, in shooting order.
    pub frames: Vec<Vec<FrameRecord>>,
}

/// What a step of a calibration is worth.
#[derive(Clone, Debug, PartialEq)]
pub enum Judged {
    /// It serves; what was measured on it.
    Accepted(Value),
    /// It is to be shot again, for this reason.
    Refused(String),
}

/// The worker's pieces of work. Errors are reasons in words: they go to the journal. What a piece of work made is durable when it
/// returns: the journal says so next.
pub trait Processing: Send {
    /// Exposures a bracket needs at least to be developed: a plan with fewer is refused before anything moves.
    fn least_exposures(&self) -> usize;
    /// Develops a bracket to `radiance/NN.exr`; brackets of a session come in the order of their stations. Returns an object for the
    /// journal: `exposures`, their times, and `patch`, what the reference patch showed.
    fn develop(&mut self, bracket: &Bracket) -> Result<Value, String>;
    /// Says which exposure of an adaptive bracket is to be shot next. After an error the whole bracket is.
    fn meter(&mut self, bracket: &OpenBracket) -> Result<Next, String>;
    /// Fits the stations so far and says how good they are; writes no result.
    fn weigh(&mut self, job: &FitJob, progress: OnProgress<'_>) -> Result<Weighed, String>;
    /// Judges a step of a calibration; with the last one, writes the calibration. An error ends the run.
    fn judge(&mut self, job: &StepJob) -> Result<Judged, String>;
    /// Fits and writes `result/`; returns the report and, as `parameters`, the materials of material.json: what the journal tells of it.
    fn fit(&mut self, job: &FitJob, progress: OnProgress<'_>) -> Result<Value, String>;
}

/// The real pipeline on the rig's geometry.
pub struct PipelineProcessing {
    rig: Rig,
    /// Response and reference exposure of the first bracket of a session, used for all of it, and its times.
    known: Option<(String, Known)>,
    /// The adaptive bracket in hand: its session and station.
    open: Option<(String, usize, Metering)>,
    /// What is known of the calibration run in hand.
    measuring: Measuring,
}

impl PipelineProcessing {
    /// For sessions of this rig.
    pub fn new(rig: &Rig) -> Self {
        Self { rig: rig.clone(), known: None, open: None, measuring: Measuring::default() }
    }

    /// Writes dataset.toml: lights of the plan; camera and sphere of the rig file or, with a calibration, as measured.
    fn describe(&self, job: &FitJob, calibration: Option<&CalibrationFile>) -> Result<(), String> {
        let light = |(station, brightness): (&Station, &[f64; 3])| {
            let intensity = station.light_intensity.unwrap_or(self.rig.lamp.intensity);
            let intensity = std::array::from_fn(|c| intensity[c] * brightness[c]);
            SessionLight { position_mm: station.light_position_mm, intensity }
        };
        let lights: Vec<SessionLight> = job.stations.iter().zip(&job.brightness).map(light).collect();
        let (mut rig, mut origin) = (self.rig.clone(), "lights, camera and sphere: rig file".to_owned());
        if let Some(calibration) = calibration {
            rig = calibration.applied(&rig);
            let ball = sample::find(&job.directory, &rig, lights.len())?;
            rig.object.center_mm = ball.center.into();
            let sigma: Vec<String> =
                (0..3).map(|k| format!("{:.2}", ball.covariance[(k, k)].max(0.0).sqrt())).collect();
            origin = format!(
                "lights and camera: {}; sphere: found in these frames, centre +- ({}) mm, outline {:.2} px rms",
                calibration.title(),
                sigma.join(", "),
                ball.rms_px
            );
        }
        if self.rig.reference_patch.is_some() {
            origin += "; intensities follow the lamp, by the reference patch";
        }
        store::dataset::write_for_session(job.disk.as_ref(), &job.directory, &rig, &lights, &origin)
    }

    fn fitted(&self, job: &FitJob, progress: OnProgress<'_>) -> Result<FitResult, String> {
        let calibration = CalibrationFile::of_session(&job.directory)?;
        if !(job.described && job.directory.join("dataset.toml").exists()) {
            self.describe(job, calibration.as_ref())?;
        }
        if progress(FitProgress::Step(FitStep::Load)).is_break() {
            return Err(FitError::Cancelled.to_string());
        }
        let (begin, cpu_begin) = (Instant::now(), cpu_seconds());
        let dataset = store::dataset::read(&job.directory).map_err(|e| e.to_string())?;
        let (load, cpu_load) = (begin.elapsed(), cpu_seconds() - cpu_begin);
        let mut result = fit(&dataset, &self.options(&job.request), progress).map_err(|e| e.to_string())?;
        result.report.add_load(load.as_secs_f64(), cpu_load);
        result.material.provenance.simulated = Some(self.rig.is_simulated());
        result.material.provenance.calibration = calibration.map(|calibration| calibration.title());
        Ok(result)
    }

    fn options(&self, request: &FitRequest) -> FitOptions {
        let fit = &self.rig.fit;
        FitOptions {
            materials: request.materials.or(fit.materials),
            model: request.model.clone().unwrap_or_else(|| fit.model.clone()),
            lobe: request.lobe.clone().unwrap_or_else(|| fit.lobe.clone()),
            gains: request.gains.clone().unwrap_or_else(|| fit.gains.clone()),
            solver: request.solver.clone().unwrap_or_else(|| fit.solver.clone()),
            objective: request.objective.clone().unwrap_or_else(|| fit.objective.clone()),
            leave_out: request.leave_out.clone().unwrap_or_default(),
            cosine_cutoff: Some(fit.cosine_cutoff),
            ..FitOptions::default()
        }
    }
}

impl Processing for PipelineProcessing {
    fn least_exposures(&self) -> usize {
        LEAST_EXPOSURES
    }

    fn develop(&mut self, bracket: &Bracket) -> Result<Value, String> {
        let read = |frame| read_frame(&bracket.directory, frame);
        let files = bracket.frames.iter().map(read).collect::<Result<Vec<_>, _>>()?;
        let frames: Vec<_> = bracket
            .frames
            .iter()
            .zip(&files)
            .map(|(frame, bytes)| BracketFrame { name: &frame.file, bytes, time_s: frame.true_s })
            .collect();
        let calibration = CalibrationFile::of_session(&bracket.directory)?;
        let rig = calibration.as_ref().map_or_else(|| self.rig.clone(), |calibration| calibration.applied(&self.rig));
        let first = self.known.as_ref().filter(|(session, _)| bracket.station > 0 && *session == bracket.session);
        let expected: Vec<f64> = bracket.frames.iter().map(|frame| frame.true_s).collect();
        let known = match (first, &calibration) {
            (Some((_, known)), _) => Some(known.clone()),
            (None, Some(calibration)) => Some(Known::of(&calibration.response, &expected)?),
            (None, None) => None,
        };
        let camera = &rig.camera;
        let noise = SensorNoise { full_well_e: camera.full_well_e, read_noise_e: camera.read_noise_e };
        let part = crop::of_session(&rig, calibration.is_some());
        let developed = develop(&frames, part, known.as_ref(), &noise).map_err(|e| e.to_string())?;
        let times = times_of(bracket, &developed);
        let origin = part.map_or((0, 0), |part| (part.x, part.y));
        let attributes = [
            ("rigd.session", bracket.session.clone()),
            ("rigd.station", bracket.station.to_string()),
            ("rigd.exposures", times.to_string()),
            ("rigd.software", super::SOFTWARE.to_owned()),
        ];
        let path = bracket.directory.join(store::dataset::radiance_name(bracket.station));
        write_radiance(bracket.disk.as_ref(), &path, &developed.image, origin, camera, &attributes)?;
        let patch = match patch::read(&rig, &bracket.light, &frames, &developed.known, &noise) {
            Some(Ok(reading)) => json!(reading),
            Some(Err(reason)) => json!({"unread": reason}),
            None => Value::Null,
        };
        if first.is_none() {
            self.known = Some((bracket.session.clone(), developed.known));
        }
        Ok(json!({"exposures": times, "patch": patch}))
    }

    fn judge(&mut self, job: &StepJob) -> Result<Judged, String> {
        self.measuring.judge(&self.rig, job)
    }

    fn meter(&mut self, bracket: &OpenBracket) -> Result<Next, String> {
        self.next_exposure(bracket)
    }

    fn weigh(&mut self, job: &FitJob, progress: OnProgress<'_>) -> Result<Weighed, String> {
        let FitResult { report, material, .. } = self.fitted(job, progress)?;
        let taken = report.candidates.iter().find(|candidate| candidate.taken);
        Ok(Weighed {
            left_out_error: taken.and_then(|taken| taken.left_out_relative_error),
            left_out_highlight_error: taken.and_then(|taken| taken.left_out_highlight_relative_error),
            parameter_error: material.worst_parameter(),
        })
    }

    fn fit(&mut self, job: &FitJob, progress: OnProgress<'_>) -> Result<Value, String> {
        let mut result = self.fitted(job, progress)?;
        result.report.warnings.splice(0..0, job.warnings.iter().cloned());
        result.report.adaptive.clone_from(&job.saved);
        let finished = job.directory.join("result");
        keep::directory(job.disk.as_ref(), &finished, |unfinished| {
            store::result::write(unfinished, &result).map_err(|e| e.to_string())
        })?;
        let mut told = read_json(&finished.join("report.json"))?;
        told["parameters"] = json!(result.material.materials);
        Ok(told)
    }
}

/// Nominal, power-of-two and measured time of every exposure, shortest first.
fn times_of(bracket: &Bracket, developed: &Developed) -> Value {
    let times = developed.times.iter().enumerate().filter_map(|(i, (name, time))| {
        let frame = bracket.frames.iter().find(|frame| frame.file == *name)?;
        Some(json!({
            "frame": name,
            "nominal": frame.shutter,
            "power_of_two_s": frame.true_s,
            "estimated_s": time.time_s,
            "sigma_relative": time.sigma,
            "reference": i == developed.known.reference,
        }))
    });
    times.collect()
}

/// Reads a frame of the run in `directory`; it must be the one that was journalled.
pub(super) fn read_frame(directory: &Path, frame: &FrameRecord) -> Result<Vec<u8>, String> {
    let path = directory.join("frames").join(&frame.file);
    let bytes = read_bytes(&path, "frame", frame.bytes).map_err(|e| format!("{}: {e}", path.display()))?;
    if blake3::hash(&bytes).to_hex().as_str() != frame.blake3 {
        return Err(format!("{} is not the frame that was journalled: it was changed on disk", path.display()));
    }
    Ok(bytes)
}

/// Writes radiance that begins at pixel `origin` of the frame; durable when this returns.
pub(super) fn write_radiance(
    disk: &dyn Disk,
    path: &Path,
    image: &RadianceImage,
    origin: (usize, usize),
    camera: &rig_config::Camera,
    attributes: &[(&str, String)],
) -> Result<(), String> {
    let size = (camera.width, camera.height);
    keep::file(disk, path, |unfinished| {
        store::exr::write_radiance(unfinished, image, origin, size, attributes).map_err(|e| e.to_string())
    })
}

/// Reads a JSON file; the reason names it.
pub fn read_json(path: &Path) -> Result<Value, String> {
    let text = read_text(path, "JSON file").map_err(|reason| format!("{}: {reason}", path.display()))?;
    serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))
}
