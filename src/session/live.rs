//! The fit that goes on, as whoever watches sees it: in memory only, told to watchers and journalled by nobody.

use super::book::Book;
use crate::numerics::fit::solver::Iterate;
use crate::pipeline::fit::{FitProgress, FitStep};
use crate::pipeline::progress::{MapIt, ResidualMap};
use crate::pipeline::report::{MaterialReport, Parameter};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::sync::Arc;
use std::time::Duration;
use utoipa::ToSchema;

/// Iterations that are kept: of more, every second one goes.
const ITERATIONS: usize = 400;
/// Candidates that are kept: no choice has as many.
const TRIED: usize = 64;
/// Least time between two updates of one step: a chart that moves ten times a second moves smoothly.
const UPDATE_EVERY: Duration = Duration::from_millis(100);
/// Least time between two residual maps: each costs about a step of the fit.
const MAP_EVERY: Duration = Duration::from_millis(500);

/// A step of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LiveStep {
    /// The dataset is read.
    Load,
    /// Samples are gathered.
    Observe,
    /// Left-out lights choose number of materials, model, lobe and gains.
    Choose,
    /// The solver works.
    Fit,
    /// Standard errors.
    Uncertainty,
}

/// A combination that left-out lights have judged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LiveCandidate {
    /// Number of materials.
    pub materials: usize,
    /// BRDF model.
    pub model: String,
    /// Colour of the lobe.
    pub lobe: String,
    /// True where a gain was fitted for each light.
    pub light_gains: bool,
    /// Mean relative error on left-out lights; null where no light can be left out.
    pub left_out_relative_error: Option<f64>,
    /// True where it was the best when it was judged: the last of them is taken.
    pub best: bool,
    /// Why it was refused, if so.
    pub reason: String,
}

/// An iteration of the solver.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LiveIteration {
    /// Its number.
    pub iteration: usize,
    /// Cost of the objective over the points in use.
    pub cost: f64,
    /// Root mean square residual in the units of the objective: comparable where `points` changes.
    pub error: f64,
    /// Points in use: a search begins with a few of them.
    pub points: usize,
}

/// A BRDF parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LiveParameter {
    /// Its value; of one that the data do not determine it only completes the model.
    pub value: f64,
    /// Its standard error; null before the step `uncertainty` has ended, and where there is none.
    pub standard_error: Option<f64>,
    /// `identified`, `weak` or `unidentified`; null before the step `uncertainty` has ended.
    pub identified: Option<String>,
}

/// A material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LiveMaterial {
    /// Diffuse albedo red, green, blue.
    pub rho_d: Vec<LiveParameter>,
    /// Specular albedo red, green, blue; empty for a model without a lobe.
    pub rho_s: Vec<LiveParameter>,
    /// Roughness; null for a model without a lobe.
    pub beta: Option<LiveParameter>,
}

/// Mean relative error by cells of the object's bounding box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LiveMap {
    /// Cells in a row.
    pub columns: usize,
    /// Row after row from the top left; null where the object has no point.
    pub cells: Vec<Option<f64>>,
}

/// The last fit of this daemon, of the session it belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LiveFit {
    /// The session.
    pub session: String,
    /// Grows with every update, over all fits.
    pub revision: u64,
    /// True while it goes on.
    pub running: bool,
    /// When this update was made, RFC 3339.
    pub time: String,
    /// The step that goes on, or that was the last.
    pub step: LiveStep,
    /// Points of the object, once they are gathered.
    pub points: usize,
    /// Samples of them.
    pub samples: usize,
    /// What was tried, in order.
    pub candidates: Vec<LiveCandidate>,
    /// The solver's iterations, oldest first; of a long fit not all of them.
    pub iterations: Vec<LiveIteration>,
    /// The materials so far; in normal form and with standard errors once the fit has ended.
    pub materials: Vec<LiveMaterial>,
    /// Where the error is; null before the first map.
    pub residual_map: Option<LiveMap>,
    /// Why it failed, if so.
    pub error: Option<String>,
}

impl LiveFit {
    fn begin(session: &str, revision: u64) -> Self {
        Self {
            session: session.to_owned(),
            revision,
            running: true,
            time: String::new(),
            step: LiveStep::Load,
            points: 0,
            samples: 0,
            candidates: Vec::new(),
            iterations: Vec::new(),
            materials: Vec::new(),
            residual_map: None,
            error: None,
        }
    }

    fn iterated(&mut self, at: &Iterate<'_>) {
        let now = LiveIteration { iteration: at.iteration, cost: at.cost, error: at.rms, points: at.points };
        self.iterations.push(now);
        if self.iterations.len() > ITERATIONS {
            let mut index = 0;
            // The newest one stays.
            self.iterations.retain(|_| {
                index += 1;
                index % 2 == 1
            });
        }
        let bare = |value: f64| LiveParameter { value, standard_error: None, identified: None };
        self.materials = at
            .materials
            .iter()
            .map(|m| LiveMaterial {
                rho_d: m.rho_d.map(bare).to_vec(),
                rho_s: m.rho_s.map(bare).to_vec(),
                beta: Some(bare(m.beta)),
            })
            .collect();
    }

