//! The camera's response and shutter times from one bracket, as a report.

use super::doubts::doubts;
use crate::numerics::radiometry::bracket::{Bracket, BracketError, PairTest};
use crate::numerics::radiometry::response::{Recovered, Response, recover};
use crate::numerics::radiometry::robertson::robertson;
use crate::numerics::radiometry::times::{MeasuredTime, MeasuredTimes, SHUTTER};
use crate::pipeline::decode::power_of_two_s;
use serde::{Deserialize, Serialize};

/// How the curve is solved for when the times are known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Debevec & Malik 1997 under the condition that the curve does not decrease.
    Debevec,
    /// Robertson, Borman & Stevenson 2003, kept monotone.
    Robertson,
}

/// A measured response with the shutter times it was measured with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResponseCalibration {
    /// How the curve was solved for.
    pub method: Method,
    /// Natural logarithm of exposure (radiance x seconds) by channel and 8-bit level; 0 at level 128.
    pub log_exposure: [Vec<f64>; 3],
    /// Levels by channel that only the demand for a non-decreasing curve holds up.
    pub active_constraints: [usize; 3],
    /// Pixels looked at.
    pub pixels: usize,
    /// Every frame's times, shortest first.
    pub exposures: Vec<ExposureTime>,
    /// The frame whose time is taken as expected: images tell ratios only.
    pub reference: String,
    /// What the times were expected to be before the images were asked.
    pub expected: Expected,
    /// What the images did not determine and what fixes it, in words.
    pub gauge: String,
    /// Relative standard error of the exponent that the images leave open on all times and on the curve.
    pub exponent_sigma: f64,
    /// Relative scatter of the measured about the nominal times, up to one exponent.
    pub scatter_nominal: Option<f64>,
    /// The same about the power-of-two times; none if a nominal time is no third of a stop.
    pub scatter_power_of_two: Option<f64>,
    /// What the operator ought to know, each with the frame and the remedy.
    pub warnings: Vec<String>,
}

/// Which times fix what images leave open.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Expected {
    /// 2^(k/3) seconds, what a third-stop shutter aims at.
    PowerOfTwo,
    /// The times as given.
    Nominal,
}

/// One frame's times side by side.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExposureTime {
    /// The frame.
    pub name: String,
    /// Time as labelled or listed, seconds.
    pub nominal_s: f64,
    /// 2^(k/3) seconds next to it; none if the nominal time is no third of a stop.
    pub power_of_two_s: Option<f64>,
    /// Time from the images, seconds; the expected one where they do not tell.
    pub estimated_s: f64,
    /// Relative standard error of the estimate against the reference frame; none where the images do not tell.
    pub sigma_relative: Option<f64>,
    /// Pixels, counted once a channel, that another frame shows as well.
    pub overlap_pixels: usize,
    /// True if the estimate departs from both the nominal and the power-of-two time by more than it may.
    pub departs: bool,
}

/// A time departs when it is this many standard errors away, and by at least this much: less does not matter.
const DEPARTS_SIGMA: f64 = 4.0;
const DEPARTS_LEAST: f64 = 0.005;
/// A departure that no shutter makes: half a stop.
const CONTRADICTS: f64 = 0.35;
/// Why a bracket gives no calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrateError {
    /// The bracket is unusable.
    #[error(transparent)]
    Bracket(#[from] BracketError),
    /// A time is far from the one listed.
    #[error("the images contradict the listed times: {}; correct these times or leave the frames out", .0.join("; "))]
    Contradicts(Vec<String>),
    /// One of a few times is wrong.
    #[error(
        "the images contradict the listed times, and {frames} frames do not tell which one is wrong: {}; correct the wrong one, or shoot \
         more exposures: five tell", .ways.join(", or ")
    )]
    OneOf {
        /// Frames measured.
        frames: usize,
        /// What each would have to be if the others are right.
        ways: Vec<String>,
    },
}

/// A calibrated bracket: the report, and the bracket with its measured times.
pub struct Calibrated {
    /// The report.
    pub calibration: ResponseCalibration,
    /// The frames with estimated times.
    pub bracket: Bracket,
    /// What exposures compared with longer ones say of their times.
    pub pairs: Vec<PairTest>,
}

