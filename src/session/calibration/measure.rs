//! From the frames of a calibration run to calibration.json: every step is judged when it was shot, so that the operator can put right
//! what is wrong while board, card or balls still stand there.

use super::exposure;
use super::file::{CalibrationFile, FILE_HASH, NAME};
use super::plan::PlannedStep;
use super::radiance::{self, RadianceError, Stations};
use super::settle;
use super::step::Step;
use crate::pipeline::calibration::camera::{
    Board, CameraCalibration, Found, Photograph, calibrate_camera, card_on_board, look_at_view,
};
use crate::pipeline::calibration::lights::{
    CardFrame, LightFrames, LightsCalibration, LightsSettings, calibrate_lights, intensities, shadows,
};
use crate::pipeline::calibration::response::ResponseCalibration;
use crate::session::processing::{Judged, StepJob, read_frame};
use crate::session::quality::Optics;
use crate::store::keep;
use rig_config::{Calibration, Rig};
use serde_json::{Value, json};

/// What is known of the run in hand.
#[derive(Default)]
pub struct Measuring {
    run: String,
    views: Vec<(usize, Found)>,
    camera: Option<CameraCalibration>,
}

/// Why a step goes no further.
pub(super) enum Stop {
    /// It is to be shot again.
    Refuse(String),
    /// The run ends.
    Fail(String),
}

/// A fault of disk or run, which shooting again does not mend.
pub(super) fn fail(reason: impl ToString) -> Stop {
    Stop::Fail(reason.to_string())
}

/// What another shot may mend.
fn refuse(reason: impl ToString) -> Stop {
    Stop::Refuse(reason.to_string())
}

impl Measuring {
    /// Judges a step; with the last one, writes the calibration.
    pub fn judge(&mut self, rig: &Rig, job: &StepJob) -> Result<Judged, String> {
        if self.run != job.manifest.id {
            *self = Self { run: job.manifest.id.clone(), ..Self::default() };
        }
        let judged = match (job.plan.steps.get(job.step).map(|step| step.step), &rig.calibration) {
            (Some(Step::Settle), _) => settle::judge(rig, job),
            (Some(Step::Board { view, of }), Some(calibration)) => self.board(calibration, rig, job, (view, of)),
            (Some(Step::Card), Some(calibration)) => self.card(calibration, rig, job),
            (Some(Step::Balls), Some(calibration)) => self.balls(calibration, rig, job),
            (Some(Step::Done) | None, _) => Err(fail(format!("the plan has no step {}", job.step))),
            (Some(_), None) => Err(fail("the rig file has no [calibration]")),
        };
        match judged {
            Ok(found) => Ok(Judged::Accepted(found)),
            Err(Stop::Refuse(reason)) => Ok(Judged::Refused(reason)),
            Err(Stop::Fail(reason)) => Err(reason),
        }
    }

    /// One view of the board; with the last one the camera is calibrated.
    fn board(
        &mut self,
        calibration: &Calibration,
        rig: &Rig,
        job: &StepJob,
        (view, of): (usize, usize),
    ) -> Result<Value, Stop> {
        let board = board(calibration);
        let frame = first_frame(job, job.step)?;
        let bytes = read_frame(&job.directory, frame).map_err(fail)?;
        let photograph = Photograph { name: &frame.file, bytes: &bytes };
        self.views.retain(|(earlier, _)| *earlier < view);
        let size = (rig.camera.width, rig.camera.height);
        let found = look_at_view(&photograph, &board, size, &self.views).map_err(refuse)?;
        exposure::check_board(&bytes, &found, (board.columns, board.rows)).map_err(refuse)?;
        let quality = found.quality;
        self.views.push((view, found));
        let mut value = json!({
            "corners": board.corners(), "edge_px": quality.edge_px, "white": quality.white, "black": quality.black,
        });
        if view == of {
            let camera = all_views(job, &board)?;
            value["camera"] = summary_of_camera(&camera);
            self.camera = Some(camera);
        }
        Ok(value)
    }

