//! What a fit tells while it goes on. Whoever listens changes nothing of it but when it ends.

use super::fit::FitError;
use super::report::MaterialReport;
use crate::numerics::brdf::Material;
use crate::numerics::fit::observations::Observations;
use crate::numerics::fit::predict;
use crate::numerics::fit::selection::Candidate;
use crate::numerics::fit::solver::{Iterate, Task};
use crate::numerics::fit::varpro::{recipe, stream_weights};
use std::ops::ControlFlow;

/// Points a residual map is made of at most: it shall cost less than a step of the fit it shows.
const POINTS: usize = 8192;
/// Cells of its longer side: a handful of those points in each.
const CELLS: usize = 40;

/// A step of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FitStep {
    /// The dataset is read; told by who reads it.
    Load,
    /// Samples are gathered from the images.
    Observe,
    /// Left-out lights choose number of materials, model, lobe and gains.
    Choose,
    /// The solver works.
    Fit,
    /// Standard errors, and how good the fit is.
    Uncertainty,
}

/// Makes a residual map of the state that is told, in an image of this width; none where there is no point.
pub type MapIt<'a> = &'a dyn Fn(usize) -> Option<ResidualMap>;

/// Something a fit tells.
pub enum FitProgress<'a> {
    /// A step begins.
    Step(FitStep),
    /// Samples were gathered.
    Observed {
        /// Points of the object.
        points: usize,
        /// Samples of them.
        samples: usize,
        /// Width of the image, pixels.
        width: usize,
    },
    /// A combination was judged by left-out lights; true when it is the best so far.
    Tried(&'a Candidate, bool),
    /// The solver has done an iteration.
    Iteration(Iterate<'a>, MapIt<'a>),
    /// The materials as the report has them, with standard errors.
    Judged(&'a [MaterialReport], MapIt<'a>),
}

/// Callback for progress and cancelling.
pub type OnProgress<'a> = &'a mut (dyn FnMut(FitProgress<'_>) -> ControlFlow<()> + Send);

/// Tells it.
///
/// # Errors
/// [`FitError::Cancelled`] when who listens breaks off.
pub(super) fn tell(progress: OnProgress<'_>, what: FitProgress<'_>) -> Result<(), FitError> {
    if progress(what).is_break() { Err(FitError::Cancelled) } else { Ok(()) }
}

/// Mean relative error |I - model| / I over samples and channels, by cells of the object's bounding box.
#[derive(Clone, Debug, PartialEq)]
pub struct ResidualMap {
    /// Cells in a row.
    pub columns: usize,
    /// Row after row from the top left; none where the object has no point.
    pub cells: Vec<Option<f64>>,
}

/// The map that `materials` leave, with the weights that are best for them.
pub(super) fn residual_map(
    observations: &Observations,
    task: &Task,
    materials: &[Material],
    width: usize,
) -> Option<ResidualMap> {
    let some = observations.subset(POINTS);
    let places = || some.pixel.iter().map(|&pixel| [pixel % width.max(1), pixel / width.max(1)]);
    let edge = |axis: usize| Some((places().map(|p| p[axis]).min()?, places().map(|p| p[axis]).max()?));
    let ((left, right), (top, bottom)) = (edge(0)?, edge(1)?);
    let size = [right - left + 1, bottom - top + 1];
    let cell = size[0].max(size[1]).div_ceil(CELLS);
    let (columns, rows) = (size[0].div_ceil(cell), size[1].div_ceil(cell));
    let gamma = stream_weights(&some, &recipe(task, &some), materials).0;
    let mut sums = vec![(0.0, 0.0); columns * rows];
    for (point, [x, y]) in places().enumerate() {
        let weights = &gamma[point * materials.len()..(point + 1) * materials.len()];
        let sum = &mut sums[(y - top) / cell * columns + (x - left) / cell];
        for sample in some.of(point) {
            let model = predict(task.lobe, materials, weights, &sample);
            sum.0 += (0..3).map(|c| (sample.radiance[c] - model[c]).abs() / sample.radiance[c]).sum::<f64>();
            sum.1 += 3.0;
        }
    }
    let cells = sums.into_iter().map(|(error, count)| (count > 0.0).then(|| error / count)).collect();
    Some(ResidualMap { columns, cells })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::numerics::fit::objective::Objective;
    use crate::numerics::fit::observations::Sample;
    use crate::numerics::fit::observations::tests::synthetic;
    use crate::numerics::fit::solver::tests::task;

    /// A map is shown with four decimals. Weights are solved in f32: of exact data they leave up to some 1e-5.
    const SHOWN: f64 = 1e-4;

    /// Points as they are numbered: an image of one row. A quarter of it measured 4 % above the model under every second light,
    /// and the weights cannot follow both: the map shows where, and nothing elsewhere.
    #[test]
    fn a_map_shows_where_the_error_is() {
        let (clean, mixture) = synthetic(400, 2, 21);
        let odd = |point: usize, sample: Sample| {
            let off = if point < 100 && sample.light.is_multiple_of(2) { 1.04 } else { 1.0 };
            Some(Sample { radiance: sample.radiance.map(|i| off * i), ..sample })
        };
        let (observations, _) = clean.changed(1, odd);
        let map = residual_map(&observations, &task(2, Objective::RELATIVE), &mixture.materials, 400).unwrap();
        assert_eq!((map.columns, map.cells.len()), (40, 40));
        for (index, cell) in map.cells.iter().enumerate() {
            let error = cell.unwrap();
            assert!(if index < 10 { (0.005..0.04).contains(&error) } else { error < SHOWN }, "{index}: {error}");
        }
        assert_eq!(
            residual_map(&observations.select(&[]), &task(2, Objective::RELATIVE), &mixture.materials, 400),
            None
        );
    }
}
