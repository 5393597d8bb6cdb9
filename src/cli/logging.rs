//! Where the log goes: to systemd's journal, with its fields, where stderr goes there anyway; else to stderr as text.

use super::terminal::has_colours;
use nix::sys::stat::fstat;
use std::io::stderr;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::prelude::*;

/// At its finest the HTTP client logs whole addresses, and those of notifications hold secrets.
const QUIET: [&str; 2] = ["ureq=warn", "ureq_proto=warn"];

/// Starts the log of this process; RIGD_LOG says how much of it, warnings if it says nothing.
pub fn start() {
    let filter = EnvFilter::try_from_env("RIGD_LOG").unwrap_or_else(|_| EnvFilter::new("warn"));
    let filter = QUIET.iter().filter_map(|quiet| quiet.parse().ok()).fold(filter, EnvFilter::add_directive);
    // A journal that does not answer gets the text of stderr all the same.
    if let Some(journal) = goes_to_journal().then(tracing_journald::layer).and_then(Result::ok) {
        return tracing_subscriber::registry().with(filter).with(journal.with_field_prefix(None)).init();
    }
    tracing_subscriber::fmt()
        .with_writer(stderr)
        // In a file colours are noise.
        .with_ansi(has_colours(&stderr()))
        .with_env_filter(filter)
        // A closed stderr must not become a panic of whoever logs.
        .log_internal_errors(false)
        .init();
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
