//! A picture for people: measured radiance above, fitted below, for some of the lights; then the weight maps.

use super::fit::FitResult;
use crate::numerics::brdf;
use crate::numerics::fit::predict;
use crate::numerics::image::Image;

/// Lights shown at most.
const COLUMNS: usize = 4;

/// Gap between the pictures, pixels.
const GAP: usize = 4;

/// Display exponent; the picture is for looking, not for measuring.
const DISPLAY_GAMMA: f64 = 1.0 / 2.2;

/// Measured (top), fitted (middle) and weight maps (bottom), cropped to the object. White is the 99.5th percentile of the
/// measured radiance.
pub fn preview(result: &FitResult) -> Image<[u8; 3]> {
    let frame = Frame::of(result);
    let white = white_level(result);
    let shown = shown_lights(result);
    let columns = shown.len().max(result.mixture.materials.len());
    let mut sheet = Image::filled(columns * (frame.width + GAP) + GAP, 3 * (frame.height + GAP) + GAP, [24_u8; 3]);
    let Some(lobe) = brdf::by_name(&result.material.model) else { return sheet };
    let display = |rgb: [f64; 3]| rgb.map(|v| (255.0 * (v / white).clamp(0.0, 1.0).powf(DISPLAY_GAMMA)).round() as u8);
    for point in 0..result.observations.points() {
        let gamma = result.mixture.weights_of(point);
        for sample in result.observations.of(point) {
            let Some(column) = shown.iter().position(|&light| light == sample.light) else { continue };
            let model = predict(lobe, &result.mixture.materials, gamma, &sample);
            frame.put(&mut sheet, column, 0, result.observations.pixel[point], display(sample.radiance));
            frame.put(&mut sheet, column, 1, result.observations.pixel[point], display(model));
        }
        for (column, weight) in gamma.iter().enumerate() {
            let grey = [(255.0 * weight.clamp(0.0, 1.0)).round() as u8; 3];
            frame.put(&mut sheet, column, 2, result.observations.pixel[point], grey);
        }
    }
    sheet
}

/// Relative error that is white in [`residuals`].
const WORST: f64 = 0.1;

/// Mean over samples and channels of |I - model| / I at every point, cropped to the object: black is none, white 10 % and more.
pub fn residuals(result: &FitResult) -> Image<[u8; 3]> {
    let frame = Frame::of(result);
    let mut sheet = Image::filled(frame.width + 2 * GAP, frame.height + 2 * GAP, [24_u8; 3]);
    let Some(lobe) = brdf::by_name(&result.material.model) else { return sheet };
    for point in 0..result.observations.points() {
        let (mut error, mut count) = (0.0, 0.0);
        for sample in result.observations.of(point) {
            let model = predict(lobe, &result.mixture.materials, result.mixture.weights_of(point), &sample);
            error += (0..3).map(|c| (sample.radiance[c] - model[c]).abs() / sample.radiance[c]).sum::<f64>();
            count += 3.0;
        }
        let grey = [(255.0 * (error / f64::max(count, 1.0) / WORST).min(1.0)).round() as u8; 3];
        frame.put(&mut sheet, 0, 0, result.observations.pixel[point], grey);
    }
    sheet
}

/// The bounding box of all points.
struct Frame {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
    image_width: usize,
}

impl Frame {
    fn of(result: &FitResult) -> Self {
        let image_width = result.size[0];
        let xs = || result.observations.pixel.iter().map(|p| p % image_width);
        let ys = || result.observations.pixel.iter().map(|p| p / image_width);
        let (x, y) = (xs().min().unwrap_or(0), ys().min().unwrap_or(0));
        let (right, bottom) = (xs().max().unwrap_or(0), ys().max().unwrap_or(0));
        Self { x, y, width: right - x + 1, height: bottom - y + 1, image_width }
    }

    fn put(&self, sheet: &mut Image<[u8; 3]>, column: usize, row: usize, pixel: usize, colour: [u8; 3]) {
        let x = GAP + column * (self.width + GAP) + pixel % self.image_width - self.x;
        let y = GAP + row * (self.height + GAP) + pixel / self.image_width - self.y;
        sheet.pixels[y * sheet.width + x] = colour;
    }
}

fn white_level(result: &FitResult) -> f64 {
    let mut levels: Vec<f64> =
        result.observations.all().map(|s| s.radiance.iter().copied().fold(0.0, f64::max)).collect();
    levels.sort_by(f64::total_cmp);
    levels.get(levels.len().saturating_sub(1) * 995 / 1000).copied().unwrap_or(1.0)
}

fn shown_lights(result: &FitResult) -> Vec<usize> {
    let mut used: Vec<usize> = result.observations.all().map(|s| s.light).collect();
    used.sort_unstable();
    used.dedup();
    let count = used.len().min(COLUMNS);
    (0..count).map(|i| used[if count == 1 { 0 } else { i * (used.len() - 1) / (count - 1) }]).collect()
}
