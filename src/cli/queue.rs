//! `rigd queue ...`: sessions that wait for their turn.

use super::error::print_line;
use super::session::{AdaptiveArgs, Connection};
use crate::session::handle::{QueueRequest, QueueSnapshot, QueuedSession};
use crate::session::plan::StartRequest;
use clap::{Args, Subcommand};

/// Queue sessions of a running daemon: they are started one after another, also after the daemon was ended.
#[derive(Args, Debug)]
pub struct QueueArgs {
    #[command(flatten)]
    connection: Connection,
    #[command(subcommand)]
    command: QueueCommand,
}

#[derive(Subcommand, Debug)]
enum QueueCommand {
    /// Put the rig file's own plan at the end of the queue.
    Add {
        /// A name for the sampled object.
        #[arg(long)]
        name: Option<String>,
        /// The calibration to use: an id, `latest`, or `none`; when its turn comes the latest that fits, if left out.
        #[arg(long)]
        calibration: Option<String>,
        #[command(flatten)]
        adaptive: AdaptiveArgs,
        /// How often it is shot.
        #[arg(long, default_value_t = 1)]
        runs: u32,
        /// Not started before this time: 2026-11-30T22:00:00+01:00.
        #[arg(long, value_name = "TIME")]
        not_before: Option<String>,
        /// Seconds from one start to the next; as soon as possible if left out.
        #[arg(long, value_name = "SECONDS")]
        every: Option<f64>,
        /// A run that fails holds the queue.
        #[arg(long)]
        hold_on_failure: bool,
    },
    /// List what waits, with the times to be expected.
    List {
        /// Print the queue as JSON and nothing else.
        #[arg(long)]
        json: bool,
    },
    /// Take an entry out; a run of it that goes on is not ended.
    Remove { id: String },
    /// Make an entry the next one; one that was refused is tried again.
    First { id: String },
    /// Start nothing more of it; what is running goes on.
    Hold,
    /// Let it go on.
    Release,
}

/// Runs the command.
///
/// # Errors
/// No daemon, a refusal, or a stdout that takes nothing.
pub fn run(args: QueueArgs) -> anyhow::Result<()> {
    let client = args.connection.client()?;
    match args.command {
        QueueCommand::Add { name, calibration, adaptive, runs, not_before, every, hold_on_failure } => {
            let session = StartRequest { name, calibration, adaptive: adaptive.request(), ..StartRequest::default() };
            let request = QueueRequest { session, runs, not_before, every_s: every, hold_on_failure };
            Ok(print_line(client.enqueue(&request)?.entry.id)?)
        }
        QueueCommand::List { json: true } => Ok(print_line(serde_json::to_string_pretty(&client.queue()?)?)?),
        QueueCommand::List { json: false } => show(&client.queue()?),
        QueueCommand::Remove { id } => Ok(client.dequeue(&id)?),
        QueueCommand::First { id } => show(&client.queue_first(&id)?),
        QueueCommand::Hold => show(&client.hold_queue(true)?),
        QueueCommand::Release => show(&client.hold_queue(false)?),
    }
}

fn show(queue: &QueueSnapshot) -> anyhow::Result<()> {
    if let Some(reason) = &queue.held {
        print_line(format!("held ({reason}): `rigd queue release` lets it go on"))?;
    }
    if let Some(reason) = &queue.waits {
        print_line(format!("waits ({reason}): `rigd queue release` tries at once"))?;
    }
    if queue.entries.is_empty() {
        print_line("nothing waits")?;
    }
    queue.entries.iter().try_for_each(|queued| Ok(print_line(line(queued))?))
}

/// An entry in one line.
fn line(queued: &QueuedSession) -> String {
    let entry = &queued.entry;
    let name = entry.request.session.name.as_deref().unwrap_or("the rig file's name");
    let when = match (&queued.estimated_start, &queued.estimated_end) {
        (Some(start), Some(end)) => format!("{start} to {end}"),
        _ if entry.left() == 0 => "no more runs to start".into(),
        _ => "cannot be planned as the rig is".into(),
    };
    let gigabytes = queued.estimated_bytes.map(|bytes| format!("  {:.2} GB", bytes as f64 / 1e9)).unwrap_or_default();
    let refused = entry.refused.as_ref().map(|why| format!("  (refused: {why})")).unwrap_or_default();
    format!(
        "{}  {} of {} runs started  {when}{gigabytes}  {name}{refused}",
        entry.id, entry.started, entry.request.runs
    )
}
