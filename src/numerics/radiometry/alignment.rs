//! Whether the frames of a bracket show the same picture: what shift and blur between two exposures explains their difference.

use super::bracket::Bracket;
use super::response::Response;
use nalgebra::{Matrix4, Vector4};

/// Two exposures that follow each other, shorter first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Index of the shorter one.
    pub shorter: usize,
    /// Index of the longer one.
    pub longer: usize,
    /// How far the picture moved from the shorter to the longer one: right, down, pixels.
    pub shift_px: [f64; 2],
    /// Their standard error.
    pub shift_sigma_px: [f64; 2],
    /// Standard deviation of a Gaussian that would blur one as the other is, pixels; positive if the longer one is the blurred.
    pub blur_px: f64,
    /// The same, squared and halved, with its standard error: what is measured.
    pub half_blur_squared: (f64, f64),
}

impl Step {
    /// Shifts below half a pixel do no harm.
    const MOVED_PX: f64 = 0.5;
    const BLURRED_PX: f64 = 1.5;
    /// Standard errors that make a difference sure.
    const SURE: f64 = 6.0;

    /// True if the picture moved.
    pub fn moved(&self) -> bool {
        let [x, y] = [0, 1].map(|i| self.shift_px[i].abs() > Self::SURE * self.shift_sigma_px[i]);
        (x || y) && self.distance_px() > Self::MOVED_PX
    }

    /// True if one of the two is clearly less sharp.
    pub fn blurred(&self) -> bool {
        let (half, sigma) = self.half_blur_squared;
        self.blur_px.abs() > Self::BLURRED_PX && half.abs() > Self::SURE * sigma
    }

    /// Length of the shift, pixels.
    pub fn distance_px(&self) -> f64 {
        self.shift_px[0].hypot(self.shift_px[1])
    }
}

/// Levels used: clear of black and clipping.
const LEVELS: std::ops::RangeInclusive<u8> = 8..=240;
/// Least mean level of a square in the shorter exposure, as the longer one tells it. Were it the shorter one's own noisy levels that
/// decide, the squares at a dark rim would be those in which noise happens to be bright there, which looks like a blur of the longer.
const DARKEST_MEAN: usize = 24;
/// Half the side of the square that is averaged against noise, and the step of the differences, pixels.
const HALF: usize = 2;
const STEP: usize = 3;
/// Points looked at, at most and at least.
const MAX_POINTS: usize = 40_000;
const MIN_POINTS: usize = 500;
const GREEN: usize = 1;

/// Compares every exposure with the next longer one through `response`, on green; none where too little is exposed in both.
///
/// With L the log exposure less the log time, L_longer - L_shorter is, to first order, -(shift . grad L) + blur^2 / 2 laplacian L
/// (Lucas & Kanade 1981, with a term for blur): a linear least-squares fit in four unknowns over the whole picture. L is the mean of
/// both weighted with their times, as photon noise goes: only then is its noise no part of that of the difference. In a plain mean the
/// noisier shorter exposure makes smooth surfaces look up to 2.7 px blurred in the longer one, without any blur.
pub fn steps(bracket: &Bracket, response: &Response) -> Vec<Step> {
    (1..bracket.exposures().len()).filter_map(|longer| step(bracket, response, longer - 1, longer)).collect()
}

fn step(bracket: &Bracket, response: &Response, shorter: usize, longer: usize) -> Option<Step> {
    let (width, height) = (bracket.width(), bracket.height());
    let margin = HALF + STEP;
    if width <= 2 * margin || height <= 2 * margin {
        return None;
    }
    let stride = ((width * height) as f64 / MAX_POINTS as f64).sqrt().ceil().max(1.0) as usize;
    let mean = |frame: usize, x: usize, y: usize| box_mean(bracket, response, frame, x, y);
    let own_times = [shorter, longer].map(|frame| bracket.exposures()[frame].time_s);
    let [of_shorter, of_longer] = own_times.map(|time| time / (own_times[0] + own_times[1]));
    let darkest = response.log_exposure[GREEN][DARKEST_MEAN] - own_times[0].ln();
    let (mut normal, mut rhs, mut squares, mut points) = (Matrix4::zeros(), Vector4::zeros(), 0.0, 0_usize);
    for y in (margin..height - margin).step_by(stride) {
        for x in (margin..width - margin).step_by(stride) {
            let both = |x, y| {
                let longer = mean(longer, x, y).filter(|mean| *mean > darkest)?;
                Some((mean(shorter, x, y)?, longer))
            };
            let around = [(x + STEP, y), (x - STEP, y), (x, y + STEP), (x, y - STEP)].map(|(x, y)| both(x, y));
            let (Some(centre), [Some(right), Some(left), Some(below), Some(above)]) = (both(x, y), around) else {
                continue;
            };
            let [c, r, l, b, a] = [centre, right, left, below, above].map(|(s, l)| of_shorter * s + of_longer * l);
            let step = STEP as f64;
            let row = Vector4::new(
                1.0,
                -(r - l) / (2.0 * step),
                -(b - a) / (2.0 * step),
                (r + l + b + a - 4.0 * c) / (step * step),
            );
            let difference = centre.1 - centre.0;
            normal += row * row.transpose();
            rhs += row * difference;
            squares += difference * difference;
            points += 1;
        }
    }
    if points < MIN_POINTS {
        return None;
    }
    let inverse = normal.try_inverse()?;
    let found = inverse * rhs;
    // Neighbouring squares share pixels where the stride is short: that many points are worth fewer.
    let shared = ((2 * HALF + 1) as f64 / stride as f64).max(1.0).powi(2);
    let variance = (squares - found.dot(&rhs)).max(0.0) / points as f64 * shared;
    let sigma = |i: usize| (variance * inverse[(i, i)]).max(0.0).sqrt();
    Some(Step {
        shorter,
        longer,
        shift_px: [found[1], found[2]],
        shift_sigma_px: [sigma(1), sigma(2)],
        blur_px: (2.0 * found[3].abs()).sqrt().copysign(found[3]),
        half_blur_squared: (found[3], sigma(3)),
    })
}

/// Mean log exposure of a square, none if one of its pixels is too dark or too bright.
fn box_mean(bracket: &Bracket, response: &Response, frame: usize, x: usize, y: usize) -> Option<f64> {
    let picture = &bracket.exposures()[frame].levels;
    let mut sum = 0.0;
    for row in y - HALF..=y + HALF {
        let start = row * picture.width + x;
        for pixel in &picture.pixels[start - HALF..=start + HALF] {
            if !LEVELS.contains(&pixel[GREEN]) {
                return None;
            }
            sum += response.log_exposure[GREEN][usize::from(pixel[GREEN])];
        }
    }
    let count = ((2 * HALF + 1) * (2 * HALF + 1)) as f64;
    Some(sum / count - bracket.exposures()[frame].time_s.ln())
}
