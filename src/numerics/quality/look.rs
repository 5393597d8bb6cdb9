//! What is kept of a frame for comparing it with others.

use crate::numerics::image::Image;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Samples along the longer side of the part that is looked at, at most.
const ALONG: usize = 128;
/// Levels up to this say nothing, levels from the other on are clipped: mean of a sample.
pub(super) const DARK: f32 = 12.0;
pub(super) const CLIPPED: f32 = 240.0;
/// Share of the samples that is darker than what counts as the background.
const BACKGROUND: f64 = 0.1;
/// A picture without contrast, in levels between its background and its brightest hundredth, shows nothing that can be compared.
const CONTRAST: f32 = 8.0;
const BRIGHT: f64 = 0.99;
/// Rows of one grey level at the bottom that no scene has: a block of a JPEG and half of the next.
const GREY_ROWS: usize = 12;
/// Levels such rows may have, and by how much they may differ in themselves.
const GREY: std::ops::RangeInclusive<u8> = 24..=247;
const GREY_SPREAD: u8 = 2;

/// Two by two pixels of the green channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Mean level.
    pub level: f32,
    /// Greatest difference between its pixels, levels.
    pub range: f32,
}

/// A frame, sampled on a regular grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// Row by row; of frames of one size and part, sample i shows the same place.
    pub samples: Vec<Sample>,
    /// Samples in a row.
    pub columns: usize,
    /// Pixels from one sample to the next.
    pub step: usize,
    /// Left and upper end of the part.
    corner: [usize; 2],
    /// Level of the background: a tenth of the samples is darker.
    pub background: f32,
    /// Level of the brightest hundredth.
    pub bright: f32,
    /// Share of the samples that is clipped, 0 to 1.
    pub clipped: f32,
    /// Hash of the sampled levels; none of a picture without contrast.
    pub hash: Option<u64>,
    /// How far single rows, and single columns, stand out from the mean of their neighbours, levels rms.
    pub stripes: [f32; 2],
    /// Rows of one grey level at the bottom of the frame, where what is above shows a picture.
    pub grey_rows: Option<usize>,
}

impl Look {
    /// Of the `part` (left, top, width, height) of a picture; all of it where the part does not lie inside.
    pub fn new(picture: &Image<[u8; 3]>, part: [usize; 4]) -> Self {
        let [left, top, width, height] = part;
        let fits = left.saturating_add(width) <= picture.width && top.saturating_add(height) <= picture.height;
        let [left, top, width, height] =
            if fits && width > 1 && height > 1 { part } else { [0, 0, picture.width, picture.height] };
        let green = |x: usize, y: usize| picture.at(left + x, top + y)[1];
        let step = width.max(height).div_ceil(ALONG).max(1);
        let (mut samples, mut hasher) = (Vec::new(), DefaultHasher::new());
        for y in (0..height.saturating_sub(1)).step_by(step) {
            for x in (0..width.saturating_sub(1)).step_by(step) {
                let pixels = [green(x, y), green(x + 1, y), green(x, y + 1), green(x + 1, y + 1)];
                pixels.hash(&mut hasher);
                samples.push(Sample::new(pixels));
            }
        }
        let mut levels: Vec<f32> = samples.iter().map(|sample| sample.level).collect();
        levels.sort_by(f32::total_cmp);
        let at = |share: f64| levels.get((share * levels.len() as f64) as usize).copied().unwrap_or_default();
        let (background, bright) = (at(BACKGROUND), at(BRIGHT));
        let clipped = levels.iter().filter(|&&level| level >= CLIPPED).count() as f32 / levels.len().max(1) as f32;
        let (rows, columns) = profiles(picture, [left, top, width, height]);
        let contrast = bright - background >= CONTRAST;
        Self {
            samples,
            columns: width.saturating_sub(1).div_ceil(step),
            step,
            corner: [left, top],
            background,
            bright,
            clipped,
            hash: contrast.then(|| hasher.finish()),
            stripes: [roughness(&rows), roughness(&columns)],
            grey_rows: grey_rows(picture),
        }
    }

    /// Middle one of the samples' levels.
    pub fn median(&self) -> f32 {
        let mut levels: Vec<f32> = self.samples.iter().map(|sample| sample.level).collect();
        levels.sort_by(f32::total_cmp);
        levels.get(levels.len() / 2).copied().unwrap_or_default()
    }

    /// The middle of a sample, pixel coordinates of the frame.
    pub fn pixel(&self, index: usize) -> [f64; 2] {
        let columns = self.columns.max(1);
        let [column, row] = [index % columns, index / columns];
        [self.corner[0] + column * self.step + 1, self.corner[1] + row * self.step + 1].map(|at| at as f64)
    }

    /// True if something can be compared with it: bright parts before a dark background.
    pub fn shows(&self) -> bool {
        self.hash.is_some()
    }
}

impl Sample {
    /// Well exposed, and no edge: its mean level then tells its mean exposure.
    pub(super) fn smooth(&self) -> bool {
        self.level >= DARK && self.level < CLIPPED && self.range < 0.2 * self.level + 6.0
    }

    fn new(pixels: [u8; 4]) -> Self {
        let (low, high) = pixels.iter().fold((u8::MAX, 0), |(low, high), &p| (p.min(low), p.max(high)));
        Self { level: pixels.iter().map(|&p| f32::from(p)).sum::<f32>() / 4.0, range: f32::from(high - low) }
    }
}

/// Mean green level of every row and of every column of a part.
fn profiles(picture: &Image<[u8; 3]>, [left, top, width, height]: [usize; 4]) -> (Vec<f64>, Vec<f64>) {
    let mut columns = vec![0_u32; width];
    let mut row_mean = |y: usize| {
        let pixels = &picture.row(top + y)[left..left + width];
        columns.iter_mut().zip(pixels).for_each(|(sum, pixel)| *sum += u32::from(pixel[1]));
        f64::from(pixels.iter().map(|pixel| u32::from(pixel[1])).sum::<u32>()) / width as f64
    };
    let rows = (0..height).map(&mut row_mean).collect();
    (rows, columns.into_iter().map(|sum| f64::from(sum) / height as f64).collect())
}

/// Third differences pass over shading and slow gradients.
fn roughness(profile: &[f64]) -> f32 {
    let third = |w: &[f64]| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]) / 20_f64.sqrt();
    let mut rough: Vec<f64> = profile.windows(4).map(third).map(f64::abs).collect();
    rough.sort_by(f64::total_cmp);
    // Edges of the object lie on few rows; of bands eight rows high, three in eight rows show the edge.
    let upper = rough.get(rough.len() * 3 / 4).copied().unwrap_or_default();
    (upper / 1.15) as f32
}

fn grey_rows(picture: &Image<[u8; 3]>) -> Option<usize> {
    let level = *picture.pixels.last()?;
    let same = |pixel: &[u8; 3]| (0..3).all(|c| pixel[c].abs_diff(level[c]) <= GREY_SPREAD);
    let rows = (0..picture.height).rev().take_while(|&y| picture.row(y).iter().all(same)).count();
    let grey = level.iter().all(|channel| GREY.contains(channel));
    (grey && rows >= GREY_ROWS && rows < picture.height).then_some(rows)
}
