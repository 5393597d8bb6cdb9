//! What is done to merged rows before they are written, whatever frames they come from: dark signal, flat field, lamp.

use super::list::Reference;
use crate::numerics::image::RadianceImage;
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
            rows.lamp = Some((patch.mean(&top)?, *radiance));
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

    /// Writes all rows; gives what a person wants to know of them, a line each.
    pub fn write(&self, out: &Path, attributes: &[(&str, String)]) -> Result<String, ExrError> {
        let (width, height) = self.size;
        let (mut strip, mut valid) = (RadianceImage::empty(width, STRIP_ROWS), 0);
        let place = Place { origin: (0, 0), full: self.size, size: self.size };
        write_strips(out, place, attributes, &mut strip, |first, strip| {
            self.strip(first, strip);
            let inside = STRIP_ROWS.min(height - first) * width;
            valid += strip.valid.pixels[..inside].iter().filter(|valid| **valid).count();
        })?;
        let share = 100.0 * valid as f64 / (width * height) as f64;
        Ok(format!("{}{share:.1} % valid\n", self.lamp_summary()))
    }

    fn lamp_summary(&self) -> String {
        let Some((seen, reference)) = &self.lamp else { return String::new() };
        let [red, green, blue] = seen.drift(*reference).map(|drift| 100.0 * (drift - 1.0));
        format!("reference patch {:?}: lamp off by {red:+.2} {green:+.2} {blue:+.2} %, corrected\n", seen.radiance)
    }
}
