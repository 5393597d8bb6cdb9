//! Pictures of balls as the finders take them: linear levels, and which of them are clipped.

use crate::numerics::calibration::lights::highlight::Spots;
use crate::numerics::image::{Image, RadianceImage};
use crate::numerics::radiometry::response::Response;

/// Levels from here on count as clipped: a camera's curve is flat there.
const CLIPPED: u8 = 250;

/// Levels of a camera's picture, undone by the sRGB curve: edges and centroids need straight levels, and any camera's curve is
/// nearer to sRGB's than to a straight line. Grey is the mean of the channels; 1 is full scale.
pub fn from_levels(picture: &Image<[u8; 3]>) -> Spots {
    let linear: Vec<f32> = (0..=255_u8).map(|level| srgb(f32::from(level) / 255.0) / 3.0).collect();
    from_table(picture, [linear.as_slice(); 3])
}

/// A third of every channel's exposure by level.
fn from_table(picture: &Image<[u8; 3]>, linear: [&[f32]; 3]) -> Spots {
    let grey = |p: &[u8; 3]| p.iter().zip(linear).map(|(&level, linear)| linear[usize::from(level)]).sum();
    let map = |pixels| Image { width: picture.width, height: picture.height, pixels };
    Spots {
        level: map(picture.pixels.iter().map(grey).collect()),
        clipped: Image {
            width: picture.width,
            height: picture.height,
            pixels: picture.pixels.iter().map(|p| p.iter().any(|&c| c >= CLIPPED)).collect(),
        },
    }
}

fn srgb(level: f32) -> f32 {
    if level <= 0.04045 { level / 12.92 } else { ((level + 0.055) / 1.055).powf(2.4) }
}

/// Levels of a camera's picture through its measured response: exposures, mean of the channels, 1 at the response's reference level.
pub fn through_response(picture: &Image<[u8; 3]>, response: &Response) -> Spots {
    let linear: [Vec<f32>; 3] =
        response.log_exposure.each_ref().map(|curve| curve.iter().map(|g| (g.exp() / 3.0) as f32).collect());
    from_table(picture, [0, 1, 2].map(|c: usize| linear[c].as_slice()))
}

/// A patch whose surroundings reach this part of the brightest pixel is taken for clipped, not for dark: what surrounds a spot that
/// was clipped in every exposure is nearly so itself, and darkness is surrounded by what the longest exposure just shows.
const CLIPPED_SURROUNDINGS: f64 = 0.1;

/// Mean radiance of the channels. Pixels that are not valid take the mean of the valid ones around their patch: a spot clipped in
/// every exposure stays bright, darkness stays dark.
pub fn from_radiance(image: &RadianceImage) -> Spots {
    let (width, height) = (image.radiance.width, image.radiance.height);
    let mut level: Vec<f32> = image.radiance.pixels.iter().map(|p| p.iter().sum::<f32>() / 3.0).collect();
    let invalid: Vec<bool> = image.valid.pixels.iter().map(|v| !v).collect();
    let brightest = level.iter().zip(&invalid).filter(|(_, invalid)| !**invalid).map(|(l, _)| *l).fold(0.0, f32::max);
    let mut clipped = invalid.clone();
    let mut seen = vec![false; level.len()];
    for start in 0..level.len() {
        if !invalid[start] || seen[start] {
            continue;
        }
        let (mut patch, mut open) = (Vec::new(), vec![start]);
        let (mut sum, mut count) = (0.0_f64, 0_usize);
        seen[start] = true;
        while let Some(i) = open.pop() {
            patch.push(i);
            let (x, y) = (i % width, i / width);
            let beside = [
                (x > 0).then(|| i - 1),
                (x + 1 < width).then(|| i + 1),
                (y > 0).then(|| i - width),
                (y + 1 < height).then(|| i + width),
            ];
            for next in beside.into_iter().flatten() {
                if !invalid[next] {
                    sum += f64::from(level[next]);
                    count += 1;
                } else if !seen[next] {
                    seen[next] = true;
                    open.push(next);
                }
            }
        }
        let mean = (sum / count.max(1) as f64) as f32;
        let dark = count > 0 && f64::from(mean) < CLIPPED_SURROUNDINGS * f64::from(brightest);
        for i in patch {
            level[i] = mean;
            clipped[i] = !dark;
        }
    }
    Spots { level: Image { width, height, pixels: level }, clipped: Image { width, height, pixels: clipped } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spot_clipped_in_every_exposure_stays_bright_and_the_dark_stays_dark() {
        let mut image =
            RadianceImage { radiance: Image::filled(9, 5, [1.0; 3]), variance: None, valid: Image::filled(9, 5, true) };
        // A bright ring about pixel (2, 2), which is clipped; pixel (7, 2) is too dark.
        for (x, y) in [(1, 2), (3, 2), (2, 1), (2, 3)] {
            image.radiance.pixels[y * 9 + x] = [100.0; 3];
        }
        for x in [2, 7] {
            image.radiance.pixels[2 * 9 + x] = [0.0; 3];
            image.valid.pixels[2 * 9 + x] = false;
        }
        let spots = from_radiance(&image);
        assert_eq!((*spots.level.at(2, 2), *spots.level.at(7, 2)), (100.0, 1.0));
        assert_eq!((*spots.clipped.at(2, 2), spots.clipped.pixels.iter().filter(|c| **c).count()), (true, 1));
    }
}
