//! Light positions from frames of balls, intensities from radiance of a grey card: named images in, report out.

mod card;
pub mod frames;
mod report;
mod sight;

use crate::numerics::calibration::lights::balls::Ball;
use crate::numerics::calibration::lights::highlight::Spots;
use crate::numerics::calibration::lights::joint::{SeenBall, Sighting};
use crate::numerics::calibration::lights::solve::{Item, Misfit, Scene, SolveError, Solved, solve};
use crate::numerics::geometry::Projection;
pub use card::{CardFrame, calibrate_intensity, intensities, shadows};
pub use report::{ArmCircle, CalibratedBall, CalibratedLight, LightsCalibration};

/// The frames of one light, by name.
#[derive(Clone, Debug, PartialEq)]
pub struct LightFrames {
    /// The arm's angle, degrees, if known.
    pub angle_deg: Option<f64>,
    /// Frame that shows the balls.
    pub silhouette: String,
    /// Frame that shows their highlights unclipped; may be the same.
    pub highlight: String,
}

/// What is known beforehand.
#[derive(Clone, Debug)]
pub struct LightsSettings {
    /// The camera; a pinhole.
    pub projection: Projection,
    /// Columns and rows of its frames.
    pub size: (usize, usize),
    /// Radius of every ball, mm.
    pub radius_mm: f64,
    /// How many balls stand on the stage.
    pub balls: usize,
    /// Standard deviation of the encoder's angles, degrees.
    pub angle_sigma_deg: f64,
}

/// Gives a frame by its name, or says why not.
pub type Load<'a, T> = &'a dyn Fn(&str) -> Result<T, String>;

/// Why lights cannot be calibrated: which file, what, what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LightsCalibrationError {
    /// Nothing to do.
    #[error("no light is given: name the frames of at least one")]
    NoLights,
    /// The camera is none that shows depth.
    #[error("the camera has parallel rays: light positions need a pinhole camera")]
    Parallel,
    /// A frame is missing or damaged.
    #[error("{file}: {reason}")]
    Frame {
        /// The frame.
        file: String,
        /// Why.
        reason: String,
    },
    /// A frame of another size.
    #[error("{file}: it has {}x{} pixels, the camera {}x{}: give frames as the calibrated camera writes them, neither scaled nor turned", found.0, found.1, expected.0, expected.1)]
    Size {
        /// The frame.
        file: String,
        /// Its size, pixels.
        found: (usize, usize),
        /// The camera's, pixels.
        expected: (usize, usize),
    },
    /// A frame that is bright all over.
    #[error("{file}: {percent:.0} % of it are clipped: expose it shorter")]
    Clipped {
        /// The frame.
        file: String,
        /// Share of its pixels, percent.
        percent: f64,
    },
    /// Too few or too many balls.
    #[error("{files}: {found} balls found, {expected} expected{rejected}: {remedy}")]
    Balls {
        /// The frames looked at.
        files: String,
        /// How many were found.
        found: usize,
        /// How many there should be.
        expected: usize,
        /// What else was seen.
        rejected: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The camera or the stage moved.
    #[error(
        "{file}: the balls lie {pixels:.1} px from where the other frames show them: camera or stage moved; shoot the balls again"
    )]
    Moved {
        /// The frame.
        file: String,
        /// By how much, pixels.
        pixels: f64,
    },
    /// A light with too few highlights.
    #[error("{file}: {usable} usable highlights, at least 2 balls must show one: {reasons}")]
    Highlights {
        /// The frame.
        file: String,
        /// Highlights that can be used.
        usable: usize,
        /// What is wrong with each of the others.
        reasons: String,
    },
    /// Mirror rays that do not meet.
    #[error(
        "{file}: the mirror rays do not meet in front of the balls: is it the frame of this light, and are the spots in it reflections of the lamp?"
    )]
    Rays {
        /// The frame.
        file: String,
    },
    /// A singular problem.
    #[error("the highlights do not determine the light positions: place the balls farther apart, not in a row")]
    Undetermined,
    /// Highlights far from wherever one geometry puts them.
    #[error(
        "the highlights lie {rms_px:.1} px rms from where one arm and these balls can put them{doubts}: look for exchanged or turned frames, angles of \
         other lights or in radians, another camera or radius"
    )]
    NoFit {
        /// Rms distance, pixels.
        rms_px: f64,
        /// Lights and balls that fit least, in words.
        doubts: String,
    },
    /// The card is unusable.
    #[error("{file}: {reason}")]
    Card {
        /// The frame.
        file: String,
        /// Why, and what to do.
        reason: String,
    },
}

/// A light in words.
fn name(index: usize, light: &LightFrames) -> String {
    let angle = light.angle_deg.map_or(String::new(), |angle| format!(" ({angle} degrees)"));
    format!("light {}{angle}", index + 1)
}

