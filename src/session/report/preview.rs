//! The object, measured and as fitted: what a reader wants to see before any figure.

use super::ReportError;
use super::sources::Fitted;
use crate::document::{Block, Picture};
use crate::numerics::image::Image;
use crate::store::files::shown;
use crate::store::png;

const FILE: &str = "preview.png";
/// Longest side in a report, pixels.
const LONGEST: usize = 1200;
/// Larger ones are not decoded, pixels: a daemon makes reports beside a session.
const MOST: u64 = 64 << 20;

/// The picture that the fit left; where there is none, that in words.
pub fn block(fitted: &Fitted) -> Result<Block, ReportError> {
    let path = fitted.directory.join(FILE);
    if !path.exists() {
        return Ok(Block::text(format!("{FILE} is missing, so the object is not shown: fit again to have it.")));
    }
    let damaged = |reason: String| ReportError::Damaged { path: shown(&path), reason };
    let Some(whole) = png::read(&path, MOST).map_err(damaged)? else {
        return Ok(Block::text(format!("{FILE} of the result is too large to be shown here: open the file itself.")));
    };
    let picture = reduced(&whole, whole.width.max(whole.height).div_ceil(LONGEST));
    let caption = "The object. Above: measured under some of the lights; in the middle: the fitted material under the same lights; below: the \
                   weight of each material, from 0 (black) to 1 (white).";
    Ok(Block::Picture(Picture {
        caption: caption.into(),
        alternative: "The object as measured, as fitted, and the weights of its materials, a row each".into(),
        size: [picture.width as u32, picture.height as u32],
        png: png::encode(&picture).map_err(damaged)?,
        scale: None,
    }))
}

/// Means of squares of `step` pixels a side; what does not fill one at the right and lower edge is left out.
fn reduced(whole: &Image<[u8; 3]>, step: usize) -> Image<[u8; 3]> {
    let (width, height) = (whole.width / step, whole.height / step);
    let mut small = Image::filled(width, height, [0; 3]);
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let square = (0..step * step).map(|i| whole.at(step * x + i % step, step * y + i / step));
        let sum = square.fold([0; 3], |sum: [usize; 3], pixel| std::array::from_fn(|c| sum[c] + usize::from(pixel[c])));
        small.pixels[y * width + x] = sum.map(|sum| (sum / (step * step)) as u8);
    }
    small
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_become_their_means() {
        let pixels = vec![[0; 3], [4; 3], [9; 3], [8; 3], [12; 3], [9; 3]];
        assert_eq!(reduced(&Image { width: 3, height: 2, pixels }, 2).pixels, [[6; 3]]);
    }
}
