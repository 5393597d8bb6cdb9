//! The weight map as a texture (paper 3.7): a square of weights, all materials together, that goes on at its edges.

use super::patch::{self, Patch, PatchError};
use super::seam;
use crate::numerics::fit::MAX_MATERIALS;
use crate::numerics::image::Image;

/// Weights of a point, in the order of the materials; zero beyond their number.
pub type Weights = [f64; MAX_MATERIALS];

/// Texels of a grid, row by row, each with the weights of all materials.
#[derive(Clone, Debug, PartialEq)]
pub struct Texels {
    /// Columns and rows.
    pub size: (usize, usize),
    /// The weights.
    pub weights: Vec<[f32; MAX_MATERIALS]>,
}

impl Texels {
    /// The texel at column `x`, row `y`.
    pub fn at(&self, x: usize, y: usize) -> &[f32; MAX_MATERIALS] {
        &self.weights[y * self.size.0 + x]
    }

    /// Columns become rows.
    pub(super) fn transposed(&self) -> Self {
        let (width, height) = self.size;
        let weights = (0..width * height).map(|i| *self.at(i / height, i % height)).collect();
        Self { size: (height, width), weights }
    }
}

/// A square texture that repeats without a seam.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    texels: Texels,
}

impl Tile {
    /// The best measured square of `side` texels of a weight map, made to repeat ([`patch::best`], `seam::closed`).
    /// `weights` and `sigma`, their standard errors, hold one image a material.
    ///
    /// # Errors
    /// No square of that side, with what its seams need, is measured throughout.
    pub fn cut(weights: &[Image<f32>], sigma: &[Image<f32>], side: usize) -> Result<(Self, Patch), PatchError> {
        let patch = patch::best(weights, sigma, side + seam::overlap(side))?;
        let texel = |i: usize| {
            let (x, y) = (patch.x + i % patch.side, patch.y + i / patch.side);
            std::array::from_fn(|m| weights.get(m).map_or(0.0, |map| *map.at(x, y)))
        };
        let weights = (0..patch.side * patch.side).map(texel).collect();
        Ok((Self::of(&Texels { size: (patch.side, patch.side), weights }, side), patch))
    }

    /// The texture of `side` texels out of a square that is wider and higher by [`seam::overlap`].
    pub fn of(texels: &Texels, side: usize) -> Self {
        Self { texels: seam::closed(texels, side) }
    }

    /// A texture that repeats without a seam already, of as many columns as rows.
    pub fn seamless(texels: Texels) -> Self {
        Self { texels }
    }

    /// Its texels.
    pub fn texels(&self) -> &Texels {
        &self.texels
    }

    /// Weights at texture coordinates, of which 0 to 1 is the tile, u to the right and v down; linear between the texels'
    /// middles.
    pub fn at(&self, u: f64, v: f64) -> Weights {
        let corners = neighbours(self.texels.size.0, u, v);
        std::array::from_fn(|m| corners.iter().map(|&(i, part)| part * f64::from(self.texels.weights[i][m])).sum())
    }
}

/// The four texels between whose middles a place of a texture of `side` texels lies, counted row by row, and the part of each
/// in what is linear between them. The texture repeats; 0 to 1 is the tile, u to the right and v down.
pub fn neighbours(side: usize, u: f64, v: f64) -> [(usize, f64); 4] {
    let place = |t: f64| {
        let t = t.rem_euclid(1.0) * side as f64 + (side as f64 - 0.5);
        let below = t.floor();
        (below as usize % side, (below as usize + 1) % side, t - below)
    };
    let ((left, right, x), (top, bottom, y)) = (place(u), place(v));
    let at = |x: usize, y: usize| y * side + x;
    [
        (at(left, top), (1.0 - x) * (1.0 - y)),
        (at(right, top), x * (1.0 - y)),
        (at(left, bottom), (1.0 - x) * y),
        (at(right, bottom), x * y),
    ]
}
