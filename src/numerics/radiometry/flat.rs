//! Flat field: what lens and sensor make of a uniform field, by pixel and channel.

use super::bracket::{Bracket, Exposure};
use super::merge::{CLIPPED_LEVEL, LOWEST_LEVEL};
use super::response::Response;
use crate::numerics::image::{Image, RadianceImage};

/// Share of pixels that may be clipped or dark in a frame; they become invalid.
const MOST_UNUSABLE: f64 = 0.01;

/// Why frames are no flat field.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FlatError {
    /// One frame says nothing of its own noise.
    #[error("{found} flat-field frame: at least 2 are needed, and 16 make their noise small")]
    TooFew {
        /// Frames given.
        found: usize,
    },
    /// A frame is too bright or too dark.
    #[error(
        "flat-field frame {name}: {percent:.1} % of its pixels are clipped or nearly black: expose it to the middle levels"
    )]
    Exposure {
        /// The frame.
        name: String,
        /// Share of its pixels, percent.
        percent: f64,
    },
}

/// Relative sensitivity of every pixel, 1 in the mean of each channel.
#[derive(Clone, Debug)]
pub struct Flat {
    gain: Image<[f32; 3]>,
    /// Squared relative standard error of the gain.
    relative_variance: Image<[f32; 3]>,
    usable: Image<bool>,
}

impl Flat {
    /// From two or more frames of a diffuse white field. Their brightness may differ, each is normalised by itself; the noise is
    /// what remains between them.
    ///
    /// # Errors
    /// Fewer than two frames, or one that is clipped or dark.
    pub fn new(frames: &Bracket, response: &Response) -> Result<Self, FlatError> {
        let count = frames.exposures().len();
        if count < 2 {
            return Err(FlatError::TooFew { found: count });
        }
        let (width, height) = (frames.width(), frames.height());
        let mut usable = Image::filled(width, height, true);
        for frame in frames.exposures() {
            let bad = |pixel: &[u8; 3]| pixel.iter().any(|z| !(LOWEST_LEVEL..CLIPPED_LEVEL).contains(z));
            let mut unusable = 0_usize;
            for (usable, pixel) in usable.pixels.iter_mut().zip(&frame.levels.pixels) {
                *usable &= !bad(pixel);
                unusable += usize::from(bad(pixel));
            }
            let share = unusable as f64 / usable.pixels.len() as f64;
            if share > MOST_UNUSABLE {
                return Err(FlatError::Exposure { name: frame.name.clone(), percent: 100.0 * share });
            }
        }
        let tables = frames.exposures().iter().map(|frame| std::array::from_fn(|c| relative(frame, response, c)));
        let tables: Vec<[[f64; 256]; 3]> = tables.collect();
        let n = count as f64;
        let at = |pixel: usize, c: usize| {
            let values =
                || frames.exposures().iter().zip(&tables).map(|(f, t)| t[c][usize::from(f.levels.pixels[pixel][c])]);
            let mean = values().sum::<f64>() / n;
            let scatter = values().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
            (mean as f32, (scatter / n / (mean * mean)) as f32)
        };
        let pixels = width * height;
        let image = |part: fn((f32, f32)) -> f32| Image {
            width,
            height,
            pixels: (0..pixels).map(|i| std::array::from_fn(|c| part(at(i, c)))).collect(),
        };
        Ok(Self { gain: image(|v| v.0), relative_variance: image(|v| v.1), usable })
    }

    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.gain.width, self.gain.height)
    }

    /// Divides rows `first_row` onwards by the gain; its noise goes to the variance.
    pub fn divide(&self, first_row: usize, strip: &mut RadianceImage) {
        let from = first_row * self.gain.width;
        for i in 0..strip.radiance.pixels.len().min(self.gain.pixels.len().saturating_sub(from)) {
            for c in 0..3 {
                let gain = self.gain.pixels[from + i][c];
                let radiance = strip.radiance.pixels[i][c] / gain;
                strip.radiance.pixels[i][c] = radiance;
                if let Some(variance) = &mut strip.variance {
                    let own = self.relative_variance.pixels[from + i][c];
                    variance.pixels[i][c] = variance.pixels[i][c] / (gain * gain) + radiance * radiance * own;
                }
            }
            strip.valid.pixels[i] &= self.usable.pixels[from + i];
        }
    }
}

/// Flat-field frames of linear radiance, added one after the other.
#[derive(Clone, Debug)]
pub struct Fields {
    count: usize,
    sum: Image<[f32; 3]>,
    squares: Image<[f32; 3]>,
    usable: Image<bool>,
}

impl Fields {
    /// None yet, of so many columns and rows.
    pub fn new(width: usize, height: usize) -> Self {
        let zero = Image::filled(width, height, [0.0; 3]);
        Self { count: 0, squares: zero.clone(), sum: zero, usable: Image::filled(width, height, true) }
    }

    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.sum.width, self.sum.height)
    }

    /// Adds the radiance of a frame, normalised by its own mean.
    ///
    /// # Errors
    /// Too much of it is clipped or dark.
    pub fn add(&mut self, name: &str, field: &RadianceImage) -> Result<(), FlatError> {
        let valid = field.valid.pixels.iter().filter(|valid| **valid).count();
        let share = 1.0 - valid as f64 / field.valid.pixels.len() as f64;
        if share > MOST_UNUSABLE {
            return Err(FlatError::Exposure { name: name.to_owned(), percent: 100.0 * share });
        }
        let lit = || field.radiance.pixels.iter().zip(&field.valid.pixels).filter(|(_, valid)| **valid);
        let mean: [f64; 3] =
            std::array::from_fn(|c| lit().map(|(pixel, _)| f64::from(pixel[c])).sum::<f64>() / valid as f64);
        for (i, pixel) in field.radiance.pixels.iter().enumerate() {
            self.usable.pixels[i] &= field.valid.pixels[i];
            for c in 0..3 {
                // About 1, so that squares do not swamp the scatter.
                let off = (f64::from(pixel[c]) / mean[c] - 1.0) as f32;
                self.sum.pixels[i][c] += off;
                self.squares.pixels[i][c] += off * off;
            }
        }
        self.count += 1;
        Ok(())
    }

    /// The flat field.
    ///
    /// # Errors
    /// Fewer than two frames.
    pub fn flat(self) -> Result<Flat, FlatError> {
        if self.count < 2 {
            return Err(FlatError::TooFew { found: self.count });
        }
        let (n, Self { mut sum, mut squares, usable, .. }) = (self.count as f32, self);
        for (sum, squares) in sum.pixels.as_flattened_mut().iter_mut().zip(squares.pixels.as_flattened_mut()) {
            let scatter = (*squares - *sum * *sum / n).max(0.0) / (n - 1.0);
            *sum = 1.0 + *sum / n;
            *squares = scatter / n / (*sum * *sum);
        }
        Ok(Flat { gain: sum, relative_variance: squares, usable })
    }
}

/// Exposure of every level over the mean exposure of the frame.
fn relative(frame: &Exposure, response: &Response, c: usize) -> [f64; 256] {
    let exposure: [f64; 256] = std::array::from_fn(|z| response.log_exposure[c][z].exp());
    let sum: f64 = frame.levels.pixels.iter().map(|pixel| exposure[usize::from(pixel[c])]).sum();
    let mean = sum / frame.levels.pixels.len() as f64;
    exposure.map(|e| e / mean)
}
