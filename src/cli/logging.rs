//! Where the log goes: to systemd's journal, with its fields, where stderr goes there anyway; else to stderr as text. Its last lines stay
//! in memory as well, for `GET /v1/log`.

use super::terminal::has_colours;
use crate::http::LogTail;
use jiff::Timestamp;
use nix::sys::stat::fstat;
use std::fmt::{Debug, Write};
use std::io::stderr;
use std::sync::{Arc, LazyLock};
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_subscriber::layer::Context;
use tracing_subscriber::prelude::*;
use tracing_subscriber::{EnvFilter, Layer};

/// At its finest the HTTP client logs whole addresses, and those of notifications hold secrets.
const QUIET: [&str; 2] = ["ureq=warn", "ureq_proto=warn"];

/// How much of the log stays in memory.
const KEPT: &str = "warn,rigd=info";

static TAIL: LazyLock<Arc<LogTail>> = LazyLock::new(Arc::default);

/// The last lines of this process's log.
pub fn tail() -> Arc<LogTail> {
    Arc::clone(&TAIL)
}

/// Starts the log of this process; RIGD_LOG says how much of it, warnings if it says nothing.
pub fn start() {
    let filter = || quiet(EnvFilter::try_from_env("RIGD_LOG").unwrap_or_else(|_| EnvFilter::new("warn")));
    let kept = Kept(tail()).with_filter(quiet(EnvFilter::new(KEPT)));
    // A journal that does not answer gets the text of stderr all the same.
    if let Some(journal) = goes_to_journal().then(tracing_journald::layer).and_then(Result::ok) {
        let journal = journal.with_field_prefix(None).with_filter(filter());
        return tracing_subscriber::registry().with(kept).with(journal).init();
    }
    let text = tracing_subscriber::fmt::layer()
        .with_writer(stderr)
        // In a file colours are noise.
        .with_ansi(has_colours(&stderr()))
        // A closed stderr must not become a panic of whoever logs.
        .log_internal_errors(false)
        .with_filter(filter());
    tracing_subscriber::registry().with(kept).with(text).init();
}

fn quiet(filter: EnvFilter) -> EnvFilter {
    QUIET.iter().filter_map(|quiet| quiet.parse().ok()).fold(filter, EnvFilter::add_directive)
}

/// Puts every event into the tail.
struct Kept(Arc<LogTail>);

impl<S: Subscriber> Layer<S> for Kept {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut said = Said::default();
        event.record(&mut said);
        let data = event.metadata();
        self.0.push(Timestamp::now().to_string(), data.level().as_str(), data.target(), &(said.message + &said.fields));
    }
}

/// An event in words.
#[derive(Default)]
struct Said {
    message: String,
    fields: String,
}

impl Visit for Said {
    fn record_str(&mut self, field: &Field, value: &str) {
        self.record_debug(field, &format_args!("{value}"));
    }

    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        // Writing into a String does not fail.
        let _ = match field.name() {
            "message" => write!(self.message, "{value:?}"),
            name => write!(self.fields, " {name}={value:?}"),
        };
    }
}

/// Whether stderr is the stream to the journal that systemd gave this process: `JOURNAL_STREAM` names its device and inode, and is
/// inherited by programs whose stderr goes elsewhere.
fn goes_to_journal() -> bool {
    let Ok(named) = std::env::var("JOURNAL_STREAM") else { return false };
    fstat(stderr()).is_ok_and(|found| names(&named, found.st_dev, found.st_ino))
}

fn names(stream: &str, device: u64, inode: u64) -> bool {
    stream.split_once(':').is_some_and(|(d, i)| d.parse() == Ok(device) && i.parse() == Ok(inode))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_stream_that_is_named_is_the_journals() {
        assert!(names("8:1234", 8, 1234));
        for other in ["8:1235", "9:1234", "8", "", ":", "8:", "8:1234:", "+8:1234x"] {
            assert!(!names(other, 8, 1234), "{other}");
        }
    }
}
