//! Balls and highlights in frames, and what is wrong with a frame.

use super::{LightFrames, LightsCalibrationError, LightsSettings, Load};
use crate::numerics::calibration::lights::balls::{self, Ball, Found, LARGEST_BLUR_PX, Rejected};
use crate::numerics::calibration::lights::highlight::{self, Spots};
use crate::numerics::calibration::lights::joint::Sighting;
use crate::numerics::image::Image;
use std::collections::BTreeSet;

/// A larger share of clipped pixels is no picture of balls.
const MOST_CLIPPED: f64 = 0.5;
/// Outlines farther off than this mean that something moved, pixels: under one light the limb alone is up to 0.3 px off.
const MOVED_PX: f64 = 0.7;
/// A shift known no better than this says nothing, pixels.
const VAGUE_PX: f64 = 0.25;

fn frame(file: &str, load: Load<'_, Spots>, settings: &LightsSettings) -> Result<Spots, LightsCalibrationError> {
    let spots = load(file).map_err(|reason| LightsCalibrationError::Frame { file: file.to_owned(), reason })?;
    let found = (spots.level.width, spots.level.height);
    if found != settings.size {
        return Err(LightsCalibrationError::Size { file: file.to_owned(), found, expected: settings.size });
    }
    Ok(spots)
}

/// The balls of all silhouettes together; the names of every frame are checked for size, clipping and movement.
pub(super) fn balls(
    lights: &[LightFrames],
    load: Load<'_, Spots>,
    settings: &LightsSettings,
    warnings: &mut Vec<String>,
) -> Result<Vec<Ball>, LightsCalibrationError> {
    let files: BTreeSet<&str> = lights.iter().map(|light| light.silhouette.as_str()).collect();
    let mut mean = Image::filled(settings.size.0, settings.size.1, 0.0_f32);
    for file in &files {
        let spots = frame(file, load, settings)?;
        let clipped = spots.clipped.pixels.iter().filter(|c| **c).count() as f64 / spots.clipped.pixels.len() as f64;
        if clipped > MOST_CLIPPED {
            return Err(LightsCalibrationError::Clipped { file: (*file).to_owned(), percent: 100.0 * clipped });
        }
        for (sum, level) in mean.pixels.iter_mut().zip(&spots.level.pixels) {
            *sum += level / files.len() as f32;
        }
    }
    let found = balls::find(&mean, &settings.projection, settings.radius_mm, settings.balls);
    let balls = counted(found, &files, settings, warnings)?;
    for (index, ball) in balls.iter().enumerate().filter(|(_, ball)| ball.blur_px > LARGEST_BLUR_PX) {
        warnings.push(format!("ball {} is blurred ({:.1} px): focus on the balls", index + 1, ball.blur_px));
    }
    let mut shifts = Vec::new();
    for file in files {
        let image = frame(file, load, settings)?.level;
        shifts.push((file, balls.iter().map(|ball| firm_shift(&image, settings, ball)).collect()));
    }
    still(&shifts, balls.len(), warnings)?;
    Ok(balls)
}

fn counted(
    found: Found,
    files: &BTreeSet<&str>,
    settings: &LightsSettings,
    warnings: &mut Vec<String>,
) -> Result<Vec<Ball>, LightsCalibrationError> {
    let (count, expected) = (found.balls.len(), settings.balls);
    let rejected = seen_else(&found.rejected);
    let remedy = match count {
        n if n > expected => "take other round things off the stage, or say how many balls there are",
        n if n < 2 => "check that the balls are lit, in focus and whole in the frame, and of one size",
        _ => {
            if count < expected {
                warnings.push(format!("{count} of {expected} balls found{rejected}: positions are less certain"));
            }
            return Ok(found.balls);
        }
    };
    let files: Vec<&str> = files.iter().copied().collect();
    Err(LightsCalibrationError::Balls { files: files.join(", "), found: count, expected, rejected, remedy })
}

