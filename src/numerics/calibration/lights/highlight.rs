//! The highlight of a lamp on a ball, to subpixel: the centroid of a spot on top of a local plane.

use super::balls::Ball;
use super::outline::median;
use crate::numerics::geometry::Projection;
use crate::numerics::image::Image;
use nalgebra::{Matrix3, Vector3};

/// A frame of highlights.
#[derive(Clone, Debug)]
pub struct Spots {
    /// Linear levels or radiance.
    pub level: Image<f32>,
    /// True where the level is not known for being too bright.
    pub clipped: Image<bool>,
}

/// A highlight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Highlight {
    /// Where, pixels.
    pub at: [f64; 2],
    /// Standard deviation in x and in y, pixels.
    pub sigma_px: f64,
    /// Clipped pixels in the spot.
    pub clipped: usize,
    /// Distance from the ball's centre in parts of the outline's radius.
    pub eccentricity: f64,
}

/// Why a ball's highlight cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum HighlightFault {
    /// Nothing stands out.
    #[error("no highlight stands out: is the lamp on, and does the ball mirror it towards the camera?")]
    Missing,
    /// A bright area, no spot.
    #[error(
        "no spot but a bright area of {percent:.0} % of the ball: expose it shorter, so that only the highlight is left"
    )]
    Area {
        /// Share of the ball's disc.
        percent: f64,
    },
    /// On the outline, where the normal is not known.
    #[error("the highlight lies on the rim ({percent:.0} % of the radius): move the ball or leave this light out")]
    Rim {
        /// Distance from the centre in parts of the radius, percent.
        percent: f64,
    },
    /// Two spots.
    #[error(
        "two highlights, at ({:.1}, {:.1}) and ({:.1}, {:.1}) px, the second {percent:.0} % as bright: switch off every other lamp and cover the windows",
        first[0], first[1], second[0], second[1]
    )]
    Doubled {
        /// The brighter one, pixels.
        first: [f64; 2],
        /// The other one, pixels.
        second: [f64; 2],
        /// Height of the second, percent of the first.
        percent: f64,
    },
}

/// What an uneven filament and the ball's lacquer leave of a centroid's accuracy, pixels.
pub const LEAST_SIGMA_PX: f64 = 0.05;
/// A clipped spot's middle is a guess.
const CLIPPED_SIGMA_PX: f64 = 0.2;
/// Beyond this distance the spot is cut by the outline, and a pixel is 4 times its angle in the middle.
const RIM: f64 = 0.97;
/// A second spot of this height is another lamp's, in parts of the first.
const SECOND: f64 = 0.25;
/// Largest part of the disc that counts as a spot.
const LARGEST_AREA: f64 = 0.05;

/// Finds the one highlight on a ball.
///
/// # Errors
/// No highlight, more than one, a bright area, or one on the rim.
pub fn find(frame: &Spots, projection: &Projection, ball: &Ball) -> Result<Highlight, HighlightFault> {
    let disc = Disc::new(frame, projection, ball);
    let first = disc.brightest(None).ok_or(HighlightFault::Missing)?;
    let spot = disc.spot(first)?;
    if let Some(other) = disc.brightest(Some(&spot))
        && let Ok(second) = disc.spot(other)
        // A window on the first one's skirt walks back to it.
        && (second.at[0] - spot.at[0]).hypot(second.at[1] - spot.at[1]) > spot.window
        && second.height > SECOND * spot.height
        && second.height > 10.0 * second.noise
    {
        let percent = 100.0 * second.height / spot.height;
        return Err(HighlightFault::Doubled { first: spot.at, second: second.at, percent });
    }
    let eccentricity = 1.0 + ball.outline.distance(projection, spot.at) / disc.radius;
    if eccentricity > RIM {
        return Err(HighlightFault::Rim { percent: 100.0 * eccentricity });
    }
    let floor = if spot.clipped > 0 { CLIPPED_SIGMA_PX } else { LEAST_SIGMA_PX };
    Ok(Highlight { at: spot.at, sigma_px: spot.sigma.hypot(floor), clipped: spot.clipped, eccentricity })
}

