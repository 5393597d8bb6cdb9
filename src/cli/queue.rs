//! `rigd queue ...`: sessions that wait for their turn.

use super::error::{print_json, print_line};
use super::session::{AdaptiveArgs, Connection};
use super::table::{Side, Table, here, with_reason};
use crate::session::handle::{QueueRequest, QueueSnapshot, QueuedSession};
use crate::session::plan::StartRequest;
use clap::{Args, Subcommand};

/// Queue sessions of a running daemon: they are started one after another, also after the daemon was ended.
#[derive(Args, Debug)]
pub struct QueueArgs {
    #[command(flatten)]
    connection: Connection,
    /// Print the daemon's answer as JSON and nothing else.
    #[arg(long, global = true)]
    json: bool,
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
    List,
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
    let (client, json) = (args.connection.client()?, args.json);
    match args.command {
        QueueCommand::Add { name, calibration, adaptive, runs, not_before, every, hold_on_failure } => {
            let session = StartRequest { name, calibration, adaptive: adaptive.request(), ..StartRequest::default() };
            let request = QueueRequest { session, runs, not_before, every_s: every, hold_on_failure };
            let queued = client.enqueue(&request)?;
            if json { print_json(&queued) } else { Ok(print_line(queued.entry.id)?) }
        }
        QueueCommand::List => show(&client.queue()?, json),
        QueueCommand::Remove { id } => {
            client.dequeue(&id)?;
            if json { print_json(&client.queue()?) } else { Ok(()) }
        }
        QueueCommand::First { id } => show(&client.queue_first(&id)?, json),
        QueueCommand::Hold => show(&client.hold_queue(true)?, json),
        QueueCommand::Release => show(&client.hold_queue(false)?, json),
    }
}

fn show(queue: &QueueSnapshot, json: bool) -> anyhow::Result<()> {
    if json {
        return print_json(queue);
    }
    if let Some(reason) = &queue.held {
        print_line(format!("held ({reason}): `rigd queue release` lets it go on"))?;
    }
    if let Some(reason) = &queue.waits {
        print_line(format!("waits ({reason}): `rigd queue release` tries at once"))?;
    }
    if queue.entries.is_empty() {
        return Ok(print_line("nothing waits")?);
    }
    let mut table = Table::new([
        ("entry", Side::Left),
        ("started", Side::Right),
        ("from", Side::Left),
        ("to", Side::Left),
        ("GB", Side::Right),
        ("name", Side::Left),
    ]);
    queue.entries.iter().for_each(|queued| row(&mut table, queued));
    Ok(table.print()?)
}

/// An entry, and below it why it cannot be planned or started.
fn row(table: &mut Table<6>, queued: &QueuedSession) {
    let entry = &queued.entry;
    let time = |time: &Option<String>| time.as_deref().map(here).unwrap_or_default();
    let gigabytes = queued.estimated_bytes.map(|bytes| format!("{:.2}", bytes as f64 / 1e9)).unwrap_or_default();
    let name = entry.request.session.name.as_deref().unwrap_or("the rig file's name");
    let refused = entry.refused.as_ref().map(|why| format!("refused: {why}"));
    table.row([
        entry.id.as_str().into(),
        format!("{}/{}", entry.started, entry.request.runs).into(),
        time(&queued.estimated_start).into(),
        time(&queued.estimated_end).into(),
        gigabytes.into(),
        with_reason(name, refused.as_deref()).into(),
    ]);
    if entry.left() == 0 {
        table.below("no more runs to start");
    } else if queued.estimated_start.is_none() {
        table.below("cannot be planned as the rig is");
    }
}
