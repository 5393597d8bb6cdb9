//! `rigd session ...`: a client of the daemon's REST surface.
mod client;
mod watch;

pub use client::{Client, ClientError};
pub use watch::watch;

use crate::session::handle::SessionSnapshot;
use crate::session::plan::StartRequest;
use crate::session::state::{SessionState, Verb};
use clap::{Args, Subcommand};
use serde::Serialize;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

/// Start, follow and steer acquisitions of a running daemon.
#[derive(Args, Debug)]
pub struct SessionArgs {
    /// Where the daemon listens.
    #[arg(long, global = true, default_value = "http://127.0.0.1:7040")]
    url: String,
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
    /// Go on after a pause or suspension.
    Resume { id: String },
    /// End early, clean up, keep and fit what is there.
    Stop { id: String },
    /// End now, clean up, fit nothing.
    Abort { id: String },
}

/// Runs the command. Exit status: 0 done, 1 the work failed, 2 wrong usage or bad input (one message on stderr).
pub fn run(args: &SessionArgs) -> ExitCode {
    match act(args) {
        Ok(code) => code,
        Err(error) if is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            // Nothing can be done about a closed stderr.
            let _ = writeln!(std::io::stderr(), "rigd session: {error:#}");
            ExitCode::from(error.downcast_ref::<ClientError>().map_or(1, ClientError::exit_status))
        }
    }
}

fn act(args: &SessionArgs) -> anyhow::Result<ExitCode> {
    let client = Client::new(&args.url)?;
    match &args.command {
        SessionCommand::Start { name, dry_run, watch } => {
            let request = StartRequest { name: name.clone(), ..StartRequest::default() };
            if *dry_run {
                return print_json(&client.plan(&request)?);
            }
            let started = client.start(&request)?;
            print(&started.id)?;
            if *watch { follow(&args.url, &started.id) } else { Ok(ExitCode::SUCCESS) }
        }
        SessionCommand::List => {
            for session in client.list()? {
                print(&line(&session))?;
            }
            Ok(ExitCode::SUCCESS)
        }
        SessionCommand::Show { id } => print_json(&client.session(id)?),
        SessionCommand::Watch { id } => follow(&args.url, id),
        SessionCommand::Pause { id } => command(&client, id, Verb::Pause),
        SessionCommand::Resume { id } => command(&client, id, Verb::Resume),
        SessionCommand::Stop { id } => command(&client, id, Verb::Stop),
        SessionCommand::Abort { id } => command(&client, id, Verb::Abort),
    }
}

fn command(client: &Client, id: &str, verb: Verb) -> anyhow::Result<ExitCode> {
    print(&line(&client.command(id, verb)?))?;
    Ok(ExitCode::SUCCESS)
}

fn follow(url: &str, id: &str) -> anyhow::Result<ExitCode> {
    let ended = watch(url, id)?;
    print(&line(&ended))?;
    Ok(ExitCode::from(match ended.state {
        SessionState::Completed | SessionState::Stopped => 0,
        _ => 1,
    }))
}

/// A session in one line.
fn line(s: &SessionSnapshot) -> String {
    let error = s.mean_relative_error.map(|e| format!("  mean relative error {:.2} %", 100.0 * e));
    let reason = s.reason.as_ref().map(|r| format!("  ({r})"));
    format!(
        "{}  {}  {}  {}/{} frames  {}{}{}",
        s.id,
        s.started,
        state_name(s.state),
        s.frames_committed,
        s.frames_planned,
        s.name,
        error.unwrap_or_default(),
        reason.unwrap_or_default()
    )
}

/// A state as it is written on the wire.
fn state_name(state: SessionState) -> String {
    format!("{state:?}").to_lowercase()
}

fn print_json(value: &impl Serialize) -> anyhow::Result<ExitCode> {
    print(&serde_json::to_string_pretty(value)?)?;
    Ok(ExitCode::SUCCESS)
}

fn print(text: &str) -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{text}")?;
    out.flush()
}

/// True when whoever read our output has seen enough (`| head`).
fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == ErrorKind::BrokenPipe)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_are_printed_as_on_the_wire() {
        for state in [SessionState::Preflight, SessionState::Interrupted] {
            assert_eq!(serde_json::json!(state), state_name(state));
        }
    }

    #[test]
    fn a_closed_pipe_is_no_failure() {
        let pipe = std::io::Error::from(ErrorKind::BrokenPipe);
        assert!(is_closed_pipe(&pipe.into()));
        assert!(!is_closed_pipe(&std::io::Error::from(ErrorKind::NotFound).into()));
    }
}
