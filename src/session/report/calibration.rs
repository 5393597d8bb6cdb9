//! Which calibration, how old, how accurate; the camera's response and the shutter times.

use super::sources::Session;
use super::words::{CHANNEL_SERIES, CHANNELS, between, count, duration, moment, percent, shorten, three};
use crate::document::plot::{Axis, Plot, Series, Style};
use crate::document::{Block, Table};
use crate::numerics::radiometry::response::REFERENCE_LEVEL;
use crate::session::calibration::file::CalibrationFile;
use serde_json::Value;

/// Levels of the curve that are drawn: every so-manieth.
const STEP: usize = 3;

pub fn section(session: &Session) -> Vec<Block> {
    let mut blocks = vec![Block::Section("Calibration".into())];
    match &session.calibration {
        Some(calibration) => blocks.extend(of_calibration(session, calibration)),
        None => blocks.push(Block::text(
            "This session used no calibration: camera, light positions and the lamp's intensity are what the rig file says, and nobody measured \
             how right that is. What to do for better: `rigd calibrate run` before the next session.",
        )),
    }
    blocks.push(Block::Section("Camera response and shutter times".into()));
    match &session.calibration {
        Some(calibration) => blocks.extend([Block::text(response_words(calibration)), response(calibration)]),
        None => blocks.push(Block::text(
            "The response was measured on the session's first bracket, and is not kept as a file: the times below were measured with it.",
        )),
    }
    blocks.push(times(session));
    blocks
}

fn of_calibration(session: &Session, calibration: &CalibrationFile) -> Vec<Block> {
    let age = match between(&calibration.made, &session.manifest.started) {
        Some(seconds) if seconds >= 2.0 * 86_400.0 => format!("{:.0} days before the session", seconds / 86_400.0),
        Some(seconds) => format!("{} before the session", duration(seconds)),
        None => "at a time that cannot be read".into(),
    };
    let text = format!(
        "Calibration {} was made {age} ({}), on {}.",
        calibration.version,
        moment(&calibration.made),
        count(calibration.frames.len(), "frame")
    );
    let (camera, lights) = (&calibration.camera, &calibration.lights);
    let mut table = Table::new("How accurate it says to be", ["What", "Value", "Uncertainty (standard deviation)"]);
    let [sigma_x, sigma_y] = camera.sigma.focal_px;
    table.row([
        "Focal length, px".into(),
        format!("{:.1}, {:.1}", camera.focal_px[0], camera.focal_px[1]),
        format!("{sigma_x:.1}, {sigma_y:.1}"),
    ]);
    let [sigma_x, sigma_y] = camera.sigma.principal_px;
    table.row([
        "Principal point, px".into(),
        format!("{:.1}, {:.1}", camera.principal_px[0], camera.principal_px[1]),
        format!("{sigma_x:.1}, {sigma_y:.1}"),
    ]);
    table.row(["Board's corners, px".into(), String::new(), format!("{:.3} rms of reprojection", camera.rms_px)]);
    for light in &lights.lights {
        let sigma: [f64; 3] = std::array::from_fn(|k| light.covariance_mm2[k][k].max(0.0).sqrt());
        let angle = light
            .angle_deg
            .map_or_else(|| "light at an unknown angle".to_owned(), |angle| format!("Light at {angle:.1} degrees, mm"));
        table.row([angle, three(light.position_mm, 1), three(sigma, 2)]);
    }
    table.row(["Highlights on the balls, px".into(), String::new(), format!("{:.3} rms", lights.rms_px)]);
    if let Some(bulb) = lights.bulb_intensity {
        let sigma = lights.lights.iter().filter_map(|light| Some((light.intensity?, light.intensity_sigma?)));
        let relative = sigma.flat_map(|(value, sigma)| (0..3).map(move |c| sigma[c] / value[c])).fold(0.0, f64::max);
        table.row([
            "Lamp's intensity, radiance x mm\u{b2}".into(),
            bulb.map(|v| format!("{v:.3e}")).join(", "),
            format!("{} at most", percent(relative)),
        ]);
    }
    shorten(&mut table, "calibration.json");
    vec![Block::text(text), Block::Table(table)]
}

fn response_words(calibration: &CalibrationFile) -> String {
    let response = &calibration.response;
    format!(
        "The curve says how much light makes which level of a picture. It was solved from {}. What the images leave open of it, one exponent, is known to \
         {}: the broken lines show by how much the curve could be off for it.",
        count(response.pixels, "pixel"),
        percent(response.exponent_sigma)
    )
}

fn response(calibration: &CalibrationFile) -> Block {
    let (curves, sigma) = (&calibration.response.log_exposure, calibration.response.exponent_sigma);
    let levels = || (1..255).step_by(STEP);
    let line = |channel: usize, exponent: f64, style: Style, name: Option<String>| {
        let points = levels().map(|level| [level as f64, (exponent * curves[channel][level]).exp(), 0.0]).collect();
        Series { name, colour: CHANNEL_SERIES[channel], style, points }
    };
    let mut series: Vec<Series> = (0..3)
        .flat_map(|c| [1.0 - sigma, 1.0 + sigma].map(|exponent| line(c, exponent, Style::Dashed, None)))
        .collect();
    series.extend((0..3).map(|c| line(c, 1.0, Style::Line, Some(CHANNELS[c].into()))));
    Block::Drawing(
        Plot {
            caption: format!("Response of the camera: exposure that makes a level, in units of the one that makes level {REFERENCE_LEVEL}. Broken: one standard deviation."),
            alternative: "Exposure against level, one rising curve a channel".into(),
            x: Axis::linear("level of the picture", &[0.0, 255.0]),
            y: Axis::logarithmic("exposure"),
            series,
        }
        .drawn(),
    )
}

/// What the last development of the first station says of the times.
fn times(session: &Session) -> Block {
    let developed = |record: &&Value| record["type"] == "station.developed" && record["station"] == 0;
    let Some(record) = session.journal.records.iter().rev().find(developed) else {
        return Block::text("No station was developed, so no shutter time was measured.");
    };
    let mut table = Table::new(
        "Shutter times of the first station, as its pictures tell them",
        ["Exposure", "Expected, s", "Measured, s", "Difference", "Standard error"],
    );
    for time in record["exposures"].as_array().into_iter().flatten() {
        let (expected, measured) = (time["power_of_two_s"].as_f64(), time["estimated_s"].as_f64());
        let seconds = |value: Option<f64>| value.map_or_else(|| "not told".to_owned(), |s| format!("{s:.5}"));
        let difference = expected.zip(measured).map(|(expected, measured)| percent(measured / expected - 1.0));
        let sigma = match (time["reference"] == true, time["sigma_relative"].as_f64()) {
            (true, _) => "none: the others are relative to it".into(),
            (false, sigma) => sigma.map_or_else(|| "its picture does not tell".to_owned(), percent),
        };
        let label = time["nominal"].as_str().unwrap_or_default().to_owned();
        table.row([label, seconds(expected), seconds(measured), difference.unwrap_or_default(), sigma]);
    }
    Block::Table(table)
}
