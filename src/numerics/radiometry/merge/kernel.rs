//! The inner loop: blocks of pixels that stay in the cache.
//!
//! A block is read once, as bytes side by side, to find how many frames of each sample are open and the levels of the longest
//! of them; then each sample is one look-up of a row and one of the exposure of every further level. Plain loops: the
//! compiler makes vectors of them for each instruction set, and multiplications and additions are never fused. They are the twin
//! of [`look_ups`], which does most of the pixels where it can.

use super::super::bracket::Bracket;
use super::weights::{ChannelTable, Tables};
use super::{CLIPPED_LEVEL, LOWEST_LEVEL, Method, Out, usable};
use crate::numerics::simd::look_ups::{self, look_ups};
use crate::numerics::simd::{Level, Vector, Work};

/// Pixels of a block.
pub(super) const PIXELS: usize = 512;
/// Samples of a block.
const SAMPLES: usize = 3 * PIXELS;
/// Samples side by side.
const LANE: usize = 32;

/// What is known of the samples of a block.
struct Block<const FRAMES: usize> {
    /// Open frames, counted from the shortest.
    open: [u8; SAMPLES],
    /// Levels of the longest open frame, the next shorter one and so on.
    levels: [[u8; SAMPLES]; FRAMES],
}

impl<const FRAMES: usize> Method for Tables<FRAMES> {
    fn merge(&self, level: Level, bracket: &Bracket, from: usize, into: &mut Out<'_>) {
        let done = self.look_ups.as_ref().map_or(0, |channels| fast(level, channels, bracket, from, into));
        let mut rest = Out {
            radiance: &mut into.radiance[done..],
            variance: &mut into.variance[done..],
            valid: &mut into.valid[done..],
        };
        level.run(Blocks { tables: self, bracket, from: from + done, into: &mut rest });
    }
}

/// Merges the first pixels by [`look_ups`]; how many.
fn fast(level: Level, channels: &[look_ups::Channel; 3], bracket: &Bracket, from: usize, into: &mut Out<'_>) -> usize {
    let frames = bracket.exposures().iter().map(|frame| &frame.levels.pixels[from..][..into.radiance.len()]);
    let frames: Vec<&[u8]> = frames.map(|pixels| pixels.as_flattened()).collect();
    let levels = look_ups::Levels { limit: CLIPPED_LEVEL, lowest: LOWEST_LEVEL };
    let mut into = look_ups::Into { sums: into.radiance, variances: into.variance, usable: into.valid };
    look_ups(level, &frames, levels, channels, &mut into)
}

struct Blocks<'a, 'b, const FRAMES: usize> {
    tables: &'a Tables<FRAMES>,
    bracket: &'a Bracket,
    from: usize,
    into: &'a mut Out<'b>,
}

impl<const FRAMES: usize> Work for Blocks<'_, '_, FRAMES> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { tables, bracket, from, into } = self;
        let mut block = Block { open: [0; SAMPLES], levels: [[0; SAMPLES]; FRAMES] };
        let pixels = into.radiance.len();
        for begin in (0..pixels).step_by(PIXELS) {
            let size = PIXELS.min(pixels - begin);
            let frames = bracket.exposures().iter().map(|frame| &frame.levels.pixels[from + begin..][..size]);
            if size == PIXELS {
                let frames: Vec<&[u8]> = frames.map(|pixels| pixels.as_flattened()).collect();
                select(&frames, &mut block);
            } else {
                let frames: Vec<Vec<u8>> = frames.map(|pixels| padded(pixels.as_flattened())).collect();
                let frames: Vec<&[u8]> = frames.iter().map(Vec::as_slice).collect();
                select(&frames, &mut block);
            }
            let mut part = Out {
                radiance: &mut into.radiance[begin..][..size],
                variance: &mut into.variance[begin..][..size],
                valid: &mut into.valid[begin..][..size],
            };
            look_up(&block, tables, &mut part);
        }
    }
}

/// The last pixels of a frame as a whole block.
fn padded(samples: &[u8]) -> Vec<u8> {
    let mut block = samples.to_vec();
    block.resize(SAMPLES, 0);
    block
}

/// Fills a block from the frames, shortest first.
#[inline(always)]
fn select<const FRAMES: usize>(frames: &[&[u8]], block: &mut Block<FRAMES>) {
    for at in (0..SAMPLES).step_by(LANE) {
        let mut levels = [[0_u8; LANE]; FRAMES];
        let mut shorter = [[0_u8; LANE]; FRAMES];
        let mut open = [0xff_u8; LANE];
        let mut count = [0_u8; LANE];
        for frame in frames {
            let Some(seen) = frame.as_chunks::<LANE>().0.get(at / LANE) else { return };
            for k in (1..FRAMES).rev() {
                shorter[k] = shorter[k - 1];
            }
            shorter[0] = *seen;
            for i in 0..LANE {
                open[i] &= if seen[i] < CLIPPED_LEVEL { 0xff } else { 0 };
            }
            for i in 0..LANE {
                // All ones is minus one.
                count[i] = count[i].wrapping_sub(open[i]);
            }
            for k in 0..FRAMES {
                for i in 0..LANE {
                    levels[k][i] = (shorter[k][i] & open[i]) | (levels[k][i] & !open[i]);
                }
            }
        }
        block.open[at..at + LANE].copy_from_slice(&count);
        for k in 0..FRAMES {
            block.levels[k][at..at + LANE].copy_from_slice(&levels[k]);
        }
    }
}

/// Radiance, variance and validity of the pixels of a block.
#[inline(always)]
fn look_up<const FRAMES: usize>(block: &Block<FRAMES>, tables: &Tables<FRAMES>, into: &mut Out<'_>) {
    let open = block.open.as_chunks::<3>().0;
    let levels: [&[[u8; 3]]; FRAMES] = std::array::from_fn(|k| block.levels[k].as_chunks::<3>().0);
    for (i, ((radiance, variance), open)) in
        into.radiance.iter_mut().zip(into.variance.iter_mut()).zip(open).enumerate()
    {
        for c in 0..3 {
            let ChannelTable { rows, exposure } = &tables.channels[c];
            let row = &rows[usize::from(open[c])][usize::from(levels[0][i][c])];
            let mut sum = row.terms[0];
            for k in 1..FRAMES {
                sum += row.terms[k] * exposure[usize::from(levels[k][i][c])];
            }
            radiance[c] = sum;
            variance[c] = row.variance;
        }
    }
    for ((valid, open), levels) in into.valid.iter_mut().zip(open).zip(levels[0]) {
        *valid = (0..3).fold(true, |all, c| all & usable(usize::from(open[c]), levels[c]));
    }
}
