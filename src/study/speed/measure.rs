//! One fit on one thread, with its processor time.

use super::{Measurement, Outcome, Photographs};
use crate::numerics::fit::Mixture;
use crate::numerics::fit::observations::Observations;
use crate::numerics::fit::quality::judge_left_out;
use crate::study::clock::{ClockError, OneThread};
use crate::study::method::{LOBE, Method};

/// Most lights of photographs left out in turn.
const MOST_LEFT_OUT: usize = 4;

/// A point counts when this many of the lights that are left see it.
const LEAST_SAMPLES: usize = 3;

/// Why nothing could be measured.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// No thread, or its clock cannot be read.
    #[error(transparent)]
    Clock(#[from] ClockError),
    /// A solver refuses the observations.
    #[error("{0}")]
    Refused(#[from] crate::numerics::fit::solver::Refusal),
    /// Leaving out this light leaves too little.
    #[error(
        "no point of the photographs is seen by {LEAST_SAMPLES} lights without light {0}: give a dataset with more lights"
    )]
    TooFewLights(usize),
}

/// The thread that fits.
pub struct Bench {
    thread: OneThread,
}

/// What a fit gave.
pub struct Fitted {
    pub mixture: Mixture,
    pub iterations: usize,
    pub cpu_s: f64,
}

/// Lights to leave out, one a fit, spread over all of them.
pub fn lights_to_leave_out(lights: usize) -> Vec<usize> {
    let count = lights.min(MOST_LEFT_OUT);
    (0..count).map(|i| (2 * i + 1) * lights / (2 * count)).collect()
}

impl Bench {
    pub fn new() -> Result<Self, MeasureError> {
        Ok(Self { thread: OneThread::new()? })
    }

    /// Fits and takes the time of the one thread that works.
    pub fn fit(&self, observations: &Observations, materials: usize, method: Method) -> Result<Fitted, MeasureError> {
        let (solution, cpu_s) = self.thread.time(|| method.solve(observations, materials))?;
        let solution = solution?;
        Ok(Fitted { mixture: solution.mixture, iterations: solution.iterations, cpu_s })
    }

    /// Fits photographs without one light and judges the fit on it.
    pub fn photographs(
        &self,
        photographs: &Photographs,
        method: Method,
        light: usize,
    ) -> Result<Measurement, MeasureError> {
        let all = &photographs.observations;
        let (rest, kept) = all.filtered(LEAST_SAMPLES, |l| l != light);
        if rest.points() == 0 {
            return Err(MeasureError::TooFewLights(light));
        }
        let fitted = self.fit(&rest, photographs.materials, method)?;
        let quality = judge_left_out(LOBE, &fitted.mixture, all, &kept, |l| l == light);
        Ok(Measurement {
            scene: photographs.name.clone(),
            method,
            scene_points: all.points(),
            seed: None,
            left_out: Some(light),
            cpu_s: fitted.cpu_s,
            iterations: fitted.iterations,
            outcome: Outcome::LeftOut(quality.filter(|q| q.mean_relative_error.is_finite())),
        })
    }
}
