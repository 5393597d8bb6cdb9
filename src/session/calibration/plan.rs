//! What a calibration run shoots: its steps with their light stations and exposures.

use super::settle;
use super::step::Step;
use crate::numerics::geometry::Vec3;
use crate::session::plan::{
    LEAST_EXPOSURES, PlanError, PlannedExposure, RECORDS_BYTES, Tally, check_name, frame_pixels, frames_bytes,
};
use rig_config::{Calibration, Rig, Shutter};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What is calibrated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Camera, response and lights, with an operator: board, card, balls.
    #[default]
    Rig,
    /// The settle time of the arm, by itself, on whatever stands in place of the sample.
    Settle,
}

/// What `POST /v1/calibrations` may say; everything else comes from `[calibration]` of the rig file, for the settle time from its `[plan]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CalibrationRequest {
    /// A name, for people; at most 200 characters.
    pub name: Option<String>,
    /// What is calibrated; left out: the rig.
    pub kind: Kind,
    /// Shutter label of the settle time's frames; the middle one of the plan's bracket if left out. For kind `settle`.
    pub exposure: Option<String>,
}

/// One step of the plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlannedStep {
    /// What is to be in place.
    pub step: Step,
    /// Arm angles at which it is shot, degrees.
    pub stations_deg: Vec<f64>,
    /// Exposures at each.
    pub exposures: Vec<PlannedExposure>,
    /// How the arm comes to each, where that is what is measured; else empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub approaches: Vec<Approach>,
}

/// The move before a burst.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Approach {
    /// Where the arm rests before it, degrees.
    pub from_deg: f64,
    /// How long the first frame is held back, in parts of the time between two frames of the first burst.
    pub delay: f64,
}

/// The plan of a calibration run. Frames are numbered by their stations, counted through all steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationPlan {
    /// Name of the run.
    pub name: String,
    /// The steps in order.
    pub steps: Vec<PlannedStep>,
    /// Frames in all, when nothing is refused.
    pub frames: usize,
    /// Estimated duration, seconds, without the operator.
    pub estimated_s: f64,
    /// Estimated disk space, bytes.
    pub estimated_bytes: u64,
}

/// A card is not shot from stations whose nominal light comes in flatter than this, degrees off the way to the camera.
const CARD_MOST_DEGREES: f64 = 70.0;

impl CalibrationPlan {
    /// The run that the rig file describes.
    ///
    /// # Errors
    /// The rig file has no `[calibration]`, its bracket is too short, or no station lights the card; every reason at once.
    pub fn new(rig: &Rig, request: &CalibrationRequest) -> Result<Self, PlanError> {
        if request.kind == Kind::Settle {
            return settle::plan::plan(rig, request);
        }
        let mut reasons = Vec::new();
        if request.exposure.is_some() {
            reasons.push(
                "exposure: it has no meaning for kind `rig`, whose exposures are those of the rig file: leave it out"
                    .into(),
            );
        }
        let name = request.name.clone().unwrap_or_else(|| rig.name.clone());
        check_name(&name, &mut reasons);
        let Some(calibration) = &rig.calibration else {
            reasons.push(
                "the rig file has no [calibration]: add it (board, card, balls) and start the daemon anew".into(),
            );
            return Err(PlanError { reasons });
        };
        let count = calibration.exposures.len();
        if count < LEAST_EXPOSURES {
            reasons.push(format!(
                "calibration.exposures: {count} exposures cannot be developed: name at least {LEAST_EXPOSURES} in the rig file"
            ));
        }
        let steps = steps(rig, calibration);
        if steps.iter().any(|step| step.stations_deg.is_empty()) {
            reasons.push(format!(
                "calibration.stations_deg: none stands within {CARD_MOST_DEGREES} degrees of the way from object to camera, so none lights \
                 the card: add one to the rig file"
            ));
        }
        if !reasons.is_empty() {
            return Err(PlanError { reasons });
        }
        Ok(Self::of(rig, name, steps))
    }

