//! What the operator ought to know of a calibrated bracket.

use super::response::{ExposureTime, ResponseCalibration};
use crate::numerics::radiometry::alignment::{Step, steps};
use crate::numerics::radiometry::bracket::{Bracket, PairTest, Verdict};
use crate::numerics::radiometry::response::Response;
use crate::numerics::radiometry::times::MeasuredTimes;

/// Levels held up by monotony, of 255, that make a curve doubtful.
const MANY_CONSTRAINTS: usize = 10;
/// Scatter of log ratios, in units of what was expected, that makes the images doubtful.
const WIDE_SCATTER: f64 = 25.0;

/// Everything doubtful about a calibrated bracket, each with the frame and the remedy.
pub(super) fn doubts(
    found: &ResponseCalibration,
    measured: &MeasuredTimes,
    pairs: &[PairTest],
    bracket: &Bracket,
    response: &Response,
) -> Vec<String> {
    let not_testable = pairs.iter().filter(|pair| pair.verdict == Verdict::NotTestable);
    let mut warnings: Vec<String> = not_testable.map(|pair| format!("times not testable {pair}")).collect();
    warnings.extend(doubtful_times(&found.exposures));
    for (channel, &active) in ["red", "green", "blue"].iter().zip(&found.active_constraints) {
        if active > MANY_CONSTRAINTS {
            warnings.push(format!(
                    "{channel}: {active} of 255 levels are held up by monotony alone: shoot more exposures of a smooth surface"
                ));
        }
    }
    warnings.extend(wide_scatter(measured));
    warnings.extend(stray_light(bracket));
    warnings.extend(movements(bracket, response));
    warnings
}

/// A word on ratios that contradict one another.
pub(in crate::pipeline) fn wide_scatter(measured: &MeasuredTimes) -> Option<String> {
    (measured.chi_squared > WIDE_SCATTER).then(|| {
        format!(
            "ratios scatter {:.0} times as much as expected: something moved, the lamp flickered, or stray light changed \
             between the exposures",
            measured.chi_squared.sqrt()
        )
    })
}

/// A word on every time that was not measured, or measured where nobody expected it.
pub(in crate::pipeline) fn doubtful_times(exposures: &[ExposureTime]) -> Vec<String> {
    let doubt = |time: &ExposureTime| {
        if time.sigma_relative.is_none() {
            Some(format!(
                "{}: {} pixels of it are exposed in another frame too, its time is not measured: it adds little; leave it \
                 out or shoot an exposure in between",
                time.name, time.overlap_pixels
            ))
        } else if time.departs {
            Some(format!(
                "{}: the images say {:.5} s, neither its nominal {} s nor a third of a stop: lamp or shutter is unsteady, or \
                 the time is wrong",
                time.name, time.estimated_s, time.nominal_s
            ))
        } else {
            None
        }
    };
    exposures.iter().filter_map(doubt).collect()
}

/// A level above read noise and rounding.
const LIT_LEVEL: u8 = 16;

/// Ambient light only adds to the radiance: ratios do not show it, a background that ought to be black does.
fn stray_light(bracket: &Bracket) -> Option<String> {
    let (level, longest) = (bracket.darkest_green(), bracket.exposures().last()?);
    (level >= LIT_LEVEL).then(|| {
        format!(
            "{}: nothing in it is darker than green level {level}: in a black enclosure that is ambient light or flare; close the \
             enclosure, switch the room light off, and compare a frame with the lamp off",
            longest.name
        )
    })
}

/// Names the frames that moved or are blurred, with the remedy.
fn movements(bracket: &Bracket, response: &Response) -> Vec<String> {
    let name = |frame: usize| &bracket.exposures()[frame].name;
    let all = steps(bracket, response);
    let mut warnings = Vec::new();
    let mut rest = all.as_slice();
    while let Some((step, others)) = rest.split_first() {
        rest = others;
        if !step.moved() {
            continue;
        }
        let back = |next: &Step| {
            let left = [0, 1].map(|k| next.shift_px[k] + step.shift_px[k]);
            next.moved() && next.shorter == step.longer && left[0].hypot(left[1]) < 0.3 * step.distance_px()
        };
        let distance = step.distance_px();
        if let Some((_, after)) = others.split_first().filter(|(next, _)| back(next)) {
            rest = after;
            let name = name(step.longer);
            warnings.push(format!(
                "{name}: it is {distance:.1} px off the frames before and after: something shook; shoot it again"
            ));
        } else {
            warnings.push(format!(
                "the picture moved by {distance:.1} px from {} to {}: fix camera and object, shoot the bracket again",
                name(step.shorter),
                name(step.longer)
            ));
        }
    }
    for step in all.iter().filter(|step| step.blurred()) {
        let (dull, sharp) = if step.blur_px > 0.0 { (step.longer, step.shorter) } else { (step.shorter, step.longer) };
        warnings.push(format!(
            "{} is less sharp than {}, by a blur of {:.1} px: something shook or the focus changed; shoot it again",
            name(dull),
            name(sharp),
            step.blur_px.abs()
        ));
    }
    warnings
}