    /// The card: lit, whole, and of a radiance that the bracket holds.
    fn card(&mut self, calibration: &Calibration, rig: &Rig, job: &StepJob) -> Result<Value, Stop> {
        let camera = self.camera.as_ref().ok_or_else(|| fail("the camera is not calibrated"))?;
        let stations = Stations::of(job, rig);
        let range = job.plan.stations_of(job.step);
        let response = stations.response(range.clone())?;
        stations.develop(range.clone(), &response)?;
        let card = card_on_board(camera, &last_view(job)?, calibration.card_side_mm, reflectance(calibration))
            .map_err(fail)?;
        // The lights are not measured yet: those of the rig file do for asking whether the card can be used at all.
        let nominal: Vec<_> =
            range.clone().map(|s| rig.lamp.position_mm(job.plan.station(s).map_or(0.0, |(_, a)| a))).collect();
        let lights = LightsCalibration::nominal(&nominal);
        let shot: Vec<CardFrame> =
            range.clone().enumerate().map(|(light, s)| CardFrame { light, file: radiance::file(s) }).collect();
        let load = |name: &str| stations.radiance(name);
        let found = intensities(&lights, &camera.projection(), &card, &shot, &load).map_err(refuse)?;
        let dark = shadows(&lights, &camera.projection(), &card, &shot, &load).map_err(refuse)?;
        if !dark.is_empty() {
            return Err(refuse(dark.join("; ")));
        }
        let usable = found.lights.iter().filter(|light| light.intensity.is_some()).count();
        let doubts: Vec<&String> = found.warnings.iter().chain(found.lights.iter().flat_map(|l| &l.warnings)).collect();
        Ok(json!({"stations_that_light_it": usable, "response": summary_of_response(&response), "notes": doubts}))
    }

    /// The balls: lights, response, intensities, and the calibration as a whole.
    fn balls(&mut self, calibration: &Calibration, rig: &Rig, job: &StepJob) -> Result<Value, Stop> {
        let camera = self.camera.as_ref().ok_or_else(|| fail("the camera is not calibrated"))?;
        let stations = Stations::of(job, rig);
        let step = |step: Step| job.plan.steps.iter().position(|planned| planned.step == step);
        let card_step = step(Step::Card).ok_or_else(|| fail("the plan has no card"))?;
        let (cards, balls) = (job.plan.stations_of(card_step), job.plan.stations_of(job.step));
        let response = stations.response(balls.clone())?;
        let curve = response.response().map_err(fail)?;
        let settings = LightsSettings {
            projection: camera.projection(),
            size: (rig.camera.width, rig.camera.height),
            radius_mm: calibration.ball_radius_mm,
            balls: calibration.balls,
            angle_sigma_deg: rig.arm.tolerance_deg,
        };
        let angle = |station: usize| job.plan.station(station).map(|(_, angle)| angle);
        let shown: Result<Vec<LightFrames>, _> = balls.map(|station| stations.of_balls(station, &curve)).collect();
        let lights = shown?;
        let load = |name: &str| stations.spots_of(name, &curve);
        let found = calibrate_lights(&lights, &load, &settings).map_err(refuse)?;
        if found.balls.len() < calibration.balls {
            let (seen, all) = (found.balls.len(), calibration.balls);
            return Err(refuse(format!(
                "{seen} of {all} balls found: put up all of them, whole in the frame, lit and in focus, none before another or in \
                 another's shadow"
            )));
        }
        for light in &lights {
            let spots = load(&light.highlight).map_err(refuse)?;
            exposure::check_highlights(&light.highlight, &spots.clipped, &found.balls).map_err(refuse)?;
        }
        stations.develop(cards.clone(), &response)?;
        let card = card_on_board(camera, &last_view(job)?, calibration.card_side_mm, reflectance(calibration))
            .map_err(fail)?;
        let shot: Vec<CardFrame> = cards
            .filter_map(|station| {
                let light = lights.iter().position(|light| light.angle_deg == angle(station))?;
                Some(CardFrame { light, file: radiance::file(station) })
            })
            .collect();
        let load = |name: &str| stations.radiance(name);
        // The card was found usable with the rig file's lights: now it is the balls that may be wrong.
        let lights = intensities(&found, &settings.projection, &card, &shot, &load).map_err(|e| {
            refuse(format!("with the lights these balls show, the card gives no intensity ({e}): shoot the balls again; if that does \
                            not help, abort and calibrate anew"))
        })?;
        let first = read_frame(&job.directory, first_frame(job, 0)?).map_err(fail)?;
        let file = CalibrationFile { optics: Optics::of(&first), ..self.file(job, camera, response, lights) };
        let text = serde_json::to_string_pretty(&file).map_err(fail)?;
        let hash = write(job, NAME, &text)?;
        let mut summary = summary_of(&file);
        summary[FILE_HASH] = hash.into();
        Ok(summary)
    }

    fn file(
        &self,
        job: &StepJob,
        camera: &CameraCalibration,
        response: ResponseCalibration,
        lights: LightsCalibration,
    ) -> CalibrationFile {
        let manifest = &job.manifest;
        let of_lights = lights.lights.iter().flat_map(|light| &light.warnings);
        let all = camera.warnings.iter().chain(&response.warnings).chain(&lights.warnings).chain(of_lights);
        CalibrationFile {
            format: 1,
            id: manifest.id.clone(),
            version: manifest.version.unwrap_or_default(),
            made: jiff::Timestamp::now().to_string(),
            software: manifest.software.clone(),
            simulated: manifest.simulated,
            arm: manifest.arm.clone(),
            camera_model: manifest.camera.clone(),
            optics: Optics::default(),
            frames: job.frames.iter().flatten().map(|frame| frame.file.clone()).collect(),
            warnings: all.cloned().collect(),
            camera: camera.clone(),
            response,
            lights,
        }
    }
}