    /// A plan of these steps.
    pub(super) fn of(rig: &Rig, name: String, steps: Vec<PlannedStep>) -> Self {
        let mut tally = Tally::new(rig);
        let mut frames = 0;
        for step in &steps {
            for (station, &angle) in step.stations_deg.iter().enumerate() {
                if let Some(approach) = step.approaches.get(station) {
                    tally.wait(approach.from_deg, settle::plan::REST_S);
                }
                tally.station(angle, &step.exposures);
            }
            frames += step.stations_deg.len() * step.exposures.len();
        }
        let developed: usize = steps.iter().filter(|s| s.is_developed()).map(|s| s.stations_deg.len()).sum();
        let estimated_bytes = frames_bytes(rig, frames, developed, frame_pixels(rig)) + RECORDS_BYTES;
        Self { name, steps, frames, estimated_s: tally.seconds(), estimated_bytes }
    }

    /// What it calibrates.
    pub fn kind(&self) -> Kind {
        if self.steps.iter().any(|step| step.step == Step::Settle) { Kind::Settle } else { Kind::Rig }
    }

    /// How the arm comes to a station, where that is what is measured.
    pub fn approach(&self, station: usize) -> Option<Approach> {
        let all = self.steps.iter().flat_map(|step| (0..step.stations_deg.len()).map(|at| step.approaches.get(at)));
        all.into_iter().nth(station).flatten().copied()
    }

    /// Step and arm angle (degrees) of a station, counted through all steps.
    pub fn station(&self, station: usize) -> Option<(&PlannedStep, f64)> {
        self.steps.iter().flat_map(|step| step.stations_deg.iter().map(move |&angle| (step, angle))).nth(station)
    }

    /// Stations in all.
    pub fn stations(&self) -> usize {
        self.steps.iter().map(|step| step.stations_deg.len()).sum()
    }

    /// Stations of one step.
    pub fn stations_of(&self, index: usize) -> std::ops::Range<usize> {
        let first = self.steps.iter().take(index).map(|step| step.stations_deg.len()).sum();
        first..first + self.steps.get(index).map_or(0, |step| step.stations_deg.len())
    }
}

impl PlannedStep {
    /// True where brackets are developed to radiance.
    pub fn is_developed(&self) -> bool {
        self.step == Step::Card
    }
}

fn steps(rig: &Rig, calibration: &Calibration) -> Vec<PlannedStep> {
    let of = calibration.board_views;
    let bracket: Vec<PlannedExposure> = calibration.exposures.iter().map(PlannedExposure::from).collect();
    let lit = calibration.stations_deg.iter().copied().filter(|&angle| lights_the_card(rig, angle)).collect();
    let board = (1..=of).map(|view| PlannedStep {
        step: Step::Board { view, of },
        stations_deg: vec![calibration.board_station_deg],
        exposures: vec![PlannedExposure::from(&calibration.board_exposure)],
        approaches: Vec::new(),
    });
    let (approaches, stations_deg) = (Vec::new(), calibration.stations_deg.clone());
    let card =
        PlannedStep { step: Step::Card, stations_deg: lit, exposures: bracket.clone(), approaches: approaches.clone() };
    let balls = PlannedStep { step: Step::Balls, stations_deg, exposures: bracket, approaches };
    board.chain([card, balls]).collect()
}

/// Whether the lamp at this angle stands on the camera's side of the object: the card faces about there.
fn lights_the_card(rig: &Rig, angle_deg: f64) -> bool {
    frontality(rig, angle_deg) > CARD_MOST_DEGREES.to_radians().cos()
}

/// Cosine between the ways from the object to the lamp at this angle and to the camera, by the rig file's own geometry.
pub(in crate::session) fn frontality(rig: &Rig, angle_deg: f64) -> f64 {
    let object = Vec3::from(rig.object.center_mm);
    let to_lamp = Vec3::from(rig.lamp.position_mm(angle_deg)) - object;
    to_lamp.normalize().dot(&-object.normalize())
}

impl From<&Shutter> for PlannedExposure {
    fn from(shutter: &Shutter) -> Self {
        Self { label: shutter.label.clone(), true_s: shutter.true_s }
    }
}
