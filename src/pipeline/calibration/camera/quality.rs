//! How sharp and how well exposed a found board is.

use super::grid::Grid;
use super::refine::sample;
use crate::numerics::image::Image;

/// Sharpness and exposure of a board in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Median width of the edges between squares, px: contrast over steepest slope.
    pub edge_px: f64,
    /// Median side of a square, px.
    pub square_px: f64,
    /// Mean level of the white squares' centres.
    pub white: f64,
    /// Mean level of the black ones.
    pub black: f64,
}

/// Measures a board of oriented corners.
pub(super) fn quality(grey: &Image<u8>, grid: &Grid) -> Quality {
    let mut widths = Vec::new();
    let mut sides = Vec::new();
    for (row, column) in (0..grid.rows).flat_map(|r| (0..grid.columns).map(move |c| (r, c))) {
        let here = grid.at(column, row);
        let right = (column + 1 < grid.columns).then(|| grid.at(column + 1, row));
        let below = (row + 1 < grid.rows).then(|| grid.at(column, row + 1));
        for there in [right, below].into_iter().flatten() {
            sides.push((there[0] - here[0]).hypot(there[1] - here[1]));
            widths.extend(edge_width(grey, here, there));
        }
    }
    let levels = grid.levels(grey);
    let (white, black) = (levels[0].max(levels[1]), levels[0].min(levels[1]));
    Quality { edge_px: median(&mut widths), square_px: median(&mut sides), white, black }
}

/// Median; infinite without values.
pub(super) fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::INFINITY)
}

/// Width of the edge between two corners, measured across its middle.
fn edge_width(grey: &Image<u8>, a: [f64; 2], b: [f64; 2]) -> Option<f64> {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let length = dx.hypot(dy);
    let across = [-dy / length, dx / length];
    let middle = [(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0];
    let reach = (0.4 * length) as i32;
    let profile: Option<Vec<f64>> = (-reach..=reach)
        .map(|i| sample(grey, [middle[0] + across[0] * f64::from(i), middle[1] + across[1] * f64::from(i)]))
        .collect();
    let profile = profile?;
    let contrast = (profile.first()? - profile.last()?).abs();
    let steepest = profile.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
    (steepest > 0.0).then(|| contrast / steepest)
}
