//! `rigd calibrate run|list|show`: calibrations of a running daemon, step by step on the terminal.

use crate::cli::error::{print_json, print_line};
use crate::cli::session::{Client, ClientError, Connection};
use crate::cli::table::{Side, Table, here, state, with_reason};
use crate::session::handle::{CalibrationRequest, CalibrationSnapshot, Kind, Verdict};
use crate::session::state::{SessionState, Verb};
use anyhow::bail;
use serde_json::Value;
use std::io::{BufRead, Write};
use std::time::Duration;

/// Calibrate the rig of a running daemon, step by step.
///
/// Says what to put on the stage, waits for Enter, shoots, and asks again for what does not serve. A calibration that waits for an operator is
/// taken up where it stands.
#[derive(Clone, Debug, clap::Args)]
pub struct Run {
    #[command(flatten)]
    daemon: Connection,
    /// A name for the calibration.
    #[arg(long)]
    name: Option<String>,
}

/// List the calibrations of a running daemon, newest first.
#[derive(Clone, Debug, clap::Args)]
pub struct List {
    #[command(flatten)]
    daemon: Connection,
    /// Print an array and nothing else.
    #[arg(long)]
    json: bool,
}

/// Print a calibration as JSON: what was measured if it is complete, else where it stands.
#[derive(Clone, Debug, clap::Args)]
pub struct Show {
    #[command(flatten)]
    daemon: Connection,
    id: String,
    /// JSON is all that it prints; for scripts that say so everywhere.
    #[arg(long)]
    json: bool,
}

/// Pause between two looks at a run that shoots.
pub(super) const LOOK_EVERY: Duration = Duration::from_millis(300);

/// Runs `rigd calibrate run`.
///
/// # Errors
/// No daemon, a refusal, a calibration that ended in another way than `completed`, or a stdin that ended.
pub fn run(args: &Run) -> anyhow::Result<()> {
    let client = args.daemon.client()?;
    let id = begin(&client, args.name.clone())?;
    let mut told = 0;
    loop {
        let now = client.calibration(&id)?;
        for verdict in now.verdicts.iter().skip(told) {
            print_line(verdict_line(verdict))?;
        }
        told = now.verdicts.len();
        match now.state {
            SessionState::Awaiting => ask(&client, &now)?,
            SessionState::Completed => return Ok(print_line(end(&now))?),
            state if state.is_final() => {
                bail!("calibration {id} is {state}{}", now.reason.map(|r| format!(": {r}")).unwrap_or_default())
            }
            _ => std::thread::sleep(LOOK_EVERY),
        }
    }
}

/// A run that waits for an operator, or a new one.
fn begin(client: &Client, name: Option<String>) -> anyhow::Result<String> {
    if let Some(waiting) = client.calibrations()?.into_iter().find(|run| run.kind == Kind::Rig && !run.state.is_final())
    {
        print_line(format!("calibration {} ({}) is {}: taken up", waiting.version, waiting.id, waiting.state))?;
        return Ok(waiting.id);
    }
    let started = client.start_calibration(&CalibrationRequest { name, ..CalibrationRequest::default() })?;
    print_line(format!("calibration {} ({}): arm, camera and lamp are being made ready", started.version, started.id))?;
    Ok(started.id)
}

/// Says what is to be done, waits until it is, and has it shot.
fn ask(client: &Client, now: &CalibrationSnapshot) -> anyhow::Result<()> {
    print_line(format!("\n{}", now.instruction.as_deref().unwrap_or_default()))?;
    let mut out = std::io::stdout();
    let verb = loop {
        write!(out, "Enter shoots, q and Enter aborts: ").and_then(|()| out.flush())?;
        let mut line = String::new();
        if std::io::stdin().lock().read_line(&mut line)? == 0 {
            bail!("no more input: calibration {} still waits; run this again to take it up", now.id);
        }
        match verb(&line) {
            Some(verb) => break verb,
            None => print_line(HELP)?,
        }
    };
    match client.command_calibration(&now.id, verb) {
        // Somebody else was faster: the next look tells.
        Err(ClientError::Refused(problem)) if problem.current_state.is_some() => Ok(()),
        answer => Ok(answer.map(|_| ())?),
    }
}

const HELP: &str = "\
nothing is done: press Enter alone when what is asked for is in place, q and Enter to abort the calibration; Ctrl-C leaves it waiting";

/// What a line means: a stray word must neither shoot nor abort.
fn verb(line: &str) -> Option<Verb> {
    match line.trim() {
        "" => Some(Verb::Shoot),
        "q" | "Q" => Some(Verb::Abort),
        _ => None,
    }
}

fn verdict_line(verdict: &Verdict) -> String {
    let name = verdict.step.name();
    match &verdict.reason {
        None => format!("{name}: accepted"),
        Some(reason) => format!("{name}: REFUSED: {reason}"),
    }
}

/// What the last step found, for people.
fn end(now: &CalibrationSnapshot) -> String {
    let found = now.verdicts.last().map_or(&Value::Null, |verdict| &verdict.found);
    let number = |value: &Value, digits: usize| value.as_f64().map_or("?".into(), |v| format!("{v:.digits$}"));
    let (camera, sigma) = (&found["camera"], &found["camera"]["sigma"]);
    let mut text = format!(
        "\ncalibration {} is complete\nfocal length {} +- {} px, board {} px rms, highlights {} px rms\n",
        now.version,
        number(&camera["focal_px"][0], 2),
        number(&sigma["focal_px"][0], 2),
        number(&camera["rms_px"], 3),
        number(&found["highlights_rms_px"], 3),
    );
    for light in found["lights"].as_array().into_iter().flatten() {
        let all = |value: &Value, digits| (0..3).map(|k| number(&value[k], digits)).collect::<Vec<_>>().join(", ");
        let angle = number(&light["angle_deg"], 1);
        let (position, sigma) = (all(&light["position_mm"], 1), all(&light["position_sigma_mm"], 2));
        text += &format!("light at {angle} degrees: ({position}) mm +- ({sigma})\n");
    }
    for warning in found["warnings"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        text += &format!("warning: {warning}\n");
    }
    text + &format!("sessions use it from now on; all of it: rigd calibrate show {}", now.id)
}

/// Runs `rigd calibrate list`.
///
/// # Errors
/// No daemon, or a stdout that takes nothing.
pub fn list(args: &List) -> anyhow::Result<()> {
    let runs = args.daemon.client()?.calibrations()?;
    if args.json {
        return print_json(&runs);
    }
    if runs.is_empty() {
        return Ok(print_line("no calibration yet: `rigd calibrate run` makes one")?);
    }
    let mut table = Table::new([
        ("no.", Side::Right),
        ("started", Side::Left),
        ("calibration", Side::Left),
        ("state", Side::Left),
        ("steps", Side::Right),
        ("name", Side::Left),
    ]);
    for run in runs {
        table.row([
            run.version.to_string().into(),
            here(&run.started).into(),
            run.id.as_str().into(),
            state(&run.state.to_string()),
            format!("{}/{}", run.steps_accepted, run.steps).into(),
            with_reason(&run.name, run.reason.as_deref()).into(),
        ]);
    }
    Ok(table.print()?)
}

/// Runs `rigd calibrate show`.
///
/// # Errors
/// No daemon, no such calibration, or a stdout that takes nothing.
pub fn show(args: &Show) -> anyhow::Result<()> {
    let client = args.daemon.client()?;
    let run = client.calibration(&args.id)?;
    let value = match run.state {
        SessionState::Completed => client.calibration_result(&args.id)?,
        _ => serde_json::to_value(run)?,
    };
    print_json(&value)
}
