//! From committed frames to a fitted material: which pipeline steps the worker runs, on which files.

use super::crop;
use super::handle::FitRequest;
use super::ledger::FrameRecord;
use super::plan::LEAST_EXPOSURES;
use crate::numerics::radiometry::noise::SensorNoise;
use crate::pipeline::develop::{BracketFrame, Developed, Known, develop};
use crate::pipeline::fit::{FitOptions, OnProgress, cpu_seconds, fit};
use crate::store;
use crate::store::files::{Unfinished, read_text};
use rig_config::Rig;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A complete bracket of a session.
#[derive(Clone, Debug)]
pub struct Bracket {
    /// Session id.
    pub session: String,
    /// Its directory.
    pub directory: PathBuf,
    /// Index of the light station.
    pub station: usize,
    /// The frames, in shooting order.
    pub frames: Vec<FrameRecord>,
}

/// A fit of the stations that are developed.
#[derive(Clone, Debug)]
pub struct FitJob {
    /// The session's directory.
    pub directory: PathBuf,
    /// Light positions of the developed stations, camera frame, mm.
    pub light_positions_mm: Vec<[f64; 3]>,
    /// What differs from the rig file.
    pub request: FitRequest,
}

/// The worker's two pieces of work. Errors are reasons in words: they go to the journal.
pub trait Processing: Send {
    /// Exposures a bracket needs at least to be developed: a plan with fewer is refused before anything moves.
    fn least_exposures(&self) -> usize;
    /// Develops a bracket to `radiance/NN.exr`; brackets of a session come in the order of their stations. Returns the times of
    /// its exposures, for the journal.
    fn develop(&mut self, bracket: &Bracket) -> Result<Value, String>;
    /// Fits and writes `result/`; returns the report.
    fn fit(&mut self, job: &FitJob, progress: OnProgress<'_>) -> Result<Value, String>;
}

/// The real pipeline on the rig's geometry.
pub struct PipelineProcessing {
    rig: Rig,
    /// Response and reference exposure of the first bracket of a session, used for all of it, and its times.
    known: Option<(String, Known)>,
}

impl PipelineProcessing {
    /// For sessions of this rig.
    pub fn new(rig: &Rig) -> Self {
        Self { rig: rig.clone(), known: None }
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
        let files = read_frames(bracket)?;
        let frames: Vec<_> = bracket
            .frames
            .iter()
            .zip(&files)
            .map(|(frame, bytes)| BracketFrame { name: &frame.file, bytes, time_s: frame.true_s })
            .collect();
        let known = self.known.as_ref().filter(|(session, _)| bracket.station > 0 && *session == bracket.session);
        let camera = &self.rig.camera;
        let noise = SensorNoise { full_well_e: camera.full_well_e, read_noise_e: camera.read_noise_e };
        let part = crop::of_object(&self.rig);
        let developed = develop(&frames, part, known.map(|(_, known)| known), &noise).map_err(|e| e.to_string())?;
        let times = times_of(bracket, &developed);
        let origin = part.map_or((0, 0), |part| (part.x, part.y));
        let attributes = [
            ("rigd.session", bracket.session.clone()),
            ("rigd.station", bracket.station.to_string()),
            ("rigd.exposures", times.to_string()),
            ("rigd.software", super::SOFTWARE.to_owned()),
        ];
        let name = format!("{:02}.exr", bracket.station);
        let folder = bracket.directory.join("radiance");
        let mut unfinished = Unfinished::within(&folder);
        let size = (camera.width, camera.height);
        store::exr::write_radiance(&unfinished.path(&name), &developed.image, origin, size, &attributes)
            .map_err(|e| e.to_string())?;
        unfinished.finish().map_err(|(path, e)| format!("cannot name {}: {e}", path.display()))?;
        if known.is_none() {
            self.known = Some((bracket.session.clone(), developed.known));
        }
        Ok(times)
    }

    fn fit(&mut self, job: &FitJob, progress: OnProgress<'_>) -> Result<Value, String> {
        if !job.directory.join("dataset.toml").exists() {
            store::dataset::write_for_session(&job.directory, &self.rig, &job.light_positions_mm)
                .map_err(|e| e.to_string())?;
        }
        let (begin, cpu_begin) = (Instant::now(), cpu_seconds());
        let dataset = store::dataset::read(&job.directory).map_err(|e| e.to_string())?;
        let (load, cpu_load) = (begin.elapsed(), cpu_seconds() - cpu_begin);
        let mut result = fit(&dataset, &self.options(&job.request), progress).map_err(|e| e.to_string())?;
        result.report.add_load(load.as_secs_f64(), cpu_load);
        result.material.provenance.simulated = Some(self.rig.is_simulated());
        let unfinished = job.directory.join(".result");
        clear(&unfinished)?;
        store::result::write(&unfinished, &result).map_err(|e| {
            let _ = clear(&unfinished);
            e.to_string()
        })?;
        let finished = job.directory.join("result");
        clear(&finished)?;
        std::fs::rename(&unfinished, &finished).map_err(|e| format!("cannot name {}: {e}", finished.display()))?;
        read_json(&finished.join("report.json"))
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

fn read_frames(bracket: &Bracket) -> Result<Vec<Vec<u8>>, String> {
    let read = |frame: &FrameRecord| {
        let path = bracket.directory.join("frames").join(&frame.file);
        let bytes = std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        if blake3::hash(&bytes).to_hex().as_str() != frame.blake3 {
            return Err(format!("{} is not the frame that was journalled: it was changed on disk", path.display()));
        }
        Ok(bytes)
    };
    bracket.frames.iter().map(read).collect()
}

fn clear(directory: &Path) -> Result<(), String> {
    match std::fs::remove_dir_all(directory) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(format!("{}: {e}", directory.display())),
        _ => Ok(()),
    }
}

/// Reads a JSON file; the reason names it.
pub fn read_json(path: &Path) -> Result<Value, String> {
    let text = read_text(path, "JSON file").map_err(|reason| format!("{}: {reason}", path.display()))?;
    serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))
}
