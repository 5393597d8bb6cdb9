//! Weighted sums of look-ups over a bracket of byte images, 64 pixels side by side: what merging costs most.
//!
//! A sample's open frames are those before the first whose level reaches the limit. Its sum is a row's first term plus, for each
//! of the next shorter open frames, a weight of that row times the value of that frame's level; the row is that of the number of
//! open frames and the longest one's level. [`look_ups`] does it where a processor permutes bytes (AVX-512 VBMI): the value of a
//! level is then looked up in registers. Multiplications and additions are never fused and always in the same order, so that
//! plain loops over the same tables, which the merge runs elsewhere, give the same bits.

use super::Level;

/// Weights of a row, and with the first term the frames a sum has.
pub const WEIGHTS: usize = 4;
/// Frames at most: their number is counted in a byte.
const MOST_FRAMES: usize = 254;

/// What a sample is looked up as.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))]
pub struct Row {
    /// First term of the sum.
    first: f32,
    /// The second result.
    variance: f32,
    /// Upper halves of the weights of the next shorter frames, as f32; the nearer frame of a pair in the upper half.
    weights: [u32; WEIGHTS / 2],
}

impl Row {
    /// A row with weights of which only the upper 16 bits count: a weight that has more is not what is used.
    pub fn new(first: f32, weights: [f32; WEIGHTS], variance: f32) -> Self {
        let pair = |near: f32, far: f32| (near.to_bits() & UPPER_HALF) | (far.to_bits() >> 16);
        Self { first, variance, weights: [pair(weights[0], weights[1]), pair(weights[2], weights[3])] }
    }
}

const UPPER_HALF: u32 = 0xffff_0000;

/// The tables of a channel.
pub struct Channel {
    /// Rows by number of open frames, then level.
    rows: Vec<[Row; 256]>,
    /// The four bytes of every level's value, each in a table of its own.
    values: [[u8; 256]; 4],
}

impl Channel {
    /// Tables of `rows` for none, one, two ... open frames and of the levels' `values`.
    pub fn new(rows: Vec<[Row; 256]>, values: &[f32; 256]) -> Self {
        let byte = |k: usize| values.map(|value| value.to_le_bytes()[k]);
        Self { rows, values: std::array::from_fn(byte) }
    }
}

/// Results of some pixels, all of one length.
pub struct Into<'a> {
    /// The sums.
    pub sums: &'a mut [[f32; 3]],
    /// Second results.
    pub variances: &'a mut [[f32; 3]],
    /// Whether every channel has an open frame whose longest has at least the lowest level.
    pub usable: &'a mut [bool],
}

/// Which levels count.
#[derive(Clone, Copy)]
pub struct Levels {
    /// From this level on a frame is not open.
    pub limit: u8,
    /// The longest open frame needs this level for its sample to be usable.
    pub lowest: u8,
}

/// Looks up as many whole groups of 64 pixels as there are from the start, and says how many pixels that were: none where the
/// processor does not permute bytes, `level` is below AVX-512, or tables and frames do not fit. `frames` are the samples of the
/// pixels, shortest exposure first.
pub fn look_ups(
    level: Level,
    frames: &[&[u8]],
    levels: Levels,
    channels: &[Channel; 3],
    #[cfg_attr(not(target_arch = "x86_64"), allow(unused_variables))] into: &mut Into<'_>,
) -> usize {
    let pixels = into.sums.len().min(into.variances.len()).min(into.usable.len());
    let fits = frames.len() <= MOST_FRAMES
        && channels.iter().all(|channel| channel.rows.len() > frames.len())
        && frames.iter().all(|frame| frame.len() >= 3 * pixels);
    if !fits || level < Level::Avx512 {
        return 0;
    }
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx512vbmi") && is_x86_feature_detected!("avx512bw") && Level::best() == Level::Avx512
    {
        // SAFETY: the processor was asked for all that is needed; lengths and tables fit, as was just checked.
        return unsafe { vbmi::look_ups(frames, levels, channels, into, pixels) };
    }
    0
}

#[cfg(target_arch = "x86_64")]
mod vbmi;
