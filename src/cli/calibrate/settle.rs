//! `rigd calibrate settle`: has a running daemon measure the settle time of its arm.

use super::run::LOOK_EVERY;
use crate::cli::error::{print_json, print_line};
use crate::cli::progress::Progress;
use crate::cli::session::Connection;
use crate::numerics::settle::ABOVE_NOISE;
use crate::session::handle::{CalibrationRequest, Kind, SettleFile};
use crate::session::state::SessionState;
use anyhow::bail;

/// Measure how long the arm swings after a move.
///
/// The arm makes the largest step of the rig file's plan and a short one, eight times each; after each a burst of frames is shot, without
/// waiting. Nobody is needed; any object that light and shade lie on may stand there. Ctrl-C leaves the daemon at it.
#[derive(Clone, Debug, clap::Args)]
pub struct Settle {
    #[command(flatten)]
    daemon: Connection,
    /// A name for the measurement.
    #[arg(long)]
    name: Option<String>,
    /// Shutter label of its frames (1/8, 0.4, 2); the middle one of the plan's bracket if left out.
    #[arg(long)]
    exposure: Option<String>,
    /// Print what was measured as JSON and nothing else.
    #[arg(long)]
    json: bool,
}

/// Runs it.
///
/// # Errors
/// No daemon, a refusal, a measurement that ended in another way than `completed`, or a stdout that takes nothing.
pub fn run(args: &Settle) -> anyhow::Result<()> {
    let client = args.daemon.client()?;
    let request = CalibrationRequest { name: args.name.clone(), kind: Kind::Settle, exposure: args.exposure.clone() };
    let started = client.start_calibration(&request)?;
    let (id, frames) = (started.id, started.frames_planned);
    if !args.json {
        print_line(format!("calibration {} ({id}): {frames} frames", started.version))?;
    }
    let progress = Progress::counted_unless(args.json, "frames");
    loop {
        let now = client.calibration(&id)?;
        progress.count(now.frames_committed, frames);
        match now.state {
            SessionState::Completed => break,
            state if state.is_final() => {
                bail!("calibration {id} is {state}{}", now.reason.map(|r| format!(": {r}")).unwrap_or_default())
            }
            _ => std::thread::sleep(LOOK_EVERY),
        }
    }
    progress.end();
    let file: SettleFile = serde_json::from_value(client.calibration_result(&id)?)?;
    if args.json { print_json(&file) } else { Ok(print_line(told(&file))?) }
}

/// The result for people.
fn told(file: &SettleFile) -> String {
    let report = &file.report;
    let mut text = String::from("\nmove deg   delay s   displacement deg   difference / noise\n");
    let shown = report.table.iter().filter(|row| !row.last && row.delay_s <= report.recommended_s);
    for row in shown.clone() {
        let mark = if row.over_noise > ABOVE_NOISE { "  above noise" } else { "" };
        text += &format!(
            "{:8.1} {:9.3} {:+18.3} {:20.1}{mark}\n",
            row.move_deg, row.delay_s, row.displacement_deg, row.over_noise
        );
    }
    text += &format!("and {} later frames, none above noise\n", report.table.len() - shown.count());
    text += "\n";
    for of in &report.moves {
        text += &match of.last_above_s {
            Some(last) => format!(
                "after {:.1} degrees: up to {:.3} degrees off, last seen at {last:.3} s, at rest from {:.3} s\n",
                of.move_deg, of.greatest_deg, of.settle_s
            ),
            None => format!("after {:.1} degrees: at rest in the first frame, {:.3} s\n", of.move_deg, of.settle_s),
        };
    }
    text += &format!(
        "settle time {:.3} s (+0 -{:.3}) to the request of the first frame; the shutter opens at most {:.3} s later\n\
         smallest displacement that would have been seen: {:.3} degrees ({} parts of the picture)\n",
        report.settle_s, report.uncertainty_s, report.shutter_lag_at_most_s, report.smallest_seen_deg, report.cells
    );
    for warning in &report.warnings {
        text += &format!("warning: {warning}\n");
    }
    let judgement = if file.rig_settle_s < report.settle_s {
        ": too short"
    } else if file.rig_settle_s < report.recommended_s {
        ": long enough, without the margin"
    } else {
        ": long enough"
    };
    text + &format!(
        "arm.settle_s = {:.2} is recommended, twice the settle time; the rig file says {}{judgement}",
        report.recommended_s, file.rig_settle_s
    )
}
