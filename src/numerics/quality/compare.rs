//! One frame against another of the same bracket.

use super::look::{CLIPPED, DARK, Look, Sample};
use super::transfer::Transfer;

/// A frame whose lit samples have less than this share of the predicted level is black; samples are lit from the second level on.
const BLACK: f64 = 0.25;
const BRIGHT: f64 = 40.0;
/// Predicted levels that exposures are read from; from lower ones where the curve was learned.
const PREDICTED: std::ops::Range<f64> = 18.0..225.0;
const LEARNED_FROM: f64 = 8.0;
/// Samples that must be seen in both frames for anything to be said.
const ENOUGH: usize = 64;
/// Two exposures of one scene agree in so few samples to the last bit that more are one picture twice.
const SAME: f64 = 0.9;
/// The natural logarithm of the ratio of exposures may be off by this much when the camera's curve is only assumed: absolute, and of
/// itself. Tone curves of cameras are up to half again as steep as the assumed one.
const ASSUMED: (f64, f64) = (0.15, 0.6);
/// The same when the curve was learned: shutters and lamps repeat to 1 or 2 %.
const LEARNED: f64 = 0.06;
/// Samples from which small changes of the lamp are read, and how much larger the error is than one frame's noise makes it: the
/// curve was learned from noisy frames, too. Measured on simulated frames.
const MANY: usize = 1000;
const LEARNED_ERROR: f64 = 2.5;
/// Noise of a sample's level.
const NOISE: f32 = 0.9;
/// Ratio of exposures up to which dark levels are predicted.
const NEAR: f64 = 4.5;
/// Share of the samples that may deviate by more than noise and edges explain.
const DEVIATING: f64 = 0.015;
/// Levels by which the background may differ from what the other frame's predicts.
const BACKGROUND: f64 = 3.5;
/// A frame is blurred if its edges have less than this share of the steepness that the other's have.
const SHARP: f64 = 0.6;
/// Edges that are looked at: steeper than this in both the frame and its prediction, levels between neighbours.
const EDGE: f32 = 24.0;
const EDGES: usize = 40;

/// What is wrong with a frame, with what was expected and seen.
#[derive(Clone, Debug, PartialEq)]
pub enum Doubt {
    /// The other frame's picture again.
    SamePicture,
    /// Brightness against the other frame: ratios of the exposures.
    Exposure {
        /// By their times.
        expected: f64,
        /// By the pictures.
        seen: f64,
    },
    /// Black where the other frame predicts a picture: mean level of what is bright there.
    Black {
        /// Predicted.
        expected: f64,
        /// Seen.
        seen: f64,
    },
    /// The dark background is not as dark as the other frame says: levels.
    Background {
        /// Predicted.
        expected: f64,
        /// Seen.
        seen: f64,
    },
    /// Part of it does not show what the other frame shows: shares of the samples.
    Deviates {
        /// At most on sound frames.
        expected: f64,
        /// Seen.
        seen: f64,
    },
    /// Edges are less steep, or steeper, than in the other frame: relative steepness.
    Blurred {
        /// Of the sharper one.
        expected: f64,
        /// Seen.
        seen: f64,
    },
}

/// What two frames say of each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Compared {
    /// Samples that both show.
    pub samples: usize,
    /// By how much the second is brighter than its time and the first one's say, natural logarithm, with its standard error; only where
    /// the transfer was learned and enough is seen.
    pub brighter: Option<(f64, f64)>,
    /// What is wrong, the most telling first.
    pub doubts: Vec<Doubt>,
}

/// Compares `second` with `first`; `ratio` is second over first of the expected times, `learned` the curve of an earlier bracket of
/// these two exposures. None if the first shows nothing, or they are of different sizes.
pub fn compare(first: &Look, second: &Look, ratio: f64, learned: Option<&Transfer>) -> Option<Compared> {
    if !first.shows() || first.samples.len() != second.samples.len() {
        return None;
    }
    let only = |doubt| Some(Compared { samples: second.samples.len(), brighter: None, doubts: vec![doubt] });
    if same_picture(first, second) {
        return only(Doubt::SamePicture);
    }
    let both = seen_in_both(first, second, ratio, learned);
    let comparable = both.len() >= ENOUGH;
    if let Some(doubt) = black(first, second, &both, ratio) {
        return only(doubt);
    }
    let mut doubts = Vec::new();
    let (off, error) = if comparable { exposure(&both, ratio, learned.is_some()) } else { (0.0, f64::INFINITY) };
    let most = if learned.is_some() { LEARNED + 4.0 * error } else { ASSUMED.0 + ASSUMED.1 * ratio.ln().abs() };
    if off.abs() > most {
        doubts.push(Doubt::Exposure { expected: ratio, seen: ratio * off.exp() });
    }
    doubts.extend(background(first, second, ratio));
    let own = Transfer::of(first, second);
    doubts.extend(deviation(first, second, own.as_ref(), ratio * off.exp()));
    doubts.extend(own.and_then(|own| sharpness(first, second, &own)));
    let brighter = (both.len() >= MANY && learned.is_some()).then_some((off, LEARNED_ERROR * error));
    Some(Compared { samples: both.len(), brighter, doubts })
}