    fn take(&mut self, event: &FitProgress<'_>) {
        match event {
            FitProgress::Step(step) => self.step = LiveStep::from(*step),
            FitProgress::Observed { points, samples, .. } => (self.points, self.samples) = (*points, *samples),
            FitProgress::Tried(candidate, best) if self.candidates.len() < TRIED => {
                self.candidates.push(LiveCandidate {
                    materials: candidate.materials,
                    model: candidate.lobe.name().to_owned(),
                    lobe: candidate.colour.name().to_owned(),
                    light_gains: candidate.gains.is_some(),
                    left_out_relative_error: candidate.left_out.map(|errors| errors.overall),
                    best: *best,
                    reason: candidate.reason.clone(),
                });
            }
            FitProgress::Tried(..) => {}
            FitProgress::Iteration(at, _) => self.iterated(at),
            FitProgress::Judged(materials, _) => self.materials = materials.iter().map(LiveMaterial::from).collect(),
        }
    }
}

impl From<FitStep> for LiveStep {
    fn from(step: FitStep) -> Self {
        match step {
            FitStep::Load => Self::Load,
            FitStep::Observe => Self::Observe,
            FitStep::Choose => Self::Choose,
            FitStep::Fit => Self::Fit,
            FitStep::Uncertainty => Self::Uncertainty,
        }
    }
}

impl From<&MaterialReport> for LiveMaterial {
    fn from(material: &MaterialReport) -> Self {
        let parameter = |p: &Parameter| LiveParameter {
            value: p.value,
            standard_error: p.standard_error,
            identified: serde_json::to_value(p.identified).ok().and_then(|name| name.as_str().map(str::to_owned)),
        };
        let channels = |list: &[Parameter]| list.iter().map(parameter).collect();
        Self {
            rho_d: channels(&material.rho_d),
            rho_s: channels(&material.rho_s),
            beta: material.beta.as_ref().map(parameter),
        }
    }
}

impl From<ResidualMap> for LiveMap {
    /// With four decimals: nobody sees more.
    fn from(map: ResidualMap) -> Self {
        let round = |error: f64| (error * 1e4).round() / 1e4;
        Self { columns: map.columns, cells: map.cells.into_iter().map(|cell| cell.map(round)).collect() }
    }
}

/// Keeps the book's [`LiveFit`] up to date with one fit.
pub(super) struct Observer {
    book: Arc<Book>,
    width: usize,
    told: Duration,
    mapped: Option<Duration>,
}

impl Observer {
    /// A fit of `session` begins; what is known of the last one goes.
    pub(super) fn begin(book: &Arc<Book>, session: &str) -> Self {
        {
            let mut inner = book.lock();
            let revision = inner.live.as_ref().map_or(0, |live| live.revision);
            inner.live = Some(LiveFit::begin(session, revision));
        }
        let observer = Self { book: Arc::clone(book), width: 0, told: book.clock.elapsed(), mapped: None };
        observer.publish();
        observer
    }

    /// Takes something of the fit into account. Watchers hear of a step, and of the end, at once, of the rest ten times a second.
    pub(super) fn take(&mut self, event: &FitProgress<'_>) {
        if let FitProgress::Observed { width, .. } = event {
            self.width = *width;
        }
        let (now, at_once) =
            (self.book.clock.elapsed(), matches!(event, FitProgress::Step(_) | FitProgress::Judged(..)));
        let map = self.map(event, now);
        if let Some(live) = &mut self.book.lock().live {
            live.take(event);
            live.residual_map = map.map(LiveMap::from).or(live.residual_map.take());
        }
        if at_once || now.saturating_sub(self.told) >= UPDATE_EVERY {
            self.told = now;
            self.publish();
        }
    }

    /// Without the book's lock: it takes milliseconds.
    fn map(&mut self, event: &FitProgress<'_>, now: Duration) -> Option<ResidualMap> {
        let map_it: MapIt<'_> = match event {
            FitProgress::Iteration(_, map_it) if self.mapped.is_none_or(|at| now.saturating_sub(at) >= MAP_EVERY) => {
                map_it
            }
            FitProgress::Judged(_, map_it) => map_it,
            _ => return None,
        };
        self.mapped = Some(now);
        map_it(self.width)
    }

    /// The fit has ended.
    pub(super) fn end(self, result: &Result<Value, String>) {
        if let Some(live) = &mut self.book.lock().live {
            live.running = false;
            live.error = result.as_ref().err().cloned();
        }
        self.publish();
    }

    fn publish(&self) {
        if let Some(live) = &mut self.book.lock().live {
            live.revision += 1;
            live.time = self.book.clock.now().to_string();
        }
        self.book.show();
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// However long a fit, what is kept of it is bounded, in order, and ends with the newest.
    #[test]
    fn a_long_fit_is_thinned() {
        let mut live = LiveFit::begin("one", 3);
        for iteration in 1..=100_000 {
            live.iterated(&Iterate { iteration, cost: 1.0, rms: 1.0, points: 1, materials: &[] });
            assert!(live.iterations.len() <= ITERATIONS);
            assert_eq!(live.iterations.last().unwrap().iteration, iteration);
        }
        assert!(live.iterations.len() > ITERATIONS / 2);
        assert!(live.iterations.windows(2).all(|pair| pair[0].iteration < pair[1].iteration));
    }
}
