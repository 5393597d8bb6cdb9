//! Pictures of the rig's balls: antialiased, blurred, noisy.

use super::forward::{Rig, normal};
use crate::numerics::geometry::{Projection, Vec3};
use crate::numerics::image::Image;
use rand::RngExt;

/// How a frame is exposed; levels are parts of the full scale.
#[derive(Clone, Copy, Debug)]
pub struct Exposure {
    /// Level of a white surface facing the lamp at 800 mm.
    pub diffuse: f64,
    /// Height of a highlight over the diffuse shading.
    pub spot: f64,
    /// Level of the background.
    pub background: f64,
    /// Standard deviation of the lens' blur, pixels.
    pub blur_px: f64,
    /// Noise of a dark pixel.
    pub read_noise: f64,
}

impl Exposure {
    /// One second: the balls stand out of the dark; highlights are clipped.
    pub const SILHOUETTE: Self = Self { diffuse: 0.6, spot: 20.0, background: 0.01, blur_px: 0.9, read_noise: 0.002 };
    /// 1/200 s: the highlights alone.
    pub const HIGHLIGHT: Self = Self { diffuse: 0.003, spot: 0.7, background: 0.0, blur_px: 0.9, read_noise: 0.002 };
}

/// Electrons at full scale.
const FULL_WELL: f64 = 40_000.0;
/// Width of a highlight (standard deviation), in parts of the ball's radius in the image: an uneven filament and the lacquer.
const SPOT: f64 = 0.006;

/// The frame under one lamp, levels 0 to 1; the highlight of ball b is moved by `moved[b]` pixels.
pub fn frame(rig: &Rig, lamp: usize, exposure: &Exposure, moved: &[[f64; 2]], random: &mut impl RngExt) -> Image<f32> {
    let mut image = Image::filled(rig.size.0, rig.size.1, exposure.background as f32);
    for (ball, moved) in moved.iter().enumerate().take(rig.balls.len()) {
        draw(&mut image, rig, ball, lamp, exposure, *moved);
    }
    for pixel in &mut image.pixels {
        let level = f64::from(*pixel);
        let sigma = (exposure.read_noise * exposure.read_noise + level.max(0.0) / FULL_WELL).sqrt();
        *pixel = (level + sigma * normal(random)).clamp(0.0, 1.0) as f32;
    }
    image
}

fn draw(image: &mut Image<f32>, rig: &Rig, ball: usize, lamp: usize, exposure: &Exposure, moved: [f64; 2]) {
    let edge = rig.outline(ball, 64);
    let margin = 6.0 * exposure.blur_px + 2.0;
    let bounds = |axis: usize| {
        let values = edge.iter().map(|p| p[axis]);
        (values.clone().fold(f64::INFINITY, f64::min) - margin, values.fold(f64::NEG_INFINITY, f64::max) + margin)
    };
    let ((left, right), (top, bottom)) = (bounds(0), bounds(1));
    let (left, top) = (left.max(0.0) as usize, top.max(0.0) as usize);
    let (right, bottom) = ((right as usize).min(image.width), (bottom as usize).min(image.height));
    let radius = 0.5 * (edge[0][0] - edge[32][0]).hypot(edge[0][1] - edge[32][1]);
    let middle = [0.5 * (edge[0][0] + edge[32][0]), 0.5 * (edge[0][1] + edge[32][1])];
    let mut patch = Image::filled(right.saturating_sub(left), bottom.saturating_sub(top), 0.0_f32);
    for y in 0..patch.height {
        for x in 0..patch.width {
            let (px, py) = ((left + x) as f64, (top + y) as f64);
            let off = ((px + 0.5 - middle[0]).hypot(py + 0.5 - middle[1]) - radius).abs();
            let cells = if off < 4.0 { 8 } else { 1 };
            let mut sum = 0.0;
            for k in 0..cells * cells {
                let at = |cell: usize| (cell as f64 + 0.5) / cells as f64;
                sum += shade(rig, ball, lamp, exposure, [px + at(k % cells), py + at(k / cells)]);
            }
            patch.pixels[y * patch.width + x] = (sum / (cells * cells) as f64) as f32;
        }
    }
    let patch = blur(&patch, exposure.blur_px);
    let [u, v] = rig.highlight(ball, lamp);
    let (u, v, spread) = (u + moved[0], v + moved[1], (SPOT * radius).hypot(exposure.blur_px));
    for y in 0..patch.height {
        for x in 0..patch.width {
            let (dx, dy) = ((left + x) as f64 + 0.5 - u, (top + y) as f64 + 0.5 - v);
            let spot = exposure.spot * (-0.5 * (dx * dx + dy * dy) / (spread * spread)).exp();
            image.pixels[(top + y) * image.width + left + x] = *patch.at(x, y) + spot as f32;
        }
    }
}

/// Level at a place of the image: Lambert's shading of the ball, or the background.
fn shade(rig: &Rig, ball: usize, lamp: usize, exposure: &Exposure, at: [f64; 2]) -> f64 {
    let Projection::Pinhole { focal_px, principal_px, .. } = &rig.projection else { return exposure.background };
    let d = Vec3::new((at[0] - principal_px[0]) / focal_px[0], (at[1] - principal_px[1]) / focal_px[1], 1.0);
    let c = rig.balls[ball];
    // |t d - c| = r
    let (a, b, e) = (d.norm_squared(), d.dot(&c), c.norm_squared() - rig.radius * rig.radius);
    let root = b * b - a * e;
    if root < 0.0 {
        return exposure.background;
    }
    let point = d * ((b - root.sqrt()) / a);
    let to_lamp = rig.lamps[lamp] - point;
    let cosine = (point - c).dot(&to_lamp) / (rig.radius * to_lamp.norm());
    exposure.background * 0.5 + exposure.diffuse * cosine.max(0.0) * 640_000.0 / to_lamp.norm_squared()
}

/// Gaussian blur, rows then columns; the border repeats.
fn blur(image: &Image<f32>, sigma: f64) -> Image<f32> {
    let reach = (5.0 * sigma).ceil() as usize;
    let kernel: Vec<f64> =
        (0..=2 * reach).map(|i| (-0.5 * ((i as f64 - reach as f64) / sigma).powi(2)).exp()).collect();
    let total: f64 = kernel.iter().sum();
    let pass = |image: &Image<f32>, (across, down): (usize, usize)| {
        let mut out = image.clone();
        for y in 0..image.height {
            for x in 0..image.width {
                let mut sum = 0.0;
                for (k, weight) in kernel.iter().enumerate() {
                    let u = (x + k * across).saturating_sub(reach * across).min(image.width - 1);
                    let v = (y + k * down).saturating_sub(reach * down).min(image.height - 1);
                    sum += weight * f64::from(*image.at(u, v));
                }
                out.pixels[y * image.width + x] = (sum / total) as f32;
            }
        }
        out
    };
    pass(&pass(image, (1, 0)), (0, 1))
}
