//! `rigd session ...`: a client of the daemon's REST surface.
mod adaptive;
mod client;
mod connection;
mod failure;
mod watch;

pub use adaptive::AdaptiveArgs;
pub use client::Client;
pub use connection::Connection;
pub use failure::ClientError;
pub use watch::watch;

use super::error::{print_json, print_line, warn};
use super::progress::Progress;
use super::table::{Side, Table, here, percent, state, with_reason};
use super::terminal::Tone;
use crate::session::handle::SessionSnapshot;
use crate::session::plan::StartRequest;
use crate::session::state::{SessionState, Verb};
use anyhow::bail;
use clap::{Args, Subcommand};
use client::Frame;

/// Start, follow and steer acquisitions of a running daemon.
#[derive(Args, Debug)]
pub struct SessionArgs {
    #[command(flatten)]
    connection: Connection,
    /// Print the daemon's answer as JSON and nothing else; of a session that is followed, its end.
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    command: SessionCommand,
}

#[derive(Subcommand, Debug)]
enum SessionCommand {
    /// Start the rig file's own plan.
    Start {
        /// A name for the sampled object.
        #[arg(long)]
        name: Option<String>,
        /// The calibration to use: an id, `latest`, or `none` for the rig file's geometry; the latest that fits if left out.
        #[arg(long)]
        calibration: Option<String>,
        #[command(flatten)]
        adaptive: AdaptiveArgs,
        /// Print the plan; nothing moves.
        #[arg(long, conflicts_with = "watch")]
        dry_run: bool,
        /// Follow the session to its end.
        #[arg(long)]
        watch: bool,
    },
    /// List sessions, newest first.
    List,
    /// Print a session as JSON.
    Show { id: String },
    /// List the frames of a session.
    Frames { id: String },
    /// Follow a session to its end.
    Watch { id: String },
    /// Pause at the next safe point.
    Pause { id: String },
    /// Go on after a pause, a suspension, or an interruption: stations that are whole are kept.
    Resume { id: String },
    /// End early, clean up, keep and fit what is there.
    Stop { id: String },
    /// End now, clean up, fit nothing.
    Abort { id: String },
}

/// Runs the command; fails when a followed session ends in another way than `completed` or `stopped`.
///
/// # Errors
/// No daemon, a refusal, a session that ended badly, or a stdout that takes nothing.
pub fn run(args: &SessionArgs) -> anyhow::Result<()> {
    let (client, json) = (args.connection.client()?, args.json);
    match &args.command {
        SessionCommand::Start { name, calibration, adaptive, dry_run, watch } => {
            let (name, calibration, adaptive) = (name.clone(), calibration.clone(), adaptive.request());
            let request = StartRequest { name, calibration, adaptive, ..StartRequest::default() };
            if *dry_run {
                return print_json(&client.plan(&request)?);
            }
            let started = client.start(&request)?;
            match (json, *watch) {
                (true, false) => print_json(&started)?,
                (true, true) => {}
                (false, _) => {
                    print_line(&started.id)?;
                    warn(&started.warnings);
                }
            }
            if *watch { follow(&client, &started.id, json) } else { Ok(()) }
        }
        SessionCommand::List if json => print_json(&client.list()?),
        SessionCommand::List => list(&client.list()?),
        SessionCommand::Show { id } => print_json(&client.session(id)?),
        SessionCommand::Frames { id } if json => print_json(&client.frames(id)?),
        SessionCommand::Frames { id } => frames(&client.frames(id)?),
        SessionCommand::Watch { id } => follow(&client, id, json),
        SessionCommand::Pause { id } => command(&client, id, Verb::Pause, json),
        SessionCommand::Resume { id } => command(&client, id, Verb::Resume, json),
        SessionCommand::Stop { id } => command(&client, id, Verb::Stop, json),
        SessionCommand::Abort { id } => command(&client, id, Verb::Abort, json),
    }
}