fn board(calibration: &Calibration) -> Board {
    let Calibration { board_columns, board_rows, square_mm, .. } = *calibration;
    Board { columns: board_columns, rows: board_rows, square_mm }
}

/// The card's diffuse reflectance and its relative standard deviation.
fn reflectance(calibration: &Calibration) -> (f64, f64) {
    (calibration.card_reflectance, calibration.card_reflectance_sigma)
}

fn first_frame(job: &StepJob, step: usize) -> Result<&crate::session::ledger::FrameRecord, Stop> {
    let frames = job.frames.get(job.plan.stations_of(step).start);
    frames.and_then(|frames| frames.first()).ok_or_else(|| fail(format!("step {step} has no frame")))
}

/// Steps of the board, in order.
fn board_steps(job: &StepJob) -> impl Iterator<Item = usize> {
    let is_board = |step: &PlannedStep| matches!(step.step, Step::Board { .. });
    job.plan.steps.iter().enumerate().filter(move |(_, step)| is_board(step)).map(|(index, _)| index)
}

/// Name of the frame that shows the board where the card lies.
fn last_view(job: &StepJob) -> Result<String, Stop> {
    let last = board_steps(job).last().ok_or_else(|| fail("the plan has no board"))?;
    first_frame(job, last).map(|frame| frame.file.clone())
}

/// The camera from every view of the board.
fn all_views(job: &StepJob, board: &Board) -> Result<CameraCalibration, Stop> {
    let mut files = Vec::new();
    for step in board_steps(job) {
        let frame = first_frame(job, step)?;
        files.push((frame.file.as_str(), read_frame(&job.directory, frame).map_err(fail)?));
    }
    let photographs: Vec<Photograph<'_>> = files.iter().map(|(name, bytes)| Photograph { name, bytes }).collect();
    let camera = calibrate_camera(&photographs, board).map_err(refuse)?;
    let last = last_view(job)?;
    match camera.views.iter().find(|view| view.name == last).and_then(|view| view.rejected.as_ref()) {
        Some(reason) => Err(refuse(format!("the board where the card will lie does not serve: {reason}"))),
        None => Ok(camera),
    }
}

/// What was measured in `result/`, durable when this returns; its hash, for the journal.
pub(super) fn write(job: &StepJob, name: &str, text: &str) -> Result<String, Stop> {
    keep::directory(job.disk.as_ref(), &job.directory.join("result"), |unfinished| {
        let written = std::fs::create_dir(unfinished).and_then(|()| std::fs::write(unfinished.join(name), text));
        written.map_err(|e| format!("cannot write {}: {e}", unfinished.join(name).display()))
    })
    .map_err(fail)?;
    Ok(blake3::hash(text.as_bytes()).to_hex().to_string())
}

fn summary_of_camera(camera: &CameraCalibration) -> Value {
    json!({
        "focal_px": camera.focal_px, "principal_px": camera.principal_px, "distortion": camera.distortion,
        "sigma": camera.sigma, "rms_px": camera.rms_px, "warnings": camera.warnings,
    })
}

fn summary_of_response(response: &ResponseCalibration) -> Value {
    json!({"reference": response.reference, "exponent_sigma": response.exponent_sigma, "warnings": response.warnings})
}

/// What a person wants to know of the calibration.
fn summary_of(file: &CalibrationFile) -> Value {
    let lights = file.lights.lights.iter().map(|light| {
        let sigma: [f64; 3] = std::array::from_fn(|k| light.covariance_mm2[k][k].max(0.0).sqrt());
        json!({
            "angle_deg": light.angle_deg, "position_mm": light.position_mm, "position_sigma_mm": sigma,
            "intensity": light.intensity, "intensity_sigma": light.intensity_sigma,
        })
    });
    json!({
        "camera": summary_of_camera(&file.camera), "response": summary_of_response(&file.response),
        "lights": lights.collect::<Vec<_>>(), "circle": file.lights.circle, "bulb_intensity": file.lights.bulb_intensity,
        "highlights_rms_px": file.lights.rms_px, "warnings": file.warnings,
    })
}

impl From<RadianceError> for Stop {
    fn from(error: RadianceError) -> Self {
        match error {
            RadianceError::Frames(reason) => Self::Refuse(reason),
            RadianceError::Disk(reason) => Self::Fail(reason),
        }
    }
}
