//! What faults do to the light that reaches the sensor, and to what is read out.

use super::faults::Fault;
use crate::numerics::image::Image;
use std::borrow::Cow;

/// The radiance under a lamp of this brightness, red green blue, relative to the rig file's, in a room that adds this much.
pub(super) fn under(lamp: [f64; 3], room: f64, image: &Image<[f64; 3]>) -> Cow<'_, Image<[f64; 3]>> {
    if lamp == [1.0; 3] && room == 0.0 {
        return Cow::Borrowed(image);
    }
    let pixels = image.pixels.iter().map(|pixel| std::array::from_fn(|c| pixel[c] * lamp[c] + room)).collect();
    Cow::Owned(Image { pixels, ..*image })
}

/// The radiance that the sensor sees with this fault; `patch`: left, top, right, bottom of the reference patch.
pub(super) fn radiance(
    fault: Option<Fault>,
    image: &Image<[f64; 3]>,
    patch: Option<[usize; 4]>,
) -> Cow<'_, Image<[f64; 3]>> {
    Cow::Owned(match (fault, patch) {
        (Some(Fault::LampAt(permille)), _) => each(image, |c| c * f64::from(permille) / 1000.0),
        (Some(Fault::Ambient(permille)), _) => {
            let more = mean_of_lit(image) * f64::from(permille) / 1000.0;
            each(image, |c| c + more)
        }
        (Some(Fault::PatchAt(permille)), Some(patch)) => within(image, patch, f64::from(permille) / 1000.0),
        (Some(Fault::Shake(pixels)), _) => shaken(image, usize::from(pixels)),
        (Some(Fault::Moved(x, y)), _) => moved(image, isize::from(x), isize::from(y)),
        _ => return Cow::Borrowed(image),
    })
}

/// Changes the levels that the file gets.
pub(super) fn levels(fault: Option<Fault>, image: &mut Image<[f32; 3]>) {
    let (width, height) = (image.width, image.height);
    match fault {
        Some(Fault::Stripes { rows, levels }) => {
            let band = usize::from(rows.max(1));
            for (_, pixel) in image.pixels.iter_mut().enumerate().filter(|(i, _)| i / width / band % 2 == 0) {
                *pixel = pixel.map(|level| (level + f32::from(levels)).min(255.0));
            }
        }
        Some(Fault::GreyBelow(permille)) => {
            let from = height * usize::from(permille) / 1000;
            image.pixels[from * width..].fill([128.0; 3]);
        }
        _ => {}
    }
}

fn each(image: &Image<[f64; 3]>, change: impl Fn(f64) -> f64) -> Image<[f64; 3]> {
    let pixels = image.pixels.iter().map(|pixel| pixel.map(&change)).collect();
    Image { pixels, ..*image }
}

fn within(image: &Image<[f64; 3]>, [left, top, right, bottom]: [usize; 4], part: f64) -> Image<[f64; 3]> {
    let mut changed = Image { pixels: image.pixels.clone(), ..*image };
    for row in changed.pixels.chunks_mut(image.width).take(bottom).skip(top) {
        row.iter_mut().take(right).skip(left).for_each(|pixel| *pixel = pixel.map(|c| c * part));
    }
    changed
}

fn mean_of_lit(image: &Image<[f64; 3]>) -> f64 {
    let lit: Vec<f64> = image.pixels.iter().map(|pixel| pixel[1]).filter(|&c| c > 0.0).collect();
    lit.iter().sum::<f64>() / lit.len().max(1) as f64
}

fn shaken(image: &Image<[f64; 3]>, pixels: usize) -> Image<[f64; 3]> {
    let mut sum = Image::filled(image.width, image.height, [0.0; 3]);
    for step in 0..=pixels {
        let along = isize::try_from(step).unwrap_or_default();
        let part = moved(image, along, along);
        for (total, pixel) in sum.pixels.iter_mut().zip(&part.pixels) {
            *total = std::array::from_fn(|c| total[c] + pixel[c] / (pixels + 1) as f64);
        }
    }
    sum
}

fn moved(image: &Image<[f64; 3]>, right: isize, down: isize) -> Image<[f64; 3]> {
    let from = |at: usize, by: isize, size: usize| at.saturating_add_signed(-by).min(size - 1);
    let pixel =
        |i: usize| *image.at(from(i % image.width, right, image.width), from(i / image.width, down, image.height));
    Image { pixels: (0..image.pixels.len()).map(pixel).collect(), ..*image }
}
