//! The index of the data directory, kept up to the journals by a thread of its own.
//!
//! It follows the book as every client does, takes what it needs while it holds the lock and works without it, so that nothing waits for
//! SQLite. When the index cannot be written, the log and `/metrics` say so once, and sessions go on.

mod account;
mod check;
mod rebuild;
mod writer;

pub use check::{CheckError, Checked, check};
pub use rebuild::{RebuildError, Rebuilt, rebuild};

use super::book::Book;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::runtime::{Builder, Runtime};
use tokio_util::sync::CancellationToken;
use writer::Writer;

/// Least time between two transactions: what is journalled meanwhile goes into one.
const REST: Duration = Duration::from_millis(500);
/// Time after which an index that could not be written is tried again.
const AGAIN: Duration = Duration::from_secs(60);
/// How long the end of the daemon waits for an index that is still being made; the next start goes on with it.
const LAST: Duration = Duration::from_secs(5);

/// The running thread.
pub(super) struct Indexer {
    end: CancellationToken,
    thread: JoinHandle<()>,
}

impl Indexer {
    /// Starts to keep the index of `data`, the book's own directory.
    ///
    /// # Errors
    /// No thread can be had.
    pub(super) fn spawn(book: Arc<Book>, data: PathBuf) -> io::Result<Self> {
        let end = CancellationToken::new();
        // Only to wait: for a change of the book and for the end at once.
        let runtime = Builder::new_current_thread().enable_time().build()?;
        let ended = end.clone();
        let run = move || keep(&book, data, &runtime, &ended);
        let thread = std::thread::Builder::new().name("index".into()).spawn(run)?;
        Ok(Self { end, thread })
    }

    /// Writes what is still missing and closes the index; nothing is written once this has returned.
    pub(super) fn end(self) {
        self.end.cancel();
        if self.thread.join().is_err() {
            tracing::error!("the index ended by an internal error: the next start brings it up");
        }
    }
}

fn keep(book: &Book, data: PathBuf, runtime: &Runtime, end: &CancellationToken) {
    let (mut changes, mut writer) = (book.changes(), Writer::new(data));
    while !end.is_cancelled() {
        // What changes from here on wakes it up again.
        changes.mark_unchanged();
        writer.bring_up(book, &|| end.is_cancelled());
        let next = async {
            if writer.is_faulty() {
                return tokio::time::sleep(AGAIN).await;
            }
            tokio::time::sleep(REST).await;
            // The book, and with it the sender, is there as long as this thread.
            let _ = changes.changed().await;
        };
        runtime.block_on(async {
            tokio::select! {
                () = end.cancelled() => {}
                () = next => {}
            }
        });
    }
    let begun = Instant::now();
    writer.bring_up(book, &|| begun.elapsed() > LAST);
}
