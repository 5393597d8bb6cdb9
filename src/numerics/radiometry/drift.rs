//! Lamp drift: a patch that is in every picture says how bright the lamp was.

use crate::numerics::image::RadianceImage;

/// Pixels a patch needs.
const MIN_PIXELS: usize = 100;

/// A lamp darker or brighter than this is another lamp, or another patch.
const LEAST_DRIFT: f64 = 0.5;
const MOST_DRIFT: f64 = 2.0;

/// A rectangle of pixels that shows a uniform, fixed piece of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patch {
    /// Left column.
    pub x: usize,
    /// Top row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// Why a patch says nothing of the lamp.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PatchError {
    /// It is not in the picture.
    #[error(
        "the reference patch {width}x{height} at ({x}, {y}) does not lie inside the {columns}x{rows} pixels: correct it"
    )]
    Outside {
        /// Its left column.
        x: usize,
        /// Its top row.
        y: usize,
        /// Its columns.
        width: usize,
        /// Its rows.
        height: usize,
        /// Columns of the picture.
        columns: usize,
        /// Rows of the picture.
        rows: usize,
    },
    /// The lamp would be off by more than a lamp can be.
    #[error(
        "by the reference patch the lamp is at {of_reference:.3e} of its brightness, outside {LEAST_DRIFT} to {MOST_DRIFT}: correct its place or \
         its radiance"
    )]
    NoLamp {
        /// Brightness of the worst channel, relative to the reference.
        of_reference: f64,
    },
    /// Too little of it is valid.
    #[error(
        "{valid} valid pixels in the reference patch: it needs at least {MIN_PIXELS}, and at least half of all it holds; make it larger, or \
         choose a place that is lit and not clipped in every picture"
    )]
    TooFew {
        /// Valid pixels.
        valid: usize,
    },
}

/// Mean radiance of a patch, and the squared relative standard error of it, by channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchMean {
    /// Mean radiance.
    pub radiance: [f64; 3],
    /// Squared relative standard error, from the scatter of the pixels.
    pub relative_variance: [f64; 3],
}

impl Patch {
    /// What an image shows there.
    ///
    /// # Errors
    /// The patch is outside the image or mostly invalid.
    pub fn mean(&self, image: &RadianceImage) -> Result<PatchMean, PatchError> {
        let (columns, rows) = (image.radiance.width, image.radiance.height);
        let Self { x, y, width, height } = *self;
        if x.saturating_add(width) > columns || y.saturating_add(height) > rows {
            return Err(PatchError::Outside { x, y, width, height, columns, rows });
        }
        let inside = (y..y + height).flat_map(|row| (x..x + width).map(move |column| row * columns + column));
        let values: Vec<[f32; 3]> =
            inside.filter(|&i| image.valid.pixels[i]).map(|i| image.radiance.pixels[i]).collect();
        if values.len() < MIN_PIXELS || 2 * values.len() < width * height {
            return Err(PatchError::TooFew { valid: values.len() });
        }
        let n = values.len() as f64;
        let mean = |c: usize| values.iter().map(|v| f64::from(v[c])).sum::<f64>() / n;
        let radiance: [f64; 3] = std::array::from_fn(mean);
        let scatter = |c: usize| values.iter().map(|v| (f64::from(v[c]) - radiance[c]).powi(2)).sum::<f64>();
        let relative_variance = std::array::from_fn(|c| scatter(c) / (n * (n - 1.0)) / radiance[c].powi(2));
        Ok(PatchMean { radiance, relative_variance })
    }
}

impl PatchMean {
    /// The lamp's brightness relative to when the patch had radiance `reference`, by channel.
    pub fn drift(&self, reference: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|c| self.radiance[c] / reference[c])
    }

    /// Refuses a drift that no lamp has.
    ///
    /// # Errors
    /// [`PatchError::NoLamp`] beyond a factor of two in any channel.
    pub fn check(&self, reference: [f64; 3]) -> Result<(), PatchError> {
        let odd = self.drift(reference).into_iter().find(|drift| !(LEAST_DRIFT..=MOST_DRIFT).contains(drift));
        odd.map_or(Ok(()), |of_reference| Err(PatchError::NoLamp { of_reference }))
    }

    /// Brings an image to the brightness at which the patch has radiance `reference`; the error of the mean goes to the variance.
    pub fn normalise(&self, reference: [f64; 3], image: &mut RadianceImage) {
        let drift = self.drift(reference);
        for i in 0..image.radiance.pixels.len() {
            for c in 0..3 {
                let radiance = f64::from(image.radiance.pixels[i][c]) / drift[c];
                image.radiance.pixels[i][c] = radiance as f32;
                if let Some(variance) = &mut image.variance {
                    let value = f64::from(variance.pixels[i][c]) / drift[c].powi(2);
                    variance.pixels[i][c] = (value + radiance * radiance * self.relative_variance[c]) as f32;
                }
            }
        }
    }
}
