//! Merges a bracket to linear radiance with a variance.
//!
//! The default weighs each sample by its inverse variance (the form of Granados et al. 2010 and Hasinoff et al. 2010): photon
//! and read noise, and what storing the level added, through the slope of the response. The weights of the literature that
//! depend on the level alone stay selectable, for comparison.

mod kernel;
pub(super) mod precision;
mod sampled;
mod weights;

use super::bracket::Bracket;
use super::noise::SensorNoise;
use super::response::Response;
use crate::numerics::image::RadianceImage;
use crate::numerics::simd::Level;
use precision::Precision;
use rayon::prelude::*;
use sampled::Sampled;
use weights::{Tables, frames_needed, precision};

/// Samples below this level are not used: the response is not known well there.
pub(super) const LOWEST_LEVEL: u8 = 10;
/// From this level on a frame counts as clipped.
pub const CLIPPED_LEVEL: u8 = 252;
/// Pixels a thread takes at a time.
const CHUNK: usize = 16 * kernel::PIXELS;

/// Frames a sample is merged from, at most: the least of these that does.
const FEW: usize = 5;
const SOME: usize = 8;
const MANY: usize = 16;

/// How many of its longest open frames a sample is merged from, at most, by the precision of each channel.
pub(super) fn frames_used(channels: &[Precision<'_>; 3]) -> usize {
    let needed = frames_needed(channels);
    [FEW, SOME].into_iter().find(|&most| needed <= most).unwrap_or(MANY)
}

/// Whether a sample is known: of a number of open frames the longest has a level bright enough.
#[inline(always)]
fn usable(open: usize, level: u8) -> bool {
    (open > 0) & (level >= LOWEST_LEVEL)
}

/// What a bracket is merged with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Estimator {
    /// Inverse variance of every sample; the default.
    #[default]
    InverseVariance,
    /// Sum of exposures over sum of times: the most likely radiance if there were photon noise alone (Hanji, Zhong & Mantiuk
    /// 2020).
    Poisson,
    /// Mean of log exposures, weighted with a hat over the levels (Debevec & Malik 1997, Eq. 6).
    Debevec,
    /// Mean weighted with squared time and a Gaussian over the levels (Robertson, Borman & Stevenson 2003).
    Robertson,
}

impl Estimator {
    /// All, the default first.
    pub const ALL: [Self; 4] = [Self::InverseVariance, Self::Poisson, Self::Debevec, Self::Robertson];

    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::InverseVariance => "inverse-variance",
            Self::Poisson => "poisson",
            Self::Debevec => "debevec",
            Self::Robertson => "robertson",
        }
    }

    /// The estimator of that name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|estimator| estimator.name() == name)
    }
}

/// Merges `bracket` through `response` with inverse-variance weights. See [`Merger`].
pub fn merge(bracket: &Bracket, response: &Response, noise: &SensorNoise) -> RadianceImage {
    Merger::new(bracket, response, noise, Estimator::InverseVariance).whole()
}

/// A bracket with everything looked up beforehand, ready to give its radiance strip by strip, so that no image of the whole
/// frame need be in memory.
///
/// Once a frame is clipped all longer ones are too, whatever level a lossy file gives them. A pixel is valid when every channel
/// has a frame left whose level is neither clipped nor too dark; elsewhere the value is the nearest bound known, with a
/// variance as large as its square. Pixels are independent: neither strips nor threads nor instruction sets change a bit.
pub struct Merger<'a> {
    bracket: &'a Bracket,
    method: Box<dyn Method>,
}

/// Merges the pixels of a bracket from one on, as many as there is room for.
trait Method: Send + Sync {
    fn merge(&self, level: Level, bracket: &Bracket, from: usize, into: &mut Out<'_>);
}

impl<'a> Merger<'a> {
    /// Makes the tables of an estimator.
    pub fn new(bracket: &'a Bracket, response: &Response, noise: &SensorNoise, estimator: Estimator) -> Self {
        let method: Box<dyn Method> = match estimator {
            // The loop is compiled for these numbers of frames.
            Estimator::InverseVariance => {
                match frames_used(&std::array::from_fn(|c| precision(bracket, response, noise, c))) {
                    FEW => Box::new(Tables::<FEW>::new(bracket, response, noise)),
                    SOME => Box::new(Tables::<SOME>::new(bracket, response, noise)),
                    _ => Box::new(Tables::<MANY>::new(bracket, response, noise)),
                }
            }
            other => Box::new(Sampled::new(other, bracket, response, noise)),
        };
        Self { bracket, method }
    }

    /// An empty strip of `rows` rows for [`Merger::strip`].
    pub fn empty(&self, rows: usize) -> RadianceImage {
        RadianceImage::empty(self.bracket.width(), rows)
    }

    /// All rows.
    pub fn whole(&self) -> RadianceImage {
        let mut image = self.empty(self.bracket.height());
        self.strip(0, &mut image);
        image
    }

    /// Merges rows `first_row` onwards into all of `strip`, whose rows beyond the end of the frame keep what they held.
    pub fn strip(&self, first_row: usize, strip: &mut RadianceImage) {
        self.strip_at(Level::best(), first_row, strip);
    }

    /// As [`Merger::strip`], with a prescribed instruction set.
    pub fn strip_at(&self, level: Level, first_row: usize, strip: &mut RadianceImage) {
        let begin = first_row * self.bracket.width();
        let left = (self.bracket.width() * self.bracket.height()).saturating_sub(begin);
        let pixels = left.min(strip.radiance.pixels.len());
        let mut none = Vec::new();
        let variance = strip.variance.as_mut().map_or(&mut none, |image| &mut image.pixels);
        variance.resize(strip.radiance.pixels.len(), [0.0; 3]);
        let chunks = strip.radiance.pixels[..pixels]
            .par_chunks_mut(CHUNK)
            .zip(variance[..pixels].par_chunks_mut(CHUNK))
            .zip(strip.valid.pixels[..pixels].par_chunks_mut(CHUNK));
        chunks.enumerate().for_each(|(chunk, ((radiance, variance), valid))| {
            let from = begin + chunk * CHUNK;
            let mut into = Out { radiance, variance, valid };
            self.method.merge(level, self.bracket, from, &mut into);
        });
    }
}

/// Where merged pixels go; all of one length.
struct Out<'a> {
    radiance: &'a mut [[f32; 3]],
    variance: &'a mut [[f32; 3]],
    valid: &'a mut [bool],
}
