//! What is shot for the settle time: bursts at one station, after moves of two lengths, each with its first frame held back by another
//! part of the time between two frames, so that together they sample the time after a move finely.

use crate::session::calibration::plan::{Approach, CalibrationPlan, CalibrationRequest, PlannedStep};
use crate::session::calibration::step::Step;
use crate::session::order;
use crate::session::plan::{PlanError, PlannedExposure, check_name};
use rig_config::{Rig, Shutter};

/// Frames of a burst.
const FRAMES: usize = 7;
/// Bursts after moves of one length.
const REPEATS: usize = 8;
/// Length of the short move, degrees; less if the largest step of the plan is not twice as long.
const SHORT_DEG: f64 = 2.0;
/// How long the arm rests before a move, seconds: what the way back has stirred must not go into the next move.
pub const REST_S: f64 = 5.0;

/// The largest step between two stations of the plan as a session shoots it, from and to, degrees; of a plan of one station the way from
/// the park position.
fn largest_step(rig: &Rig) -> Option<(f64, f64)> {
    let stations = order::of_rig(rig);
    let steps = stations.windows(2).filter_map(|pair| Some((*pair.first()?, *pair.get(1)?)));
    let first = stations.first().map(|&first| (rig.arm.park_deg, first));
    let length = |(from, to): (f64, f64)| (to - from).abs();
    let longer = |best: (f64, f64), step: (f64, f64)| if length(step) > length(best) { step } else { best };
    steps.reduce(longer).or(first).filter(|&step| length(step) > rig.arm.tolerance_deg)
}

/// The run.
///
/// # Errors
/// An exposure that is none, or a plan in which the arm does not move; every reason at once.
pub fn plan(rig: &Rig, request: &CalibrationRequest) -> Result<CalibrationPlan, PlanError> {
    let mut reasons = Vec::new();
    let name = request.name.clone().unwrap_or_else(|| format!("{}, settle time", rig.name).chars().take(200).collect());
    check_name(&name, &mut reasons);
    let shutter = match &request.exposure {
        Some(label) => Shutter::from_label(label).map_err(|error| reasons.push(format!("exposure: {error}"))).ok(),
        None => middle(&rig.plan.exposures),
    };
    let step = largest_step(rig);
    if step.is_none() {
        reasons.push("plan.stations_deg: the arm does not move in this plan, so it needs no time to settle".into());
    }
    let (Some(shutter), Some((from_deg, to_deg)), true) = (shutter, step, reasons.is_empty()) else {
        return Err(PlanError { reasons });
    };
    Ok(CalibrationPlan::of(rig, name, vec![bursts(from_deg, to_deg, &shutter)]))
}

/// First a burst beside the station, which tells what a turn of the arm changes in the picture, and the time between two frames.
fn bursts(from_deg: f64, to_deg: f64, shutter: &Shutter) -> PlannedStep {
    let length = (to_deg - from_deg).abs().min(2.0 * SHORT_DEG);
    let beside_deg = to_deg - 0.5 * length * (to_deg - from_deg).signum();
    let staggered = |from_deg| (0..REPEATS).map(move |k| Approach { from_deg, delay: k as f64 / REPEATS as f64 });
    let first = std::iter::once(Approach { from_deg, delay: 0.0 });
    let approaches: Vec<Approach> = first.chain(staggered(from_deg)).chain(staggered(beside_deg)).collect();
    let station = |index: usize| if index == 0 { beside_deg } else { to_deg };
    PlannedStep {
        step: Step::Settle,
        stations_deg: (0..approaches.len()).map(station).collect(),
        exposures: vec![PlannedExposure::from(shutter); FRAMES],
        approaches,
    }
}

/// The middle one of a bracket by length: it shows most of what the bracket was made for.
fn middle(bracket: &[Shutter]) -> Option<Shutter> {
    let mut sorted: Vec<&Shutter> = bracket.iter().collect();
    sorted.sort_by(|a, b| a.true_s.total_cmp(&b.true_s));
    sorted.get(sorted.len().saturating_sub(1) / 2).map(|shutter| (*shutter).clone())
}