/// Finds balls and highlights, and solves for the light positions. Frames are loaded one at a time, each silhouette twice.
///
/// # Errors
/// A frame cannot be used, the balls cannot be found or moved, or a light has fewer than two usable highlights.
pub fn calibrate_lights(
    lights: &[LightFrames],
    load: Load<'_, Spots>,
    settings: &LightsSettings,
) -> Result<LightsCalibration, LightsCalibrationError> {
    if lights.is_empty() {
        return Err(LightsCalibrationError::NoLights);
    }
    if matches!(settings.projection, Projection::Orthographic { .. }) {
        return Err(LightsCalibrationError::Parallel);
    }
    let mut warnings = Vec::new();
    let balls = sight::balls(lights, load, settings, &mut warnings)?;
    let mut own: Vec<Vec<String>> = vec![Vec::new(); lights.len()];
    let mut sightings = Vec::new();
    for (index, light) in lights.iter().enumerate() {
        sightings.extend(sight::highlights(index, light, load, settings, &balls, &mut own[index])?);
    }
    let scene = Scene {
        projection: &settings.projection,
        balls: balls.iter().map(seen).collect(),
        sightings,
        angles: lights.iter().map(|light| light.angle_deg.map(f64::to_radians)).collect(),
        angle_sigma: settings.angle_sigma_deg.to_radians(),
    };
    let solved = solve(&scene).map_err(|error| explain(&error, lights))?;
    if solved.rms_px > MOST_RMS_PX {
        let told =
            solved.misfits.iter().map(|misfit| format!("; {}", words(misfit, lights, &solved, &scene.sightings).1));
        return Err(LightsCalibrationError::NoFit { rms_px: solved.rms_px, doubts: told.collect() });
    }
    Ok(report(lights, settings, &balls, &scene.sightings, &solved, (own, warnings)))
}

fn seen(ball: &Ball) -> SeenBall {
    SeenBall { center: ball.center, covariance: ball.covariance, radius: ball.radius }
}

fn explain(error: &SolveError, lights: &[LightFrames]) -> LightsCalibrationError {
    let file = |light: usize| lights[light].highlight.clone();
    match error {
        SolveError::TooFewHighlights { light, highlights } => LightsCalibrationError::Highlights {
            file: file(*light),
            usable: *highlights,
            reasons: "the others were left out".into(),
        },
        SolveError::NoMeetingPoint { light } => LightsCalibrationError::Rays { file: file(*light) },
        SolveError::Undetermined => LightsCalibrationError::Undetermined,
    }
}

/// Beyond this the frames do not belong together, pixels: a highlight is seen to a few tenths, one of another frame lies ten off.
const MOST_RMS_PX: f64 = 5.0;
/// Beyond this the residuals are no longer noise of a tenth of a pixel.
const LARGE_FACTOR: f64 = 6.0;

fn report(
    frames: &[LightFrames],
    settings: &LightsSettings,
    balls: &[Ball],
    sightings: &[Sighting],
    solved: &Solved,
    (own, mut warnings): (Vec<Vec<String>>, Vec<String>),
) -> LightsCalibration {
    let mut lights: Vec<CalibratedLight> =
        frames.iter().zip(&solved.lamps).map(|(f, lamp)| CalibratedLight::new(f.angle_deg, lamp)).collect();
    for (light, own) in lights.iter_mut().zip(own) {
        light.warnings = own;
    }
    for misfit in &solved.misfits {
        let (light, text) = words(misfit, frames, solved, sightings);
        match light {
            Some(light) => lights[light].warnings.push(text),
            None => warnings.push(text),
        }
    }
    for (index, light) in lights.iter_mut().enumerate() {
        if light.balls_used < settings.balls && light.warnings.is_empty() {
            let used = light.balls_used;
            light.warnings.push(format!(
                "{}: only {used} of {} balls used",
                name(index, &frames[index]),
                settings.balls
            ));
        }
    }
    if solved.circle.is_none() {
        warnings.push(
            "no arm circle: fewer than three lights with angles of their own; each light stands by itself".into(),
        );
    }
    if solved.scale > LARGE_FACTOR {
        warnings.push(format!(
            "highlights lie {:.2} px rms off their places: check focal length, ball radius, focus, and that no ball rolled",
            solved.rms_px
        ));
    }
    LightsCalibration {
        circle: solved.circle.as_ref().map(ArmCircle::from),
        bulb_intensity: None,
        balls: balls
            .iter()
            .zip(&solved.balls)
            .map(|(ball, (center, covariance))| CalibratedBall::new(&settings.projection, ball, center, covariance))
            .collect(),
        rms_px: solved.rms_px,
        reduced_chi2: solved.chi2 / solved.freedom.max(1) as f64,
        highlight_sigma_factor: solved.scale,
        lights,
        warnings,
    }
}

/// A misfit in words, and the light it concerns.
fn words(misfit: &Misfit, frames: &[LightFrames], solved: &Solved, sightings: &[Sighting]) -> (Option<usize>, String) {
    let done = if misfit.left_out { "left out" } else { "too little is left to leave it out" };
    let test = format!("F = {:.0}; {done}", misfit.statistic);
    match misfit.item {
        Item::Highlight(light, ball) => {
            let at = sightings.iter().find(|s| (s.light, s.ball) == (light, ball)).map_or([0.0; 2], |s| s.at);
            let text = format!(
                "{}: the highlight on ball {} at ({:.1}, {:.1}) px does not fit the others ({test}): another lamp's or a scratch?",
                frames[light].highlight,
                ball + 1,
                at[0],
                at[1]
            );
            (Some(light), text)
        }
        Item::Light(light) => {
            let off = solved.lamps[light].circle_residual.unwrap_or(0.0);
            let text = format!(
                "{}: it lies {off:.1} mm from the arm's place for this angle or off its circle ({test}: position without the circle): \
                 wrong angle, or did the arm slip?",
                name(light, &frames[light])
            );
            (Some(light), text)
        }
        Item::Ball(ball) => {
            let text = format!(
                "ball {} from the left does not fit its highlights ({test}): other radius, not round, or did it roll?",
                ball + 1
            );
            (None, text)
        }
    }
}
