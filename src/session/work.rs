//! What a run of the engine is to do: photograph a sample, or calibrate the rig. Shooting, journal and clean-up are the same.

use super::calibration::plan::{Approach, CalibrationPlan};
use super::plan::{CapturePlan, PlannedExposure};
use super::state::Verb;
use crate::store::manifest::Manifest;
use serde::Deserialize;

/// The plan of a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Work {
    /// A session: one sample, unattended.
    Capture(CapturePlan),
    /// A calibration: step by step with an operator.
    Calibration(CalibrationPlan),
}

impl Work {
    /// As the manifest of a run found on disk has it.
    pub fn of(manifest: &Manifest) -> Result<Self, serde_json::Error> {
        if manifest.version.is_some() {
            CalibrationPlan::deserialize(&manifest.plan).map(Self::Calibration)
        } else {
            CapturePlan::deserialize(&manifest.plan).map(Self::Capture)
        }
    }

    /// The plan of a session.
    pub fn capture(&self) -> Option<&CapturePlan> {
        match self {
            Self::Capture(plan) => Some(plan),
            Self::Calibration(_) => None,
        }
    }

    /// The plan of a calibration.
    pub fn calibration(&self) -> Option<&CalibrationPlan> {
        match self {
            Self::Capture(_) => None,
            Self::Calibration(plan) => Some(plan),
        }
    }

    /// What can be asked of such a run at all.
    pub fn takes(&self, verb: Verb) -> bool {
        match self {
            Self::Capture(_) => verb != Verb::Shoot,
            Self::Calibration(_) => matches!(verb, Verb::Shoot | Verb::Abort),
        }
    }

    /// Light stations in all.
    pub fn stations(&self) -> usize {
        match self {
            Self::Capture(plan) => plan.stations.len(),
            Self::Calibration(plan) => plan.stations(),
        }
    }

    /// Arm angle of a station, degrees.
    pub fn angle_deg(&self, station: usize) -> f64 {
        match self {
            Self::Capture(plan) => plan.stations.get(station).map(|s| s.angle_deg),
            Self::Calibration(plan) => plan.station(station).map(|(_, angle)| angle),
        }
        .unwrap_or_default()
    }

    /// How the arm comes to a station, where that is what is measured.
    pub fn approach(&self, station: usize) -> Option<Approach> {
        self.calibration()?.approach(station)
    }

    /// The bracket of a station.
    pub fn exposures(&self, station: usize) -> &[PlannedExposure] {
        match self {
            Self::Capture(plan) => &plan.exposures,
            Self::Calibration(plan) => plan.station(station).map_or(&[], |(step, _)| &step.exposures),
        }
    }

    /// Frames in all.
    pub fn frames(&self) -> usize {
        match self {
            Self::Capture(plan) => plan.frames,
            Self::Calibration(plan) => plan.frames,
        }
    }

    /// Estimated duration, seconds.
    pub fn estimated_s(&self) -> f64 {
        match self {
            Self::Capture(plan) => plan.estimated_s,
            Self::Calibration(plan) => plan.estimated_s,
        }
    }
}