/// By how much the second of two frames of one scene and one exposure is brighter, natural logarithm and standard error; none where
/// too little of the first is well exposed, or they are of different sizes. Levels are read by the assumed curve: right to a few tenths
/// of itself.
pub fn brighter(first: &Look, second: &Look) -> Option<(f64, f64)> {
    if first.samples.len() != second.samples.len() {
        return None;
    }
    let both = seen_in_both(first, second, 1.0, None);
    (both.len() >= ENOUGH).then(|| exposure(&both, 1.0, false))
}

/// Exposure of a level over that of another, by the assumed curve: right to a few tenths of itself.
pub fn relative_exposure(level: f64, of: f64) -> f64 {
    assumed_exposure(level) / assumed_exposure(of)
}

/// The standard error to be expected of [`brighter`] if the frame is shot again; infinite where too little of it is well exposed.
pub fn expected_error(look: &Look) -> f64 {
    let both = seen_in_both(look, look, 1.0, None);
    let variance = |(_, _, level): &(Sample, Sample, f64)| (f64::from(NOISE) / assumed_slope(*level)).powi(2);
    let (n, sum) = (both.len() as f64, both.iter().map(variance).sum::<f64>());
    if both.len() < ENOUGH { f64::INFINITY } else { 1.3 * (2.0 * sum).sqrt() / n }
}

/// The lit samples are dark, those that are bright by prediction or, where the second is exposed longer, the brightest hundredth.
fn black(first: &Look, second: &Look, both: &[(Sample, Sample, f64)], ratio: f64) -> Option<Doubt> {
    let lit: Vec<(f64, f64)> =
        both.iter().filter(|(_, _, p)| *p >= BRIGHT).map(|(_, b, p)| (f64::from(b.level), *p)).collect();
    let (seen, expected) = if lit.len() >= ENOUGH {
        let sum = lit.iter().fold((0.0, 0.0), |sum, pair| (sum.0 + pair.0, sum.1 + pair.1));
        (sum.0 / lit.len() as f64, sum.1 / lit.len() as f64)
    } else if ratio >= 1.0 && f64::from(first.bright) >= BRIGHT {
        (f64::from(second.bright), f64::from(first.bright))
    } else {
        return None;
    };
    (seen < BLACK * expected).then_some(Doubt::Black { expected, seen })
}

/// Samples that are well exposed in the first frame and by prediction in the second, with that prediction.
fn seen_in_both(first: &Look, second: &Look, ratio: f64, learned: Option<&Transfer>) -> Vec<(Sample, Sample, f64)> {
    let predicted = |sample: &Sample| match learned {
        Some(curve) => curve.at(sample.level).map(|(level, _)| f64::from(level)),
        None => Some(assumed_level(assumed_exposure(f64::from(sample.level)) * ratio)),
    };
    let least = if learned.is_some() { LEARNED_FROM } else { PREDICTED.start };
    let pairs = first.samples.iter().zip(&second.samples).filter(|(a, _)| a.smooth());
    pairs
        .filter_map(|(a, b)| Some((*a, *b, predicted(a)?)))
        .filter(|(_, _, p)| (least..PREDICTED.end).contains(p))
        .collect()
}

fn same_picture(first: &Look, second: &Look) -> bool {
    let lit = |sample: &Sample| sample.level >= DARK && sample.level < CLIPPED;
    let pairs = first.samples.iter().zip(&second.samples).filter(|(a, b)| lit(a) || lit(b));
    let (mut all, mut same) = (0_usize, 0_usize);
    for (a, b) in pairs {
        all += 1;
        same += usize::from(a == b);
    }
    all >= ENOUGH && same as f64 > SAME * all as f64
}

/// By how much the second frame is brighter than predicted, natural logarithm of exposure, and its standard error. Levels are turned
/// into exposures by the assumed curve: of a small difference that is right to a few tenths of itself.
fn exposure(both: &[(Sample, Sample, f64)], ratio: f64, learned: bool) -> (f64, f64) {
    let mut offs: Vec<f64> = if learned {
        both.iter().map(|(_, b, p)| (f64::from(b.level) - p) / assumed_slope(*p)).collect()
    } else {
        let log = |sample: &Sample| assumed_exposure(f64::from(sample.level)).max(1e-5).ln();
        both.iter().map(|(a, b, _)| log(b) - log(a) - ratio.ln()).collect()
    };
    offs.sort_by(f64::total_cmp);
    let n = offs.len();
    let middle = &offs[n / 4..(3 * n).div_ceil(4)];
    let mean = middle.iter().sum::<f64>() / middle.len() as f64;
    let spread = (offs[3 * n / 4] - offs[n / 4]) / 1.35;
    (mean, 1.3 * spread / (n as f64).sqrt())
}