struct Spot {
    at: [f64; 2],
    /// Statistical standard deviation, pixels.
    sigma: f64,
    height: f64,
    /// Noise of a pixel.
    noise: f64,
    clipped: usize,
    /// Radius of the window it was measured in, pixels.
    window: f64,
}

/// The pixels of a ball.
struct Disc<'a> {
    frame: &'a Spots,
    radius: f64,
    /// Pixels inside the outline.
    pixels: Vec<(usize, usize)>,
    /// Their median level.
    median: f64,
}

impl<'a> Disc<'a> {
    fn new(frame: &'a Spots, projection: &Projection, ball: &Ball) -> Self {
        let radius = ball.outline.radius_px(projection);
        let center = ball.outline.center_px(projection);
        let (width, height) = (frame.level.width, frame.level.height);
        let span = |middle: f64, most: usize| {
            let reach = 1.3 * radius;
            (middle - reach).max(0.0) as usize..((middle + reach).max(0.0) as usize).min(most)
        };
        let mut pixels = Vec::new();
        for y in span(center[1], height) {
            for x in span(center[0], width) {
                if ball.outline.distance(projection, [x as f64 + 0.5, y as f64 + 0.5]) < 0.0 {
                    pixels.push((x, y));
                }
            }
        }
        let median = median(pixels.iter().map(|&(x, y)| f64::from(*frame.level.at(x, y))).collect());
        Self { frame, radius, pixels, median }
    }

    /// Mean over 3 x 3 pixels: a single hot pixel is no highlight.
    fn smooth(&self, x: usize, y: usize) -> f64 {
        let image = &self.frame.level;
        let (x, y) = (x.clamp(1, image.width - 2), y.clamp(1, image.height - 2));
        (0..9).map(|k| f64::from(*image.at(x + k % 3 - 1, y + k / 3 - 1))).sum::<f64>() / 9.0
    }

    /// The brightest pixel, or the brightest away from a spot.
    fn brightest(&self, but: Option<&Spot>) -> Option<(usize, usize)> {
        let away = |&(x, y): &(usize, usize)| {
            but.is_none_or(|spot| (x as f64 + 0.5 - spot.at[0]).hypot(y as f64 + 0.5 - spot.at[1]) > 2.0 * spot.window)
        };
        let level = |&(x, y): &(usize, usize)| ((x, y), self.smooth(x, y));
        let (pixel, _) = self.pixels.iter().filter(|p| away(p)).map(level).max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(pixel)
    }

    /// Pixels around `peak` that reach half its height over the disc's median.
    fn half_area(&self, peak: (usize, usize)) -> usize {
        let level = 0.5 * (self.smooth(peak.0, peak.1) + self.median);
        let (width, height) = (self.frame.level.width, self.frame.level.height);
        let mut seen = std::collections::HashSet::from([peak]);
        let mut open = vec![peak];
        let most = (LARGEST_AREA * self.pixels.len() as f64) as usize + 9;
        while let Some((x, y)) = open.pop() {
            let beside = [(x + 1, y), (x, y + 1), (x.wrapping_sub(1), y), (x, y.wrapping_sub(1))];
            for next in beside.into_iter().filter(|&(x, y)| x < width && y < height) {
                if self.smooth(next.0, next.1) > level && seen.insert(next) {
                    open.push(next);
                }
            }
            if seen.len() > most {
                break;
            }
        }
        seen.len()
    }

