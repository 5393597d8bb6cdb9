//! Levels between levels: what a JPEG file says of chosen pixels before its decoder rounds.
//!
//! A JPEG keeps the mean of every 8 x 8 block to an eighth of a level and throws away most of its noise. A decoder then rounds
//! luminance and both chrominances to whole levels, and with no noise left to dither that, every even surface of one hue comes out
//! up to 0.8 levels wrong in red and blue, the same in all its pixels: 1 to 4 % of a dark exposure. Here the inverse transform
//! (ITU-T T.81, A.3.3) is evaluated at the pixels asked for and nothing is rounded.

mod huffman;
mod scan;

use scan::{Component, coefficients};
use std::f32::consts::PI;

/// Why a file says nothing beyond whole levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unread {
    /// No baseline JPEG of three channels, or no such pixel. Of grey ones only the damage is told.
    #[error("no baseline JPEG of three channels that holds these pixels")]
    Unsuited,
    /// Its picture data end early or are none. Decoders may make up the rest, grey, if an end marker follows.
    #[error("its picture data end early or are damaged")]
    Damaged,
}

/// Red, green and blue of pixels (column, row), not rounded; black may be a little below 0 and white above 255.
///
/// # Errors
/// Files that are no baseline JPEG of three channels, pixels outside the picture, and damaged files.
pub fn fine_levels(bytes: &[u8], points: &[(usize, usize)]) -> Result<Vec<[f32; 3]>, Unread> {
    let picture = coefficients(bytes)?;
    if picture.components.len() != 3 {
        return Err(Unread::Unsuited);
    }
    let cosines = cosines();
    let level = |&(x, y): &(usize, usize)| {
        if x >= picture.width || y >= picture.height {
            return None;
        }
        let mut sample = [0.0; 3];
        for (sample, component) in sample.iter_mut().zip(&picture.components) {
            *sample = value(component, picture.most, (x, y), &cosines)?;
        }
        let [luma, cb, cr] = sample;
        // JFIF 1.02; the components are centred about 0.
        let luma = luma + 128.0;
        Some([luma + 1.402 * cr, luma - 0.344_136_3 * cb - 0.714_136_3 * cr, luma + 1.772 * cb])
    };
    points.iter().map(level).collect::<Option<_>>().ok_or(Unread::Unsuited)
}

/// `[place][frequency]`: the cosine transform's basis with its norm, a half c(u) cos((2 x + 1) u pi / 16).
fn cosines() -> [[f32; 8]; 8] {
    std::array::from_fn(|x| {
        std::array::from_fn(|u| {
            let norm = if u == 0 { 0.5_f32.sqrt() } else { 1.0 };
            0.5 * norm * ((2 * x + 1) as f32 * u as f32 * PI / 16.0).cos()
        })
    })
}

/// A component at a pixel of the picture; of a coarser one the sample whose area holds the pixel.
fn value(component: &Component, most: (usize, usize), (x, y): (usize, usize), cosines: &[[f32; 8]; 8]) -> Option<f32> {
    let (x, y) = (x * component.sampling.0 / most.0, y * component.sampling.1 / most.1);
    let block = component.block(x / 8, y / 8)?;
    let (across, down) = (&cosines[x % 8], &cosines[y % 8]);
    let mut sum = 0.0;
    for (row, down) in block.chunks_exact(8).zip(down) {
        sum += down * row.iter().zip(across).map(|(c, across)| f32::from(*c) * across).sum::<f32>();
    }
    Some(sum)
}
