//! How the simulated lens gathers light: the mean over a pixel's area, then its blur.

use crate::numerics::geometry::{Projection, Ray};
use crate::numerics::image::Image;
use rayon::prelude::*;

/// Rays per pixel and axis, and where these differ.
const COARSE: usize = 4;
const FINE: usize = 12;
/// Rays that differ by this part of the brightest show an edge or a spot.
const DIFFERS: f64 = 0.1;

/// Mean radiance over the area of every pixel inside `bounds` (left, top, right, bottom); black outside.
pub(super) fn gather(
    projection: &Projection,
    (width, height): (usize, usize),
    bounds: [usize; 4],
    radiance: impl Fn(&Ray) -> [f64; 3] + Sync,
) -> Image<[f64; 3]> {
    let mut image = Image::filled(width, height, [0.0; 3]);
    let [left, top, right, bottom] = bounds;
    image.pixels.par_chunks_mut(width.max(1)).enumerate().skip(top).take(bottom.saturating_sub(top)).for_each(
        |(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate().take(right).skip(left) {
                *pixel = mean(projection, (x as f64, y as f64), &radiance);
            }
        },
    );
    image
}

/// Mean over one pixel: few rays where they agree, many where they do not. Inside a pixel the lens' distortion is straight.
fn mean(projection: &Projection, (x, y): (f64, f64), radiance: &impl Fn(&Ray) -> [f64; 3]) -> [f64; 3] {
    let corner = projection.ray(x, y);
    let across = projection.ray(x + 1.0, y).direction - corner.direction;
    let down = projection.ray(x, y + 1.0).direction - corner.direction;
    let rays = |n: usize| {
        let part = move |i: usize| (i as f64 + 0.5) / n as f64;
        (0..n * n).map(move |k| {
            let direction = corner.direction + across * part(k % n) + down * part(k / n);
            radiance(&Ray { origin: corner.origin, direction: direction.normalize() })
        })
    };
    let (mut sum, mut least, mut most) = ([0.0; 3], f64::INFINITY, 0.0_f64);
    for value in rays(COARSE) {
        sum = std::array::from_fn(|c| sum[c] + value[c]);
        (least, most) = (least.min(value[1]), most.max(value[1]));
    }
    if most - least <= DIFFERS * most {
        return sum.map(|s| s / (COARSE * COARSE) as f64);
    }
    let sum = rays(FINE).fold([0.0; 3], |sum, value| std::array::from_fn(|c| sum[c] + value[c]));
    sum.map(|s| s / (FINE * FINE) as f64)
}

/// Blur by a Gaussian of `sigma` pixels, rows then columns; black beyond the border. Nothing for 0.
pub(super) fn blur(image: Image<[f64; 3]>, sigma: f64) -> Image<[f64; 3]> {
    if sigma <= 0.0 {
        return image;
    }
    let reach = (5.0 * sigma).ceil() as usize;
    let kernel: Vec<f64> =
        (0..=2 * reach).map(|i| (-0.5 * ((i as f64 - reach as f64) / sigma).powi(2)).exp()).collect();
    let total: f64 = kernel.iter().sum();
    let kernel: Vec<f64> = kernel.iter().map(|k| k / total).collect();
    pass(&pass(&image, &kernel, (1, 0)), &kernel, (0, 1))
}

/// One pass of the blur along (x, y).
fn pass(image: &Image<[f64; 3]>, kernel: &[f64], (along, down): (usize, usize)) -> Image<[f64; 3]> {
    let reach = kernel.len() / 2;
    let mut out = Image::filled(image.width, image.height, [0.0; 3]);
    out.pixels.par_chunks_mut(image.width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            for (k, weight) in kernel.iter().enumerate() {
                let (u, v) = (x + k * along, y + k * down);
                let (from_x, from_y) = (reach * along, reach * down);
                if u >= from_x && v >= from_y && u - from_x < image.width && v - from_y < image.height {
                    let other = image.at(u - from_x, v - from_y);
                    *pixel = std::array::from_fn(|c| pixel[c] + weight * other[c]);
                }
            }
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blurred_point_keeps_its_light_place_and_width() {
        let mut image = Image::filled(21, 17, [0.0; 3]);
        image.pixels[8 * 21 + 10] = [1.0, 2.0, 3.0];
        let blurred = blur(image, 1.2);
        let moment = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
            let at = |i: usize| ((i % 21) as f64 - 10.0, (i / 21) as f64 - 8.0);
            blurred.pixels.iter().enumerate().map(|(i, p)| p[1] / 2.0 * f(at(i).0, at(i).1)).sum()
        };
        assert!((moment(&|_, _| 1.0) - 1.0).abs() < 1e-6);
        assert!(moment(&|x, _| x).abs() < 1e-9 && moment(&|_, y| y).abs() < 1e-9);
        assert!((moment(&|x, _| x * x) - 1.44).abs() < 1e-3 && (moment(&|_, y| y * y) - 1.44).abs() < 1e-3);
    }
}
