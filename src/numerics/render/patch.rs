//! Which square of a weight map is its texture: the best measured one.
//!
//! A point far from the edge of what was measured faces the camera and was seen under many lights; near the edge the surface
//! turns away and a pixel covers much of it. So of all squares that are measured throughout, those farthest inside count,
//! and of these the one with the smallest mean squared standard error of its weights. No standard error counts as more than 1,
//! the largest weight.

use crate::numerics::image::Image;

/// A square of a weight map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patch {
    /// Left column.
    pub x: usize,
    /// Top row.
    pub y: usize,
    /// Pixels a side.
    pub side: usize,
}

/// Why a weight map has no such square.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no square of {wanted} x {wanted} pixels is measured throughout; the largest one has {largest}")]
pub struct PatchError {
    /// Side that was asked for, pixels.
    pub wanted: usize,
    /// Side of the largest square there is.
    pub largest: usize,
}

/// The best measured square of `side` pixels. A pixel is measured where a material has a weight or a standard error; `weights`
/// and `sigma` hold one image a material, all of one size.
///
/// # Errors
/// No square of that side is measured throughout.
pub fn best(weights: &[Image<f32>], sigma: &[Image<f32>], side: usize) -> Result<Patch, PatchError> {
    let size = weights.first().map_or((0, 0), |map| (map.width, map.height));
    let measured = |i: usize| weights.iter().chain(sigma).any(|map| map.pixels[i] > 0.0);
    let missing = &Sums::new(size, |i| if measured(i) { 0.0 } else { 1.0 });
    let squares = move |side: usize| {
        let columns = (size.0 + 1).saturating_sub(side);
        let rows = (size.1 + 1).saturating_sub(side);
        let all = (0..rows).flat_map(move |y| (0..columns).map(move |x| Patch { x, y, side }));
        all.filter(move |patch| missing.over(patch) == 0.0)
    };
    let largest = largest(size.0.min(size.1), |side| squares(side).next().is_some());
    // As much of the surroundings on every side as are measured somewhere.
    let Some(margin) = largest.checked_sub(side).map(|more| more / 2) else {
        return Err(PatchError { wanted: side, largest });
    };
    let variance = |i: usize| -> f64 { sigma.iter().map(|map| f64::from(map.pixels[i]).min(1.0).powi(2)).sum() };
    let variances = Sums::new(size, variance);
    let inner = |outer: Patch| Patch { x: outer.x + margin, y: outer.y + margin, side };
    let candidates = squares(side + 2 * margin).map(inner);
    let least = candidates.min_by(|a, b| variances.over(a).total_cmp(&variances.over(b)));
    least.ok_or(PatchError { wanted: side, largest })
}

/// The largest side up to `most` for which there is a square; a smaller square fits wherever a larger one does.
fn largest(most: usize, there_is: impl Fn(usize) -> bool) -> usize {
    let (mut there, mut not) = (0, most + 1);
    while not - there > 1 {
        let middle = there + (not - there) / 2;
        if there_is(middle) { there = middle } else { not = middle }
    }
    there
}

/// Sums of all values above and to the left of every pixel corner.
struct Sums {
    columns: usize,
    sums: Vec<f64>,
}

impl Sums {
    fn new((width, height): (usize, usize), value: impl Fn(usize) -> f64) -> Self {
        let columns = width + 1;
        let mut sums = vec![0.0; columns * (height + 1)];
        for y in 0..height {
            let mut row = 0.0;
            for x in 0..width {
                row += value(y * width + x);
                sums[(y + 1) * columns + x + 1] = sums[y * columns + x + 1] + row;
            }
        }
        Self { columns, sums }
    }

    /// The sum over a square.
    fn over(&self, &Patch { x, y, side }: &Patch) -> f64 {
        let at = |x: usize, y: usize| self.sums[y * self.columns + x];
        at(x + side, y + side) - at(x, y + side) - at(x + side, y) + at(x, y)
    }
}
