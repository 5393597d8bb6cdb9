//! `rigd history`: questions over all runs of a data directory, answered by its index, with a daemon or without one.

use super::error::{bad_input, print_json, print_line};
use super::table::{Side, Table, here, percent, state, with_reason};
use super::verify::runs;
use crate::session::state::SessionState;
use crate::store::index::{FitRow, FrameRow, Reader, Rows, RunRow, Wanted};
use anyhow::Context;
use jiff::civil::Date;
use jiff::tz::TimeZone;
use jiff::{Timestamp, ToSpan};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// List sessions and calibrations, newest first, out of the index of a data directory; no daemon is needed, and a running one not disturbed.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The data directory.
    data: PathBuf,
    /// Started at this time or later: a date (2026-11-30, from midnight here) or a time (2026-11-30T22:00:00Z).
    #[arg(long, value_name = "TIME")]
    since: Option<String>,
    /// Started before this time; a date is meant to its end.
    #[arg(long, value_name = "TIME")]
    until: Option<String>,
    /// In this state: completed, stopped, aborted, failed, interrupted ...
    #[arg(long)]
    state: Option<String>,
    /// This calibration and sessions that use it: its number or its id.
    #[arg(long)]
    calibration: Option<String>,
    /// The run that a frame comes from: the file, or the blake3 hash of it.
    #[arg(long, value_name = "FILE or BLAKE3")]
    frame: Option<String>,
    /// Print an array and nothing else.
    #[arg(long)]
    json: bool,
}

/// A run as `--json` prints it.
#[derive(Serialize)]
struct Told {
    run: String,
    #[serde(flatten)]
    facts: RunRow,
    /// The last one.
    fit: Option<FitRow>,
    /// The ones that were asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    frames: Vec<FrameRow>,
}

/// Runs the command.
///
/// # Errors
/// A question that is none; no index, or one that cannot be read.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if let Some(state) = &args.state
        && SessionState::deserialize(serde_json::json!(state)).is_err()
    {
        return Err(bad_input(format!("--state {state}: no state of a session: docs/session.md lists them")));
    }
    let since = args.since.as_deref().map(|text| moment(text, 0)).transpose()?;
    let until = args.until.as_deref().map(|text| moment(text, 1)).transpose()?;
    let frame = args.frame.as_deref().map(hash_of).transpose()?;
    let wanted = Wanted { state: args.state.clone(), calibration: args.calibration.clone(), frame };
    let index = Reader::open(&args.data).map_err(bad_input)?;
    tell_what_is_missing(&index, &args.data)?;
    let mut found = index.runs(&wanted)?;
    found.retain(|rows| {
        let started = rows.run.started.parse::<Timestamp>().unwrap_or_default();
        since.is_none_or(|since| started >= since) && until.is_none_or(|until| started < until)
    });
    if args.json {
        let told = |mut rows: Rows| Told { run: rows.id, facts: rows.run, fit: rows.fits.pop(), frames: rows.frames };
        let told: Vec<Told> = found.into_iter().map(told).collect();
        return print_json(&told);
    }
    if found.is_empty() {
        return Ok(print_line("nothing of that kind")?);
    }
    let words = ["started", "run", "kind", "state"].map(|name| (name, Side::Left));
    let [started, run, kind, state] = words;
    let [frames, calibration, error] = ["frames", "cal.", "error"].map(|name| (name, Side::Right));
    let mut table = Table::new([started, run, kind, state, frames, calibration, error, ("name", Side::Left)]);
    found.iter().for_each(|rows| show(&mut table, rows));
    Ok(table.print()?)
}

/// Beginning of a date, `days` later, or the time that is written.
fn moment(text: &str, days: i64) -> anyhow::Result<Timestamp> {
    if let Ok(time) = text.parse::<Timestamp>() {
        return Ok(time);
    }
    // A date with a time but no zone would be read as a date.
    let date = text.parse::<Date>().ok().filter(|_| text.len() == "2026-11-30".len());
    let date = date.and_then(|date| date.checked_add(days.days()).ok());
    let date = date.ok_or_else(|| bad_input(format!("{text}: write 2026-11-30, or 2026-11-30T22:00:00Z")))?;
    Ok(date.to_zoned(TimeZone::system())?.timestamp())
}

/// The hash that is written, or that of the file.
fn hash_of(frame: &str) -> anyhow::Result<String> {
    if frame.len() == 64 && frame.bytes().all(|b| b.is_ascii_hexdigit()) {
        return Ok(frame.to_ascii_lowercase());
    }
    let bytes = std::fs::read(frame).map_err(|e| {
        bad_input(format!("{frame}: neither a file that can be read ({e}) nor a blake3 hash of 64 digits"))
    })?;
    Ok(blake3::hash(&bytes).to_hex().to_string())
}

/// An answer from an index that lacks runs must not pass for all there is.
fn tell_what_is_missing(index: &Reader, data: &Path) -> anyhow::Result<()> {
    let known = index.heads()?;
    let on_disk = runs(data).context("the runs on disk cannot be listed")?;
    let is_known = |run: &PathBuf| run.file_name().is_some_and(|name| known.contains_key(&*name.to_string_lossy()));
    let missing = on_disk.iter().filter(|run| !is_known(run)).count();
    if missing > 0 {
        tracing::warn!(missing, "runs on disk are not in the index: a daemon brings it up, or `rigd index rebuild`");
    }
    Ok(())
}

fn show(table: &mut Table<8>, rows: &Rows) {
    let run = &rows.run;
    let error = rows.fits.last().and_then(|fit| fit.mean_relative_error);
    let why = run.fault.as_ref().map(|fault| format!("damaged journal: {fault}")).or(run.reason.clone());
    table.row([
        here(&run.started).into(),
        rows.id.as_str().into(),
        run.kind.as_str().into(),
        state(&run.state),
        format!("{}/{}", run.frames_committed, run.frames_planned).into(),
        run.calibration_version.map(|version| version.to_string()).unwrap_or_default().into(),
        percent(error).into(),
        with_reason(&run.name, why.as_deref()).into(),
    ]);
    for FrameRow { file, station, exposure, attempt, shutter, state, .. } in &rows.frames {
        table.below(&format!(
            "frame {file}: station {station}, exposure {exposure} ({shutter} s), attempt {attempt}, {state}"
        ));
    }
}