/// What was round and no ball.
fn seen_else(rejected: &[Rejected]) -> String {
    let one = |r: &Rejected| {
        format!(
            "; at ({:.0}, {:.0}) px something round of {:.0} px: {}",
            r.center_px[0], r.center_px[1], r.radius_px, r.reason
        )
    };
    rejected.iter().map(one).collect()
}

/// By how much a ball lies elsewhere in a frame than in the mean, if that is well known.
fn firm_shift(image: &Image<f32>, settings: &LightsSettings, ball: &Ball) -> Option<[f64; 2]> {
    let (shift, sigma) = balls::shift(image, &settings.projection, ball)?;
    (sigma < VAGUE_PX).then_some(shift)
}

/// Refuses the frame in which most balls lie farthest from where they lie in the other frames (the median: a frame that moved
/// draws the mean with it); warns of a single ball that does.
fn still(
    shifts: &[(&str, Vec<Option<[f64; 2]>>)],
    balls: usize,
    warnings: &mut Vec<String>,
) -> Result<(), LightsCalibrationError> {
    let usual = |ball: usize, axis: usize| {
        let mut all: Vec<f64> = shifts.iter().filter_map(|(_, of)| of[ball].map(|shift| shift[axis])).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied().unwrap_or(0.0)
    };
    let usual: Vec<[f64; 2]> = (0..balls).map(|ball| [usual(ball, 0), usual(ball, 1)]).collect();
    let mut farthest: Option<(&str, f64)> = None;
    let mut single = Vec::new();
    for (file, of) in shifts {
        let off: Vec<(usize, f64)> =
            (0..balls).filter_map(|b| of[b].map(|s| (b, (s[0] - usual[b][0]).hypot(s[1] - usual[b][1])))).collect();
        let moved: Vec<&(usize, f64)> = off.iter().filter(|(_, off)| *off > MOVED_PX).collect();
        if moved.len() > 1 && 2 * moved.len() > off.len() {
            let pixels = moved.iter().map(|(_, off)| off).sum::<f64>() / moved.len() as f64;
            if farthest.is_none_or(|(_, most)| pixels > most) {
                farthest = Some((*file, pixels));
            }
        } else {
            single.extend(moved.into_iter().map(|(ball, off)| {
                let other = "from where the other frames show it: did it roll, or does a shadow touch it?";
                format!("{file}: ball {} lies {off:.1} px {other}", ball + 1)
            }));
        }
    }
    warnings.extend(single);
    farthest.map_or(Ok(()), |(file, pixels)| Err(LightsCalibrationError::Moved { file: file.to_owned(), pixels }))
}

/// The usable highlights of one light; what is wrong with the others goes to its warnings.
pub(super) fn highlights(
    index: usize,
    light: &LightFrames,
    load: Load<'_, Spots>,
    settings: &LightsSettings,
    balls: &[Ball],
    warnings: &mut Vec<String>,
) -> Result<Vec<Sighting>, LightsCalibrationError> {
    let spots = frame(&light.highlight, load, settings)?;
    let (mut sightings, mut faults) = (Vec::new(), Vec::new());
    for (ball, seen) in balls.iter().enumerate() {
        match highlight::find(&spots, &settings.projection, seen) {
            Ok(found) => {
                if found.clipped > 0 {
                    warnings.push(format!(
                        "{}: the highlight on ball {} is clipped ({} pixels): expose it shorter",
                        light.highlight,
                        ball + 1,
                        found.clipped
                    ));
                }
                sightings.push(Sighting { light: index, ball, at: found.at, sigma_px: found.sigma_px });
            }
            Err(fault) => faults.push(format!("ball {}: {fault}", ball + 1)),
        }
    }
    if sightings.len() < 2 {
        return Err(LightsCalibrationError::Highlights {
            file: light.highlight.clone(),
            usable: sightings.len(),
            reasons: faults.join("; "),
        });
    }
    warnings.extend(faults.into_iter().map(|fault| format!("{}: {fault}", light.highlight)));
    Ok(sightings)
}
