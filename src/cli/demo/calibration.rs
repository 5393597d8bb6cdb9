//! A calibration of the simulated rig over REST, and what it found beside the hidden truth.

use super::say;
use crate::cli::session::Client;
use crate::numerics::geometry::{Projection, Vec3};
use crate::pipeline::calibration::response::ResponseCalibration;
use crate::session::calibration::file::CalibrationFile;
use crate::session::handle::CalibrationRequest;
use crate::session::state::{SessionState, Verb};
use crate::sim::world::World;
use anyhow::{Context, bail};
use rig_config::Rig;
use std::io::Write;
use std::time::Duration;

/// Light positions must be this good, mm.
const LIGHTS_MM: f64 = 2.0;
/// The response must be this good over the used range, relative.
const RESPONSE: f64 = 0.01;
/// Highest level of the used range.
const HIGHEST: usize = 245;
/// Pause between two looks at a run that shoots.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Refusals in all after which something is wrong with the demo itself.
const MOST_REFUSALS: usize = 6;

/// Calibrates the daemon's rig, step by step.
pub(super) fn calibrate(url: &str) -> anyhow::Result<CalibrationFile> {
    let client = Client::new(url, None)?;
    let id = client
        .start_calibration(&CalibrationRequest { name: Some("demo".into()), ..CalibrationRequest::default() })?
        .id;
    say(format!("calibration {id} at {url}"));
    let mut told = 0;
    loop {
        let now = client.calibration(&id)?;
        for verdict in &now.verdicts[told.min(now.verdicts.len())..] {
            let reason = verdict.reason.as_ref().map_or("accepted".into(), |reason| format!("REFUSED: {reason}"));
            say(format!("  {}: {reason}", verdict.step.name()));
        }
        told = now.verdicts.len();
        match now.state {
            SessionState::Completed => break,
            SessionState::Awaiting if now.verdicts.iter().filter(|v| !v.accepted).count() >= MOST_REFUSALS => {
                client.command_calibration(&id, Verb::Abort)?;
                bail!("calibration {id} was refused {MOST_REFUSALS} times: see above");
            }
            SessionState::Awaiting => {
                client.command_calibration(&id, Verb::Shoot)?;
            }
            state if state.is_final() => bail!("calibration {id} is {state}: {}", now.reason.unwrap_or_default()),
            _ => {}
        }
        std::thread::sleep(LOOK_EVERY);
    }
    serde_json::from_value(client.calibration_result(&id)?).context("the calibration's result is not understood")
}

/// One line: what, truth, found, error, and whether a bar holds.
struct Line {
    name: &'static str,
    truth: String,
    found: String,
    error: String,
    held: bool,
}

/// The comparison.
pub(super) struct Calibrated {
    lines: Vec<Line>,
}

impl Calibrated {
    /// Holds a calibration against the truth of the rig's world.
    pub(super) fn compare(rig: &Rig, found: &CalibrationFile) -> anyhow::Result<Self> {
        let world = World::new(rig, rig.simulation.as_ref().context("the rig is not simulated")?);
        let Projection::Pinhole { focal_px, principal_px, distortion } = &world.truth().projection else {
            bail!("the simulated camera is no pinhole");
        };
        let camera = &found.camera;
        let free = |name, truth: f64, found: f64, digits: usize| Line {
            name,
            truth: format!("{truth:.digits$}"),
            found: format!("{found:.digits$}"),
            error: if truth == 0.0 { String::new() } else { format!("{:+.3} %", 100.0 * (found / truth - 1.0)) },
            held: true,
        };
        let px = |name, truth: f64, found: f64| Line {
            error: format!("{:+.2} px", found - truth),
            ..free(name, truth, found, 2)
        };
        let mut lines = vec![
            free("focal length, px", focal_px[0], camera.focal_px[0], 2),
            px("principal point x, px", principal_px[0], camera.principal_px[0]),
            px("principal point y, px", principal_px[1], camera.principal_px[1]),
            Line { error: String::new(), ..free("distortion k1", distortion[0], camera.distortion[0], 4) },
        ];
        let bulb = found.lights.bulb_intensity.context("the calibration has no intensity")?;
        let truth = world.truth().lamp.intensity;
        for (c, name) in ["intensity red", "intensity green", "intensity blue"].into_iter().enumerate() {
            lines.push(free(name, truth[c], bulb[c], 0));
        }
        lines.push(positions(&world, found));
        lines.push(times(&found.response));
        lines.push(response(&world, rig, &found.response)?);
        Ok(Self { lines })
    }

    /// True when the bars hold.
    pub(super) fn holds(&self) -> bool {
        self.lines.iter().all(|line| line.held)
    }

    /// Prints the comparison; what is out of its limit is marked with !.
    pub(super) fn print(&self, out: &mut impl Write) -> std::io::Result<()> {
        writeln!(out, "  {:<24} {:>12} {:>12}  error", "calibration", "truth", "found")?;
        for Line { name, truth, found, error, held } in &self.lines {
            writeln!(out, "{} {name:<24} {truth:>12} {found:>12}  {error}", if *held { ' ' } else { '!' })?;
        }
        Ok(())
    }
}

fn positions(world: &World, found: &CalibrationFile) -> Line {
    let off = found.lights.lights.iter().filter_map(|light| {
        let truth = world.truth().lamp.position(light.angle_deg?);
        Some((Vec3::from(light.position_mm) - truth).norm())
    });
    let all: Vec<f64> = off.collect();
    let worst = all.iter().copied().fold(0.0, f64::max);
    let rms = (all.iter().map(|off| off * off).sum::<f64>() / all.len().max(1) as f64).sqrt();
    Line {
        name: "light positions",
        truth: String::new(),
        found: format!("{} lights", all.len()),
        error: format!("rms {rms:.2} mm, greatest {worst:.2} mm (limit {LIGHTS_MM} mm)"),
        held: worst <= LIGHTS_MM && !all.is_empty(),
    }
}

/// A third-stop shutter really opens for 2^(k/3) s: so does the simulated one.
fn times(response: &ResponseCalibration) -> Line {
    let measured = response.exposures.iter().filter(|time| time.sigma_relative.is_some());
    let off: Vec<f64> =
        measured.filter_map(|time| Some((time.estimated_s / time.power_of_two_s? - 1.0).abs())).collect();
    Line {
        name: "shutter times",
        truth: "2^(k/3) s".into(),
        found: format!("{} frames", off.len()),
        error: format!("greatest {:.2} %", 100.0 * off.iter().copied().fold(0.0, f64::max)),
        held: true,
    }
}

/// From the level whose charge is ten times the noise of one sample to [`HIGHEST`].
fn response(world: &World, rig: &Rig, measured: &ResponseCalibration) -> anyhow::Result<Line> {
    let curves = measured.response().map_err(anyhow::Error::msg)?;
    let (mut worst, mut from) = (0.0_f64, Vec::new());
    for (c, tone) in world.truth().tones.iter().enumerate() {
        let lowest = tone.lowest_used(rig.camera.full_well_e, rig.camera.read_noise_e);
        from.push(lowest.to_string());
        for level in lowest..=HIGHEST {
            worst = worst.max((curves.log_exposure[c][level].exp() / tone.exposure(level) - 1.0).abs());
        }
    }
    Ok(Line {
        name: "response",
        truth: String::new(),
        found: format!("{} to {HIGHEST}", from.join("/")),
        error: format!("greatest {:.2} % (limit {:.0} %)", 100.0 * worst, 100.0 * RESPONSE),
        held: worst <= RESPONSE,
    })
}