    /// Measures the spot at a peak.
    fn spot(&self, peak: (usize, usize)) -> Result<Spot, HighlightFault> {
        let area = self.half_area(peak);
        let percent = 100.0 * area as f64 / self.pixels.len().max(1) as f64;
        if percent > 100.0 * LARGEST_AREA && area > 12 {
            return Err(HighlightFault::Area { percent });
        }
        let window = (2.5 * (area as f64 / std::f64::consts::PI).sqrt()).max(3.0);
        let mut at = [peak.0 as f64 + 0.5, peak.1 as f64 + 0.5];
        let mut spot = None;
        for _ in 0..10 {
            let next = self.centroid(at, window).ok_or(HighlightFault::Missing)?;
            let moved = (next.at[0] - at[0]).hypot(next.at[1] - at[1]);
            at = next.at;
            spot = Some(next);
            if moved < 1e-4 {
                break;
            }
        }
        spot.filter(|spot| spot.height > 6.0 * spot.noise && spot.height > 0.0).ok_or(HighlightFault::Missing)
    }

    /// One centroid over the pixels of a window that rise above a tenth of the spot's height over the plane through the ring
    /// around it; the threshold is subtracted, so that pixels enter and leave without a jump.
    fn centroid(&self, at: [f64; 2], window: f64) -> Option<Spot> {
        let image = &self.frame.level;
        let reach = window + window.max(3.0);
        let span = |middle: f64, most: usize| {
            (middle - reach - 1.0).max(0.0) as usize..((middle + reach + 1.0).max(0.0) as usize).min(most)
        };
        let (mut inner, mut ring) = (Vec::new(), Vec::new());
        for y in span(at[1], image.height) {
            for x in span(at[0], image.width) {
                let (dx, dy) = (x as f64 + 0.5 - at[0], y as f64 + 0.5 - at[1]);
                let pixel = (dx, dy, f64::from(*image.at(x, y)), *self.frame.clipped.at(x, y));
                match dx.hypot(dy) {
                    d if d <= window => inner.push(pixel),
                    d if d <= reach => ring.push(pixel),
                    _ => {}
                }
            }
        }
        let (plane, noise) = plane(&ring)?;
        let above = |&(dx, dy, level, _): &(f64, f64, f64, bool)| level - plane.dot(&Vector3::new(dx, dy, 1.0));
        let height = inner.iter().map(above).fold(0.0, f64::max);
        let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
        for pixel in &inner {
            let weight = (above(pixel) - 0.1 * height).max(0.0);
            sum += weight;
            x += weight * pixel.0;
            y += weight * pixel.1;
        }
        if sum <= 0.0 {
            return None;
        }
        let (x, y) = (x / sum, y / sum);
        let lever: f64 =
            inner.iter().filter(|p| above(p) > 0.1 * height).map(|p| (p.0 - x).powi(2) + (p.1 - y).powi(2)).sum();
        let clipped = inner.iter().filter(|p| p.3 && above(p) > 0.1 * height).count();
        Some(Spot {
            at: [at[0] + x, at[1] + y],
            sigma: noise * (0.5 * lever).sqrt() / sum,
            height,
            noise,
            clipped,
            window,
        })
    }
}

/// The plane through levels around a spot (two rounds without what stands out), and their scatter about it.
fn plane(ring: &[(f64, f64, f64, bool)]) -> Option<(Vector3<f64>, f64)> {
    let mut fitted = Vector3::zeros();
    let mut scatter = f64::INFINITY;
    for _ in 0..3 {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        let residual = |p: &(f64, f64, f64, bool)| (p.2 - fitted.dot(&Vector3::new(p.0, p.1, 1.0))).abs();
        for pixel in ring.iter().filter(|p| scatter.is_infinite() || residual(p) <= 3.0 * scatter) {
            let row = Vector3::new(pixel.0, pixel.1, 1.0);
            normal += row * row.transpose();
            right += row * pixel.2;
        }
        fitted = normal.try_inverse()? * right;
        let off = ring.iter().map(|p| (p.2 - fitted.dot(&Vector3::new(p.0, p.1, 1.0))).abs());
        scatter = 1.4826 * median(off.collect());
    }
    Some((fitted, scatter))
}
