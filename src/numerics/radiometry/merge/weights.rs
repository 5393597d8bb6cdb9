//! Inverse-variance weights by look-up.
//!
//! The longest frame of a pixel that is not clipped holds most of what is known of its radiance: 55 % at the paper's steps of
//! 1.17 EV. Its level predicts the exposure of all shorter frames, and so every weight, already normalised. Only the few
//! longest frames are used, for the weights of the others together are too small to matter. Weights that a sample sets for
//! itself bias the mean where noise is large; these hardly do, for they change slowly with the level (by 6 % of themselves
//! an octave), and all frames share them.

use super::super::bracket::Bracket;
use super::super::noise::SensorNoise;
use super::super::response::{LEVELS, Response};
use super::precision::{FADING_LEVEL, Precision};
use super::{CLIPPED_LEVEL, LOWEST_LEVEL, usable};
use crate::numerics::simd::look_ups;

/// Share of the precision that the frames left out may hold: 8 % of it is 4 % of the standard error, and hardly any pixel
/// loses that much.
const MOST_LOST: f64 = 0.08;
/// What a pixel is merged with when its longest open frame has a certain level.
#[derive(Clone, Copy)]
pub(super) struct Row<const FRAMES: usize> {
    /// First the exposure of that frame times its weight, then the weights of the next shorter frames; weights are per second
    /// and contain the division by their sum. All but the first have 16 bits, as [`look_ups`] wants them.
    pub terms: [f32; FRAMES],
    /// Variance of the radiance; its square where the sample is not usable.
    pub variance: f32,
}

impl<const FRAMES: usize> Row<FRAMES> {
    /// A bound, or a value too dark to be trusted.
    fn known_no_better(radiance: f64) -> Self {
        let mut terms = [0.0; FRAMES];
        terms[0] = radiance as f32;
        Self { terms, variance: (radiance * radiance) as f32 }
    }
}

/// Rows of one channel by number of open frames and level of the longest of them, and the exposures of levels.
pub(super) struct ChannelTable<const FRAMES: usize> {
    pub rows: Vec<[Row<FRAMES>; LEVELS]>,
    pub exposure: [f32; LEVELS],
}

/// The tables of all channels.
pub(super) struct Tables<const FRAMES: usize> {
    pub channels: [ChannelTable<FRAMES>; 3],
    /// The same for [`look_ups`], if it can sum so many frames.
    pub look_ups: Option<[look_ups::Channel; 3]>,
}

impl<const FRAMES: usize> Tables<FRAMES> {
    pub fn new(bracket: &Bracket, response: &Response, noise: &SensorNoise) -> Self {
        let channels = std::array::from_fn(|c| {
            let precision = precision(bracket, response, noise, c);
            let rows = |open| std::array::from_fn(|level| precision.row(open, level));
            ChannelTable {
                rows: (0..=bracket.exposures().len()).map(rows).collect(),
                exposure: std::array::from_fn(|level| precision.exposure(level) as f32),
            }
        });
        let look_ups = (FRAMES == 1 + look_ups::WEIGHTS).then(|| channels.each_ref().map(ChannelTable::look_ups));
        Self { channels, look_ups }
    }
}

impl<const FRAMES: usize> ChannelTable<FRAMES> {
    fn look_ups(&self) -> look_ups::Channel {
        let row = |row: &Row<FRAMES>| {
            let weights = std::array::from_fn(|k| row.terms[1 + k]);
            look_ups::Row::new(row.terms[0], weights, row.variance)
        };
        look_ups::Channel::new(self.rows.iter().map(|rows| rows.each_ref().map(row)).collect(), &self.exposure)
    }
}

/// How many of the longest open frames a pixel needs for all but [`MOST_LOST`] of the precision, at any level that the longest
/// can have while the next one is clipped.
pub(super) fn frames_needed(channels: &[Precision<'_>; 3]) -> usize {
    let mut needed = 1;
    for precision in channels {
        let frames = precision.times.len();
        for open in 1..=frames {
            for level in usize::from(LOWEST_LEVEL)..=FADING_LEVEL as usize {
                let radiance = precision.exposure(level) / precision.times[open - 1];
                let possible = open == frames || precision.level(radiance, open) >= FADING_LEVEL;
                if possible {
                    needed = needed.max(precision.frames_needed(open, radiance));
                }
            }
        }
    }
    needed
}

/// Precision of a channel's samples in the frames of `bracket`.
pub(super) fn precision<'a>(
    bracket: &Bracket,
    response: &'a Response,
    noise: &'a SensorNoise,
    channel: usize,
) -> Precision<'a> {
    Precision::new(bracket.times_s(), bracket.level_variance()[channel], response, noise, channel)
}

impl Precision<'_> {
    fn frames_needed(&self, open: usize, radiance: f64) -> usize {
        let precisions: Vec<f64> = (0..open).rev().map(|frame| self.of(radiance, frame)).collect();
        let mut left: f64 = precisions.iter().sum();
        let most = MOST_LOST * left;
        let needed = precisions.iter().take_while(|&&precision| {
            let more = left > most;
            left -= precision;
            more
        });
        needed.count()
    }

    fn row<const FRAMES: usize>(&self, open: usize, level: usize) -> Row<FRAMES> {
        let Some(longest) = open.checked_sub(1) else {
            return Row::known_no_better(self.exposure(usize::from(CLIPPED_LEVEL)) / self.times[0]);
        };
        let radiance = self.exposure(level) / self.times[longest];
        if !usable(open, level as u8) {
            return Row::known_no_better(radiance);
        }
        let used = open.min(FRAMES);
        let precisions: Vec<f64> = (0..used).map(|k| self.of(radiance, longest - k)).collect();
        let total: f64 = precisions.iter().sum();
        let mut terms = [0.0; FRAMES];
        // What rounding the weights takes or adds, the longest frame gives or takes: their sum stays 1.
        let mut share = 1.0;
        for (k, precision) in precisions.iter().enumerate().skip(1) {
            let time = self.times[longest - k];
            terms[k] = rounded(precision / total / time);
            share -= f64::from(terms[k]) * time;
        }
        terms[0] = (share * radiance) as f32;
        Row { terms, variance: (1.0 / total) as f32 }
    }
}

/// The nearest number whose f32 has zeros in its lower half: within 0.2 %.
fn rounded(weight: f64) -> f32 {
    f32::from_bits((weight as f32).to_bits().wrapping_add(0x8000) & 0xffff_0000)
}
