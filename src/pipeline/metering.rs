//! An adaptive bracket: which exposure is to be shot next, by what those before it show of the object.

use super::decode::decode_into;
use super::develop::{BracketFrame, Crop, DevelopError, JPEG_VARIANCE, Known, cut};
use crate::numerics::geometry::{Angles, Light, Projection, Sphere};
use crate::numerics::image::Image;
use crate::numerics::radiometry::merge::CLIPPED_LEVEL;
use crate::numerics::radiometry::metering::{Meter, Worth};
use crate::numerics::radiometry::noise::SensorNoise;

/// Samples that are judged, at most, spread over the object.
const MOST_SAMPLES: usize = 4096;
/// By how much the standard error of a sample may rise, relative, mean over all that the camera sees of the object: where the lamp lights
/// half of it, twice as much over that half.
const RISE: f64 = 0.02;
/// Clipped pixels that are taken for hot ones or dust instead of a highlight.
const HOT: usize = 3;

/// What the object looks like under the lamp, as far as it is known before the frames are developed.
#[derive(Clone, Copy)]
pub struct Lit<'a> {
    /// The camera.
    pub projection: &'a Projection,
    /// The sample.
    pub sphere: &'a Sphere,
    /// The lamp at this station.
    pub light: &'a Light,
    /// Part of the frame that is looked at.
    pub crop: Crop,
    /// Cosine of incidence above which samples are used.
    pub cos_i: f64,
    /// Cosine of reflection above which they are looked at here.
    pub cos_r: f64,
}

/// A bracket while it is shot.
pub struct Metering {
    known: Known,
    noise: SensorNoise,
    crop: Crop,
    /// Pixels of the crop that are judged.
    samples: Vec<usize>,
    /// The part of the object that is lit, of what the camera sees of it, 0 to 1.
    share: f64,
    seen: Vec<Seen>,
    memory: Image<[u8; 3]>,
}

/// A frame that was shot.
struct Seen {
    name: String,
    exposure: usize,
    levels: Vec<[u8; 3]>,
    /// Clipped pixels of the crop.
    clipped: usize,
}

/// What is to be done next; exposures are numbered from the shortest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Advice {
    /// This exposure would tell something.
    Shoot(usize),
    /// What is there is worth this, and no other exposure would add to it noticeably.
    Enough(Worth),
}

impl Metering {
    /// A bracket of which nothing is shot yet, of the exposures of `known`.
    pub fn new(known: &Known, noise: &SensorNoise, lit: &Lit<'_>) -> Self {
        let all = lit_pixels(lit);
        let share = all.len() as f64 / lit_pixels(&Lit { cos_i: -1.0, ..*lit }).len().max(1) as f64;
        let step = all.len().div_ceil(MOST_SAMPLES).max(1);
        Self {
            known: known.clone(),
            noise: *noise,
            crop: lit.crop,
            samples: all.into_iter().step_by(step).collect(),
            share,
            seen: Vec::new(),
            memory: Image::filled(0, 0, [0; 3]),
        }
    }

    /// Names of the frames that were looked at, in that order.
    pub fn seen(&self) -> impl Iterator<Item = &str> {
        self.seen.iter().map(|frame| &frame.name[..])
    }

    /// Looks at a frame that was shot.
    ///
    /// # Errors
    /// It cannot be decoded, has another size, or is of no exposure of the bracket.
    pub fn look(&mut self, frame: &BracketFrame<'_>) -> Result<(), DevelopError> {
        let unusable = |reason: String| DevelopError::Frame { name: frame.name.to_owned(), reason };
        decode_into(frame.bytes, &mut self.memory).map_err(|e| unusable(e.to_string()))?;
        let part = cut(&self.memory, self.crop).map_err(unusable)?;
        let exposure = self.known.exposure(frame.time_s)?;
        let levels = self.samples.iter().map(|&pixel| part.pixels[pixel]).collect();
        let clipped = part.pixels.iter().filter(|pixel| pixel.iter().any(|&level| level >= CLIPPED_LEVEL)).count();
        self.seen.push(Seen { name: frame.name.to_owned(), exposure, levels, clipped });
        Ok(())
    }

    /// What is to be done next. The reference exposure comes first: all light stations have it in common. Then whatever tells most, until
    /// no highlight is clipped in every frame, all others together would hardly tell more, and there are `least` frames.
    pub fn advice(&self, least: usize) -> Advice {
        let Some(shortest) = self.seen.iter().min_by_key(|frame| frame.exposure) else {
            return Advice::Shoot(self.known.reference);
        };
        let Known { response, times_s, .. } = &self.known;
        let meter = Meter::new(times_s, response, &self.noise, JPEG_VARIANCE);
        let frames: Vec<(usize, &[[u8; 3]])> = self.seen.iter().map(|s| (s.exposure, &s.levels[..])).collect();
        let outlook = meter.outlook(&frames);
        let shot: Vec<usize> = self.seen.iter().map(|frame| frame.exposure).collect();
        let left = |below: usize| (0..below).filter(|exposure| !shot.contains(exposure));
        if shortest.clipped > HOT && shortest.exposure > 0 {
            let shorter = outlook.best(&shot, left(shortest.exposure));
            return Advice::Shoot(shorter.unwrap_or(shortest.exposure - 1));
        }
        let worth = outlook.worth(&shot);
        let best = outlook.best(&shot, left(times_s.len()));
        let missing = worth.sigma > worth.sigma_whole * (1.0 + RISE / self.share);
        let next = match best {
            Some(best) if missing => Some(best),
            // Of a station that shows next to nothing, too, there is something to compare.
            best if shot.len() < least => best.or_else(|| left(times_s.len()).next_back()),
            _ => None,
        };
        next.map_or(Advice::Enough(worth), Advice::Shoot)
    }
}

/// Pixels of the crop, row by row, that show lit parts of the sample.
fn lit_pixels(lit: &Lit<'_>) -> Vec<usize> {
    let Crop { x: left, y: top, width, height } = lit.crop;
    let shows = |&pixel: &usize| {
        let (x, y) = (left + pixel % width, top + pixel / width);
        let Some(point) = lit.sphere.intersect(&lit.projection.ray(x as f64 + 0.5, y as f64 + 0.5)) else {
            return false;
        };
        let angles = Angles::new(&point.normal, &lit.light.at(&point.position).0, &point.view);
        angles.cos_i > lit.cos_i && angles.cos_r > lit.cos_r
    };
    (0..width * height).filter(shows).collect()
}
