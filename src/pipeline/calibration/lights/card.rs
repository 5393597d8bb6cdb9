//! Intensities of calibrated lights from radiance of a grey card.

use super::{CalibratedLight, LightsCalibration, LightsCalibrationError, Load};
use crate::numerics::calibration::lights::card::{Card, CardFault, Intensity, LampAt, agree, intensity};
use crate::numerics::geometry::{Projection, Vec3};
use crate::numerics::image::RadianceImage;
use nalgebra::Matrix3;

/// The radiance of the card under one light.
#[derive(Clone, Debug, PartialEq)]
pub struct CardFrame {
    /// Index of the light.
    pub light: usize,
    /// Name of the radiance image.
    pub file: String,
}

/// A cell of the card this much darker than the rest, after distance and angle, lies in shadow or is dirty.
const SHADOW: f64 = 0.08;

/// Adds intensities to calibrated lights. A light that reaches the card's front at too flat an angle keeps none and says so; what
/// contradicts one bulb of one intensity is named.
///
/// # Errors
/// A frame cannot be read, or shows no usable card.
pub fn calibrate_intensity(
    calibration: &LightsCalibration,
    projection: &Projection,
    card: &Card,
    frames: &[CardFrame],
    load: Load<'_, RadianceImage>,
) -> Result<LightsCalibration, LightsCalibrationError> {
    let mut out = calibration.clone();
    let mut measured: Vec<(usize, &str, Intensity)> = Vec::new();
    for frame in frames {
        let refuse = |reason: String| LightsCalibrationError::Card { file: frame.file.clone(), reason };
        let light =
            out.lights.get_mut(frame.light).ok_or_else(|| refuse(format!("there is no light {}", frame.light + 1)))?;
        let image = load(&frame.file).map_err(refuse)?;
        let lamp = lamp(light);
        match intensity(&image, projection, card, &lamp) {
            Ok(found) => {
                light.warnings.extend(shadow(&frame.file, &found));
                light.intensity = Some(found.value);
                light.intensity_sigma = Some(found.sigma);
                measured.push((frame.light, &frame.file, found));
            }
            Err(fault @ CardFault::Grazing { .. }) => {
                light.warnings.push(format!("{}: no intensity: {fault}", frame.file));
            }
            Err(fault) => return Err(refuse(fault.to_string())),
        }
    }
    let all: Vec<Intensity> = measured.iter().map(|(_, _, found)| found.clone()).collect();
    match agree(&all, &card.plane) {
        Some(agreement) => {
            out.bulb_intensity = Some(agreement.bulb);
            for &i in &agreement.departing {
                let (light, file, _) = &measured[i];
                out.lights[*light].warnings.push(format!(
                    "{file}: the intensity is {:+.1} % off the other lights': card in shadow, lamp not warm, or wrong position?",
                    100.0 * (agreement.ratios[i] - 1.0)
                ));
            }
            if let Some(tilt) = agreement.tilt_degrees {
                out.warnings.push(format!(
                    "the lights agree if the card is tilted by {tilt:.1} degrees from the plane given: measure its plane again"
                ));
            }
        }
        None => out.bulb_intensity = all.first().map(|only| only.value),
    }
    Ok(out)
}

fn lamp(light: &CalibratedLight) -> LampAt {
    LampAt { position: Vec3::from(light.position_mm), covariance: Matrix3::from_fn(|i, j| light.covariance_mm2[i][j]) }
}

/// A word on a part of the card that is in shadow.
fn shadow(file: &str, found: &Intensity) -> Option<String> {
    (found.dimmest > SHADOW).then(|| {
        format!(
            "{file}: a part of the card is {:.0} % darker than the rest: take it out of the shadow, or clean it",
            100.0 * found.dimmest
        )
    })
}

/// The frames on which a part of the card is in shadow, each with what to do; the lights need be known only roughly.
///
/// # Errors
/// A frame cannot be read.
pub fn shadows(
    calibration: &LightsCalibration,
    projection: &Projection,
    card: &Card,
    frames: &[CardFrame],
    load: Load<'_, RadianceImage>,
) -> Result<Vec<String>, LightsCalibrationError> {
    let mut found = Vec::new();
    for frame in frames {
        let Some(light) = calibration.lights.get(frame.light) else { continue };
        let refuse = |reason| LightsCalibrationError::Card { file: frame.file.clone(), reason };
        let image = load(&frame.file).map_err(refuse)?;
        let measured = intensity(&image, projection, card, &lamp(light)).ok();
        found.extend(measured.and_then(|measured| shadow(&frame.file, &measured)));
    }
    Ok(found)
}

/// Like [`calibrate_intensity`], but a frame that shows no usable card only leaves its light without an intensity of its own, with a
/// warning.
///
/// # Errors
/// No frame shows a usable card: the reason of the last.
pub fn intensities(
    calibration: &LightsCalibration,
    projection: &Projection,
    card: &Card,
    frames: &[CardFrame],
    load: Load<'_, RadianceImage>,
) -> Result<LightsCalibration, LightsCalibrationError> {
    let mut frames = frames.to_vec();
    let mut unusable = Vec::new();
    loop {
        match calibrate_intensity(calibration, projection, card, &frames, load) {
            Err(LightsCalibrationError::Card { file, reason }) if frames.len() > 1 => {
                frames.retain(|frame| frame.file != file);
                unusable.push(format!("{file}: no intensity: {reason}"));
            }
            found => {
                let mut found = found?;
                found.warnings.extend(unusable);
                return Ok(found);
            }
        }
    }
}
