//! The object as the camera saw it, thinned out for a screen: of the part of a frame that was measured every so many-th pixel,
//! with its place, its normal and all that a fit found there. No pixel is a mean of others, so each can be shaded as it was fitted.

use super::dataset::Geometry;
use crate::numerics::geometry::Vec3;
use crate::numerics::image::Image;

/// Pixels of a frame: every `step`-th column and row of a part of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column and row.
    pub origin: (usize, usize),
    /// Columns, and rows, from one pixel to the next.
    pub step: usize,
    /// Columns and rows that are shown.
    pub size: (usize, usize),
}

impl Window {
    /// The part of a frame in which a material has a weight or a standard error, in at most `most` columns and rows; none where
    /// nothing was measured. `weights` and `sigma` hold one image a material, all of one size.
    pub fn of(weights: &[Image<f32>], sigma: &[Image<f32>], most: usize) -> Option<Self> {
        let frame = weights.first()?;
        let measured = |&(x, y): &(usize, usize)| weights.iter().chain(sigma).any(|map| *map.at(x, y) > 0.0);
        let pixels = (0..frame.height).flat_map(|y| (0..frame.width).map(move |x| (x, y)));
        let (low, high) = pixels.filter(measured).fold(((usize::MAX, usize::MAX), (0, 0)), |(low, high), (x, y)| {
            ((low.0.min(x), low.1.min(y)), (high.0.max(x + 1), high.1.max(y + 1)))
        });
        let (columns, rows) = (high.0.checked_sub(low.0)?, high.1.checked_sub(low.1)?);
        let step = columns.max(rows).div_ceil(most.max(1));
        Some(Self { origin: low, step, size: (columns.div_ceil(step), rows.div_ceil(step)) })
    }

    /// Column and row of every pixel, row by row.
    pub fn pixels(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let Self { origin, step, size } = *self;
        (0..size.1).flat_map(move |j| (0..size.0).map(move |i| (origin.0 + i * step, origin.1 + j * step)))
    }

    /// These pixels of a plane as wide as the frame.
    pub fn of_plane<'a>(&self, width: usize, pixels: &'a [f32]) -> impl Iterator<Item = f32> + use<'a> {
        self.pixels().map(move |(x, y)| pixels[y * width + x])
    }
}

/// Where the surface is, and how it stands, at these pixels: position (mm), outward normal and direction towards the camera in the
/// camera's frame, a plane a component; zero beside the object.
pub fn planes(window: &Window, geometry: &Geometry) -> Vec<(String, Vec<f32>)> {
    let names = ["position", "normal", "view"];
    let mut planes: Vec<(String, Vec<f32>)> =
        names.iter().flat_map(|name| ["X", "Y", "Z"].map(|axis| (format!("{name}.{axis}"), Vec::new()))).collect();
    for (x, y) in window.pixels() {
        let ray = geometry.projection.ray(x as f64 + 0.5, y as f64 + 0.5);
        let point = geometry.object.at(x, y, &ray);
        let vectors = point.map_or([Vec3::zeros(); 3], |point| [point.position, point.normal, point.view]);
        for (plane, value) in planes.iter_mut().zip(vectors.iter().flat_map(|v| v.iter())) {
            plane.1.push(*value as f32);
        }
    }
    planes
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_window_holds_what_was_measured_and_no_more_than_asked_for() {
        let mut weights = Image::filled(40, 30, 0.0_f32);
        let mut sigma = weights.clone();
        assert_eq!(Window::of(&[weights.clone()], &[sigma.clone()], 512), None);
        weights.pixels[5 * 40 + 7] = 0.5;
        sigma.pixels[20 * 40 + 30] = f32::INFINITY;
        let maps = ([weights], [sigma]);
        let whole = Window::of(&maps.0, &maps.1, 512).unwrap();
        assert_eq!(whole, Window { origin: (7, 5), step: 1, size: (24, 16) });
        assert_eq!(whole.pixels().last(), Some((30, 20)));
        let thin = Window::of(&maps.0, &maps.1, 10).unwrap();
        assert_eq!(thin, Window { origin: (7, 5), step: 3, size: (8, 6) });
        assert_eq!(thin.of_plane(40, &maps.0[0].pixels).next(), Some(0.5));
        assert!(thin.pixels().all(|(x, y)| x <= 30 && y <= 20));
    }
}