/// Measures the times and the response of `bracket`, whose times are the nominal ones.
pub fn calibrate(bracket: Bracket, method: Method) -> Result<Calibrated, CalibrateError> {
    bracket.check_exposed()?;
    let pairs = bracket.check_times()?;
    let nominal = bracket.times_s();
    let names: Vec<String> = bracket.exposures().iter().map(|frame| frame.name.clone()).collect();
    let thirds: Option<Vec<f64>> = nominal.iter().map(|&t| power_of_two_s(t)).collect();
    let (expected, measured) = measure(&bracket, &nominal, thirds.as_deref())?;
    let expected_s = thirds.as_deref().filter(|_| expected == Expected::PowerOfTwo).unwrap_or(&nominal);
    refuse_single_fault(&names, &nominal, &measured.single_faults(expected_s))?;
    let timed = bracket.with_times(&measured.seconds())?;
    let Recovered { response, active_constraints, pixels } = match method {
        Method::Debevec => recover(&timed)?,
        Method::Robertson => robertson(&timed)?,
    };
    let exposures = exposure_times(&names, &nominal, &measured)?;
    let mut calibration = ResponseCalibration {
        method,
        log_exposure: response.log_exposure.clone(),
        active_constraints,
        pixels,
        exposures,
        reference: names[measured.reference].clone(),
        expected,
        gauge: gauge_in_words(expected, &names[measured.reference], &measured),
        exponent_sigma: measured.exponent_sigma,
        scatter_nominal: measured.scatter_about(&nominal, true),
        scatter_power_of_two: thirds.as_ref().and_then(|thirds| measured.scatter_about(thirds, true)),
        warnings: Vec::new(),
    };
    calibration.warnings = doubts(&calibration, &measured, &pairs, &timed, &response);
    calibration.warnings.extend(doubtful_exponent(&measured));
    Ok(Calibrated { calibration, bracket: timed, pairs })
}

/// Measures next to the power-of-two times, or to the nominal ones if the images agree better with these.
fn measure(
    bracket: &Bracket,
    nominal: &[f64],
    thirds: Option<&[f64]>,
) -> Result<(Expected, MeasuredTimes), BracketError> {
    nearest(nominal, thirds, true, |expected| MeasuredTimes::without_response(bracket, expected))
}

/// What `measure` finds next to the power-of-two times (seconds, if every nominal time is a third of a stop), or next to the
/// nominal ones if the images agree better with these; `any_exponent` up to one exponent on all times.
pub(in crate::pipeline) fn nearest(
    nominal: &[f64],
    thirds: Option<&[f64]>,
    any_exponent: bool,
    measure: impl Fn(&[f64]) -> Result<MeasuredTimes, BracketError>,
) -> Result<(Expected, MeasuredTimes), BracketError> {
    let Some(thirds) = thirds else {
        return Ok((Expected::Nominal, measure(nominal)?));
    };
    let measured = measure(thirds)?;
    let scatter = |times: &[f64]| measured.scatter_about(times, any_exponent).unwrap_or(f64::INFINITY);
    // Only a clear difference speaks against the times a shutter aims at.
    if 2.0 * scatter(nominal) < scatter(thirds) {
        Ok((Expected::Nominal, measure(nominal)?))
    } else {
        Ok((Expected::PowerOfTwo, measured))
    }
}

