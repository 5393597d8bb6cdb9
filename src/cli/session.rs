//! `rigd session ...`: a client of the daemon's REST surface.
mod adaptive;
mod client;
mod connection;
mod watch;

pub use adaptive::AdaptiveArgs;
pub use client::{Client, ClientError};
pub use connection::Connection;
pub use watch::watch;

use super::error::print_line;
use crate::session::handle::SessionSnapshot;
use crate::session::plan::StartRequest;
use crate::session::state::{SessionState, Verb};
use crate::store::files::escaped;
use anyhow::bail;
use clap::{Args, Subcommand};
use serde::Serialize;
use std::io::{self, Write};

/// Start, follow and steer acquisitions of a running daemon.
#[derive(Args, Debug)]
pub struct SessionArgs {
    #[command(flatten)]
    connection: Connection,
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
    let client = args.connection.client()?;
    match &args.command {
        SessionCommand::Start { name, calibration, adaptive, dry_run, watch } => {
            let (name, calibration, adaptive) = (name.clone(), calibration.clone(), adaptive.request());
            let request = StartRequest { name, calibration, adaptive, ..StartRequest::default() };
            if *dry_run {
                return print_json(&client.plan(&request)?);
            }
            let started = client.start(&request)?;
            print_line(&started.id)?;
            warn_of(&started.warnings);
            if *watch { follow(&client, &started.id) } else { Ok(()) }
        }
        SessionCommand::List => client.list()?.iter().try_for_each(|session| Ok(print_line(line(session))?)),
        SessionCommand::Show { id } => print_json(&client.session(id)?),
        SessionCommand::Watch { id } => follow(&client, id),
        SessionCommand::Pause { id } => command(&client, id, Verb::Pause),
        SessionCommand::Resume { id } => command(&client, id, Verb::Resume),
        SessionCommand::Stop { id } => command(&client, id, Verb::Stop),
        SessionCommand::Abort { id } => command(&client, id, Verb::Abort),
    }
}

/// What to know before the night, beside the answer.
pub(super) fn warn_of(warnings: &[String]) {
    for warning in warnings {
        // Nothing can be done about a closed stderr.
        let _ = writeln!(io::stderr(), "warning: {}", escaped(warning));
    }
}

fn command(client: &Client, id: &str, verb: Verb) -> anyhow::Result<()> {
    Ok(print_line(line(&client.command(id, verb)?))?)
}

fn follow(client: &Client, id: &str) -> anyhow::Result<()> {
    let ended = watch(client, id)?;
    print_line(line(&ended))?;
    if let Some(budget) = &ended.time_budget {
        print_line(format!("time: {budget}"))?;
    }
    if let Some(saved) = &ended.saved {
        print_line(format!("left out: {saved}"))?;
    }
    if ended.interruptions > 0 {
        print_line(format!("interrupted and gone on: {} times", ended.interruptions))?;
    }
    warn_of(&ended.warnings);
    if !matches!(ended.state, SessionState::Completed | SessionState::Stopped) {
        bail!("session {id} {}", how_it_ended(&ended));
    }
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
        s.state,
        s.frames_committed,
        s.frames_planned,
        s.name,
        error.unwrap_or_default(),
        reason.unwrap_or_default()
    )
}

fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    Ok(print_line(serde_json::to_string_pretty(value)?)?)
}
