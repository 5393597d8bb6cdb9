//! What a calibration run shoots: its steps with their light stations and exposures.

use super::step::Step;
use crate::numerics::geometry::Vec3;
use crate::session::plan::{
    LEAST_EXPOSURES, PlanError, PlannedExposure, RECORDS_BYTES, Tally, check_name, frame_pixels, frames_bytes,
};
use rig_config::{Calibration, Rig, Shutter};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What `POST /v1/calibrations` may say; everything else comes from `[calibration]` of the rig file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CalibrationRequest {
    /// A name, for people; at most 200 characters.
    pub name: Option<String>,
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
        let mut reasons = Vec::new();
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
        let mut tally = Tally::new(rig);
        let mut frames = 0;
        for step in &steps {
            step.stations_deg.iter().for_each(|&angle| tally.station(angle, &step.exposures));
            frames += step.stations_deg.len() * step.exposures.len();
        }
        let developed: usize = steps.iter().filter(|s| s.is_developed()).map(|s| s.stations_deg.len()).sum();
        let estimated_bytes = frames_bytes(rig, frames, developed, frame_pixels(rig)) + RECORDS_BYTES;
        Ok(Self { name, steps, frames, estimated_s: tally.seconds(), estimated_bytes })
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
    });
    let card = PlannedStep { step: Step::Card, stations_deg: lit, exposures: bracket.clone() };
    let balls = PlannedStep { step: Step::Balls, stations_deg: calibration.stations_deg.clone(), exposures: bracket };
    board.chain([card, balls]).collect()
}

/// Whether the lamp at this angle stands on the camera's side of the object: the card faces about there.
fn lights_the_card(rig: &Rig, angle_deg: f64) -> bool {
    frontality(rig, angle_deg) > CARD_MOST_DEGREES.to_radians().cos()
}

/// Cosine between the ways from the object to the lamp at this angle and to the camera, by the rig file's own geometry.
pub(super) fn frontality(rig: &Rig, angle_deg: f64) -> f64 {
    let object = Vec3::from(rig.object.center_mm);
    let to_lamp = Vec3::from(rig.lamp.position_mm(angle_deg)) - object;
    to_lamp.normalize().dot(&-object.normalize())
}

impl From<&Shutter> for PlannedExposure {
    fn from(shutter: &Shutter) -> Self {
        Self { label: shutter.label.clone(), true_s: shutter.true_s }
    }
}
