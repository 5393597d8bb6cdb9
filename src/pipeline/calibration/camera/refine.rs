//! Corners to subpixel: around a crossing every gradient is orthogonal to the line to the crossing (Foerstner & Guelch 1987;
//! OpenCV's cornerSubPix), solved by least squares in a window that moves with the solution.

use super::grid::Grid;
use crate::numerics::image::Image;

/// Half the window, in parts of the distance to the next corner: no other edge may come into it.
const WINDOW: f64 = 0.2;
/// Smallest and largest half window, px.
const HALF: (f64, f64) = (3.0, 30.0);
/// Most moves of the window; a sharp corner takes about five.
const MOVES: usize = 60;

/// The level at a place between pixel centres (which lie at integers); None outside the picture.
pub(super) fn sample(image: &Image<u8>, [x, y]: [f64; 2]) -> Option<f64> {
    let inside = |v: f64, size: usize| v >= 0.0 && v <= size as f64 - 1.0;
    if !inside(x, image.width) || !inside(y, image.height) {
        return None;
    }
    let (left, top) =
        ((x as usize).min(image.width.saturating_sub(2)), (y as usize).min(image.height.saturating_sub(2)));
    let (fx, fy) = (x - left as f64, y - top as f64);
    let level =
        |dx: usize, dy: usize| f64::from(*image.at((left + dx).min(image.width - 1), (top + dy).min(image.height - 1)));
    Some(
        (level(0, 0) * (1.0 - fx) + level(1, 0) * fx) * (1.0 - fy) + (level(0, 1) * (1.0 - fx) + level(1, 1) * fx) * fy,
    )
}

/// Refined corners, and how many were lost: those keep their place.
pub(super) fn refine(image: &Image<u8>, grid: &Grid) -> (Vec<[f64; 2]>, usize) {
    let mut lost = 0;
    let mut refined = Vec::with_capacity(grid.corners.len());
    for (i, &start) in grid.corners.iter().enumerate() {
        let half = (WINDOW * pitch(grid, i)).clamp(HALF.0, HALF.1).round();
        refined.push(crossing(image, start, half).unwrap_or_else(|| {
            lost += 1;
            start
        }));
    }
    (refined, lost)
}

/// Distance to the nearest neighbour in the grid, px.
fn pitch(grid: &Grid, i: usize) -> f64 {
    let (column, row) = (i % grid.columns, i / grid.columns);
    let here = grid.corners[i];
    let neighbours = [
        (column > 0).then(|| grid.at(column - 1, row)),
        (column + 1 < grid.columns).then(|| grid.at(column + 1, row)),
        (row > 0).then(|| grid.at(column, row - 1)),
        (row + 1 < grid.rows).then(|| grid.at(column, row + 1)),
    ];
    neighbours.iter().flatten().map(|n| (n[0] - here[0]).hypot(n[1] - here[1])).fold(f64::INFINITY, f64::min)
}

/// The crossing near `start`; None if there is none within half a window, or the window leaves the picture.
fn crossing(image: &Image<u8>, start: [f64; 2], half: f64) -> Option<[f64; 2]> {
    let mut at = start;
    for _ in 0..MOVES {
        let by = offset(image, at, half)?;
        at = [at[0] + by[0], at[1] + by[1]];
        let far = (at[0] - start[0]).hypot(at[1] - start[1]);
        if far.is_nan() || far > half.max(4.0) {
            return None;
        }
        if by[0].hypot(by[1]) < 1e-4 {
            return Some(at);
        }
    }
    // Hunting within a hundredth of a pixel between two windows is as good as found.
    let last = offset(image, at, half)?;
    (last[0].hypot(last[1]) < 1e-2).then_some(at)
}

/// From the window's centre to the point that the gradients in it agree on.
fn offset(image: &Image<u8>, [cx, cy]: [f64; 2], half: f64) -> Option<[f64; 2]> {
    let n = half as i32;
    let (mut xx, mut xy, mut yy, mut bx, mut by) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let level = |dx: i32, dy: i32| sample(image, [cx + f64::from(dx), cy + f64::from(dy)]);
    for dy in -n..=n {
        for dx in -n..=n {
            let (x, y) = (f64::from(dx), f64::from(dy));
            let weight = (-(x * x + y * y) / (half * half)).exp();
            let gx = 0.5 * (level(dx + 1, dy)? - level(dx - 1, dy)?);
            let gy = 0.5 * (level(dx, dy + 1)? - level(dx, dy - 1)?);
            xx += weight * gx * gx;
            xy += weight * gx * gy;
            yy += weight * gy * gy;
            bx += weight * (gx * gx * x + gx * gy * y);
            by += weight * (gx * gy * x + gy * gy * y);
        }
    }
    let determinant = xx * yy - xy * xy;
    // Both directions must have edges.
    (determinant > 1e-3 * (xx + yy).powi(2))
        .then(|| [(yy * bx - xy * by) / determinant, (xx * by - xy * bx) / determinant])
}