/// A lamp on an object before black leaves the background as it is; any other light does not.
fn background(first: &Look, second: &Look, ratio: f64) -> Option<Doubt> {
    let (a, b) = (f64::from(first.background), f64::from(second.background));
    if a > 200.0 {
        return None;
    }
    let level = |from: f64| assumed_level(assumed_exposure(from.max(0.0)) * ratio);
    let (low, high) = (level(0.7 * (a - 1.5)), level(1.4 * (a + 1.5)));
    let outside = b > high + BACKGROUND || b < low - BACKGROUND;
    outside.then(|| Doubt::Background { expected: level(a), seen: b })
}

/// Samples that do not follow the curve the others agree on. What is dark in the first is on no curve: it may become as bright as the
/// assumed curve says of a level more, or, over a ratio so large that it magnifies noise, of the darkest sample on the curve.
fn deviation(first: &Look, second: &Look, own: Option<&Transfer>, ratio: f64) -> Option<Doubt> {
    let level = |from: f32| assumed_level(assumed_exposure(f64::from(from)) * ratio) as f32;
    let most = |from: f32| if ratio < NEAR { level(1.2 * (from + 1.0)) } else { 1.25 * level(DARK).max(DARK) };
    let (mut all, mut off) = (0_usize, 0_usize);
    for (a, b) in first.samples.iter().zip(&second.samples) {
        let margin = 4.0 * NOISE + 0.9 * (a.range + b.range);
        if a.level < DARK {
            all += usize::from(b.level > DARK);
            off += usize::from(b.level > most(a.level) + margin + BACKGROUND as f32);
        } else if a.level >= CLIPPED {
            all += usize::from(ratio >= 1.0);
            off += usize::from(ratio >= 1.0 && b.level < 215.0 - margin);
        } else if let Some((level, slope)) = own.and_then(|own| own.at(a.level)) {
            all += 1;
            let slope = slope.clamp(0.0, 5.0);
            let allowed = 4.0 * NOISE * slope.hypot(1.0) + 0.9 * (slope * a.range + b.range) + 0.02 * level;
            let clipped = level >= CLIPPED - 5.0 && b.level >= CLIPPED - 10.0;
            off += usize::from(!clipped && (b.level - level).abs() > allowed);
        }
    }
    let seen = off as f64 / all.max(1) as f64;
    (all >= ENOUGH && off >= 8 && seen > DEVIATING).then_some(Doubt::Deviates { expected: DEVIATING, seen })
}

/// Steepness of the second frame's edges relative to what the first one's predict.
fn sharpness(first: &Look, second: &Look, own: &Transfer) -> Option<Doubt> {
    let (mut seen, mut predicted, mut edges) = (0.0_f64, 0.0_f64, 0_usize);
    for (a, b) in first.samples.iter().zip(&second.samples) {
        let inside = |sample: &Sample| sample.level >= 30.0 && sample.level < 200.0;
        let Some((_, slope)) = own.at(a.level) else { continue };
        let expected = a.range * slope.clamp(0.3, 3.0);
        if inside(a) && inside(b) && a.range.max(expected) > EDGE {
            edges += 1;
            seen += f64::from(b.range);
            predicted += f64::from(expected);
        }
    }
    let steepness = seen / predicted.max(1.0);
    (edges >= EDGES && steepness < SHARP).then_some(Doubt::Blurred { expected: 1.0, seen: steepness })
}

/// Exposure of a level by the usual curve of displays (IEC 61966-2-1), 1 at level 255.
fn assumed_exposure(level: f64) -> f64 {
    let v = level / 255.0;
    if v <= 0.040_45 { (v / 12.92).max(0.0) } else { ((v + 0.055) / 1.055).powf(2.4) }
}

fn assumed_level(exposure: f64) -> f64 {
    let v = if exposure <= 0.003_130_8 { 12.92 * exposure } else { 1.055 * exposure.powf(1.0 / 2.4) - 0.055 };
    255.0 * v.clamp(0.0, 1.0)
}

/// Levels a unit of ln exposure.
pub(super) fn assumed_slope(level: f64) -> f64 {
    let exposure = assumed_exposure(level);
    (assumed_level(exposure * 1.01) - assumed_level(exposure / 1.01)) / (2.0 * 1.01_f64.ln())
}