/// The three times of every frame, in the order of the frames.
///
/// # Errors
/// A measured time is so far from the listed one that no shutter can be to blame.
pub(in crate::pipeline) fn exposure_times(
    names: &[String],
    nominal: &[f64],
    measured: &MeasuredTimes,
) -> Result<Vec<ExposureTime>, CalibrateError> {
    let exposure = |((name, &nominal_s), time): ((&String, &f64), &MeasuredTime)| {
        let power_of_two_s = power_of_two_s(nominal_s);
        let off = |listed: f64| (time.time_s / listed).ln().abs();
        let nearest = off(nominal_s).min(power_of_two_s.map_or(f64::INFINITY, off));
        let limit = time.sigma.map(|sigma| (DEPARTS_SIGMA * sigma).max(DEPARTS_LEAST));
        ExposureTime {
            name: name.clone(),
            nominal_s,
            power_of_two_s,
            estimated_s: time.time_s,
            sigma_relative: time.sigma,
            overlap_pixels: time.overlap,
            departs: limit.is_some_and(|limit| nearest > limit),
        }
    };
    let times: Vec<ExposureTime> = names.iter().zip(nominal).zip(&measured.frames).map(exposure).collect();
    let far = |t: &&ExposureTime| t.sigma_relative.is_some() && (t.estimated_s / t.nominal_s).ln().abs() > CONTRADICTS;
    let reasons: Vec<String> =
        times.iter().filter(far).map(|t| contradiction(&t.name, t.nominal_s, t.estimated_s)).collect();
    if reasons.is_empty() { Ok(times) } else { Err(CalibrateError::Contradicts(reasons)) }
}

/// Refuses times of which one is wrong by more than half a stop: with few frames the exponent takes part of that up, and the measured
/// times do not show it.
fn refuse_single_fault(names: &[String], nominal: &[f64], ways: &[(usize, f64)]) -> Result<(), CalibrateError> {
    let off = |&(i, time_s): &(usize, f64)| (time_s / nominal[i]).ln().abs();
    if !ways.iter().any(|way| off(way) > CONTRADICTS) {
        return Ok(());
    }
    let said = |&(i, time_s): &(usize, f64)| contradiction(&names[i], nominal[i], time_s);
    let reasons: Vec<String> = ways.iter().map(said).collect();
    match reasons.len() {
        1 => Err(CalibrateError::Contradicts(reasons)),
        _ => Err(CalibrateError::OneOf { frames: nominal.len(), ways: reasons }),
    }
}

fn contradiction(name: &str, nominal_s: f64, measured_s: f64) -> String {
    format!("{name} is listed as {nominal_s} s, the images say {measured_s:.4} s")
}

/// A word on an exponent that these frames hardly tell.
fn doubtful_exponent(measured: &MeasuredTimes) -> Option<String> {
    if !measured.exponent_told {
        return Some(format!(
            "the exponent of times and response is not determined by these frames, {:.1} % uncertain: shoot five exposures or more",
            100.0 * measured.exponent_sigma
        ));
    }
    (measured.scatter > 2.0 * SHUTTER).then(|| {
        format!(
            "the times scatter by {:.0} % about the expected ones, more than shutters do: check the listed times",
            100.0 * measured.scatter
        )
    })
}

fn gauge_in_words(expected: Expected, reference: &str, measured: &MeasuredTimes) -> String {
    let which = match expected {
        Expected::PowerOfTwo => "power-of-two",
        Expected::Nominal => "nominal",
    };
    let rests_on = if measured.exponent_told {
        format!("if they scatter about the true ones independently, as the {:.2} % seen do", 100.0 * measured.scatter)
    } else {
        format!(
            "not determined by these frames, of which fewer than four agree: it rests on every shutter time being within {:.0} % of \
             the expected one",
            100.0 * SHUTTER
        )
    };
    format!(
        "Images of an unknown response tell times up to a factor and an exponent common to all (Grossberg & Nayar 2003). The factor \
         is fixed by the time of {reference}, the exponent by the {which} times: relative standard error {:.1e}, {rests_on}.",
        measured.exponent_sigma
    )
}

impl ResponseCalibration {
    /// The curves for the merge.
    ///
    /// # Errors
    /// A curve has not 256 levels, is not finite, or falls: the report was not written by this program.
    pub fn response(&self) -> Result<Response, String> {
        let sound = |curve: &Vec<f64>| {
            curve.len() == 256 && curve.iter().all(|g| g.is_finite()) && curve.is_sorted_by(|a, b| a <= b)
        };
        if self.log_exposure.iter().all(sound) {
            Ok(Response { log_exposure: self.log_exposure.clone() })
        } else {
            Err("log_exposure must hold 256 finite numbers a channel that do not decrease: calibrate again".into())
        }
    }
}