fn command(client: &Client, id: &str, verb: Verb, json: bool) -> anyhow::Result<()> {
    let session = client.command(id, verb)?;
    if json { print_json(&session) } else { Ok(print_line(line(&session))?) }
}

fn list(sessions: &[SessionSnapshot]) -> anyhow::Result<()> {
    if sessions.is_empty() {
        return Ok(print_line("no session yet: `rigd session start` starts the rig file's plan")?);
    }
    let mut table = Table::new([
        ("session", Side::Left),
        ("started", Side::Left),
        ("state", Side::Left),
        ("frames", Side::Right),
        ("error", Side::Right),
        ("name", Side::Left),
    ]);
    for s in sessions {
        table.row([
            s.id.as_str().into(),
            here(&s.started).into(),
            state(&s.state.to_string()),
            format!("{}/{}", s.frames_committed, s.frames_planned).into(),
            percent(s.mean_relative_error).into(),
            with_reason(&s.name, s.reason.as_deref()).into(),
        ]);
    }
    Ok(table.print()?)
}

fn frames(frames: &[Frame]) -> anyhow::Result<()> {
    if frames.is_empty() {
        return Ok(print_line("no frame yet")?);
    }
    let numbers = ["station", "exposure", "shutter s", "bytes"].map(|name| (name, Side::Right));
    let [station, exposure, shutter, bytes] = numbers;
    let mut table = Table::new([station, exposure, shutter, bytes, ("state", Side::Left), ("file", Side::Left)]);
    for frame in frames {
        table.row([
            frame.station.to_string().into(),
            frame.exposure.to_string().into(),
            frame.shutter.as_str().into(),
            frame.bytes.to_string().into(),
            frame.state.as_str().into(),
            frame.file.as_str().into(),
        ]);
    }
    Ok(table.print()?)
}

/// Fails when the session ends in another way than `completed` or `stopped`.
fn follow(client: &Client, id: &str, json: bool) -> anyhow::Result<()> {
    let ended = watch(client, id, &Progress::counted_unless(json, "frames"))?;
    if json {
        print_json(&ended)?;
    } else {
        tell(&ended)?;
    }
    if !matches!(ended.state, SessionState::Completed | SessionState::Stopped) {
        bail!("session {id} {}", how_it_ended(&ended));
    }
    Ok(())
}

fn tell(ended: &SessionSnapshot) -> anyhow::Result<()> {
    print_line(line(ended))?;
    if let Some(budget) = &ended.time_budget {
        print_line(format!("time: {budget}"))?;
    }
    if let Some(saved) = &ended.saved {
        print_line(format!("left out: {saved}"))?;
    }
    if ended.interruptions > 0 {
        print_line(format!("interrupted and gone on: {} times", ended.interruptions))?;
    }
    warn(&ended.warnings);
    Ok(())
}

/// `is failed: no answer from the camera`, `is aborted`.
pub(super) fn how_it_ended(s: &SessionSnapshot) -> String {
    let reason = s.reason.as_ref().map(|reason| format!(": {reason}"));
    let resume = (s.state == SessionState::Interrupted)
        .then(|| format!("; put right what is wrong, then `rigd session resume {}` goes on with it", s.id));
    format!("is {}{}{}", s.state, reason.unwrap_or_default(), resume.unwrap_or_default())
}

/// A session in one line.
fn line(s: &SessionSnapshot) -> String {
    let error = s.mean_relative_error.map(|e| format!("  mean relative error {:.2} %", 100.0 * e));
    let reason = s.reason.as_ref().map(|r| format!("  ({r})"));
    format!(
        "{}  {}  {}  {}/{} frames  {}{}{}",
        s.id,
        s.started,
        Tone::of_state(&s.state.to_string()).out(s.state),
        s.frames_committed,
        s.frames_planned,
        s.name,
        error.unwrap_or_default(),
        reason.unwrap_or_default()
    )
}
