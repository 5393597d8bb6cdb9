//! What is done to merged rows before they are written, whatever frames they come from: dark signal, flat field, lamp.

use super::list::Reference;
use crate::numerics::image::RadianceImage;
use crate::numerics::radiometry::bracket::Bracket;
use crate::numerics::radiometry::dark::Dark;
use crate::numerics::radiometry::drift::{PatchError, PatchMean};
use crate::numerics::radiometry::flat::Flat;
use crate::store::exr::{ExrError, Place, write_strips};
use std::path::Path;

/// Rows merged and written at a time.
const STRIP_ROWS: usize = 16;

/// Corrections of a merge.
#[derive(Default)]
pub(super) struct Corrections {
    pub dark: Option<Dark>,
    pub flat: Option<Flat>,
    pub reference: Option<Reference>,
}

impl Corrections {
    /// What a person wants to know of them, a line each.
    pub fn summary(&self) -> String {
        let Some(dark) = &self.dark else { return String::new() };
        format!("dark frames: {} hot pixels left out\n", dark.hot_pixels())
    }
}

/// Light in a frame that should be dark: this level of 255, from which the camera has taken the common dark signal off, or this
/// share of saturation in a linear one, where half a minute on a warm sensor glows by several percent; in a larger share of the
/// pixels than are ever hot.
const LIT_LEVEL: u8 = 32;
const LIT_SIGNAL: f32 = 0.1;
const LIT_SHARE: f64 = 0.01;

/// Refuses dark frames that show light.
///
/// # Errors
/// Which, how much of it, and what to do.
pub(super) fn check_dark(frames: &Bracket) -> Result<(), String> {
    frames.exposures().iter().try_for_each(|frame| {
        let lit = frame.levels.pixels.iter().filter(|pixel| pixel.iter().any(|&level| level >= LIT_LEVEL)).count();
        refuse_lit(&frame.name, lit, frame.levels.pixels.len())
    })
}

/// The same of dark frames `names` as merged, radiance 1 saturating in a second; `longest_s` is the longest of their times, seconds.
///
/// # Errors
/// As [`check_dark`].
pub(super) fn check_dark_radiance(names: &str, dark: &RadianceImage, longest_s: f64) -> Result<(), String> {
    let lit = dark.radiance.pixels.iter().filter(|rate| rate.iter().any(|&rate| rate * longest_s as f32 >= LIT_SIGNAL));
    refuse_lit(names, lit.count(), dark.radiance.pixels.len())
}

fn refuse_lit(name: &str, lit: usize, pixels: usize) -> Result<(), String> {
    let share = lit as f64 / pixels.max(1) as f64;
    if share <= LIT_SHARE {
        return Ok(());
    }
    Err(format!(
        "{name} is listed as a dark frame, but {:.0} % of it show light: put the lens cap on, switch lamp and room light off, close the \
         enclosure and shoot it again, or leave it out",
        100.0 * share
    ))
}

/// Merges rows from one on into a strip.
pub(super) type Merge<'a> = &'a dyn Fn(usize, &mut RadianceImage);

/// A merge with its corrections, ready to give any rows.
pub(super) struct Rows<'a> {
    corrections: &'a Corrections,
    merge: Merge<'a>,
    /// Width and height.
    size: (usize, usize),
    /// The reference patch as merged, and its radiance as it should be.
    lamp: Option<(PatchMean, [f64; 3])>,
}

impl<'a> Rows<'a> {
    /// Looks at the reference patch, if there is one.
    ///
    /// # Errors
    /// It says nothing of the lamp.
    pub fn new(
        corrections: &'a Corrections,
        merge: Merge<'a>,
        (width, height): (usize, usize),
    ) -> Result<Self, PatchError> {
        let mut rows = Self { corrections, merge, size: (width, height), lamp: None };
        if let Some(Reference { patch, radiance }) = &corrections.reference {
            // The patch needs its own rows alone, but in one piece.
            let end = patch.y.saturating_add(patch.height).min(height);
            let mut top = RadianceImage::empty(width, end);
            rows.strip(0, &mut top);
            let seen = patch.mean(&top)?;
            seen.check(*radiance)?;
            rows.lamp = Some((seen, *radiance));
        }
        Ok(rows)
    }

    /// All rows.
    pub fn whole(&self) -> RadianceImage {
        let mut image = RadianceImage::empty(self.size.0, self.size.1);
        self.strip(0, &mut image);
        image
    }

    fn strip(&self, first: usize, strip: &mut RadianceImage) {
        (self.merge)(first, strip);
        if let Some(dark) = &self.corrections.dark {
            dark.subtract(first, strip);
        }
        if let Some(flat) = &self.corrections.flat {
            flat.divide(first, strip);
        }
        if let Some((seen, reference)) = &self.lamp {
            seen.normalise(*reference, strip);
        }
    }

    /// Writes all rows; gives the share of the pixels that are valid.
    pub fn write(&self, out: &Path, attributes: &[(&str, String)]) -> Result<f64, ExrError> {
        let (width, height) = self.size;
        let (mut strip, mut valid) = (RadianceImage::empty(width, STRIP_ROWS), 0);
        let place = Place { origin: (0, 0), full: self.size, size: self.size };
        write_strips(out, place, attributes, &mut strip, |first, strip| {
            self.strip(first, strip);
            let inside = STRIP_ROWS.min(height - first) * width;
            valid += strip.valid.pixels[..inside].iter().filter(|valid| **valid).count();
        })?;
        Ok(valid as f64 / (width * height) as f64)
    }

    /// What a person wants to know of the rows that were written, a line each.
    pub fn told(&self, valid: f64) -> String {
        format!("{}{:.1} % valid\n", self.lamp_summary(), 100.0 * valid)
    }

    fn lamp_summary(&self) -> String {
        let Some((seen, reference)) = &self.lamp else { return String::new() };
        let [red, green, blue] = seen.drift(*reference).map(|drift| 100.0 * (drift - 1.0));
        format!("reference patch {:?}: lamp off by {red:+.2} {green:+.2} {blue:+.2} %, corrected\n", seen.radiance)
    }
}
