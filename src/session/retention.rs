//! How long completed sessions are kept (`storage.keep_days`): what was verified as it stands is removed, oldest first.

use super::book::{Book, Entry};
use super::handle::SessionSnapshot;
use super::state::SessionState;
use super::verifying::Verification;
use crate::store::verified;
use jiff::Timestamp;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Time between two looks.
const LOOK: Duration = Duration::from_secs(3600);
const DAY_S: f64 = 86_400.0;

/// Starts the thread; it looks at once, and ends with the daemon.
pub fn spawn(book: Arc<Book>, keep_days: f64) -> std::io::Result<()> {
    let run = move || {
        loop {
            remove_what_may_go(&book, keep_days);
            if book.watch(LOOK, |inner| (inner.shutdown || inner.ended).then_some(())).is_some() {
                return;
            }
        }
    };
    std::thread::Builder::new().name("retention".into()).spawn(run).map(|_| ())
}

/// Whether a session may be removed; the error says why it stays.
pub fn may_go(run: &SessionSnapshot, directory: &Path, keep_days: f64, now: Timestamp) -> Result<(), String> {
    if run.state != SessionState::Completed {
        return Err(format!("it is {}", run.state));
    }
    let ended = run.ended.as_ref().and_then(|time| time.parse::<Timestamp>().ok());
    let ended = ended.ok_or("when it ended is not known")?;
    let age_days = now.duration_since(ended).as_secs_f64() / DAY_S;
    if age_days < keep_days {
        return Err(format!("it ended {age_days:.1} days ago and is kept for {keep_days}"));
    }
    match verified::holds(directory) {
        Ok(true) => Ok(()),
        Ok(false) => Err("it was not verified as it stands: `rigd verify`".into()),
        Err(error) => Err(error.to_string()),
    }
}

fn remove_what_may_go(book: &Book, keep_days: f64) {
    let sessions: Vec<(SessionSnapshot, PathBuf)> = {
        let inner = book.lock();
        let sessions = inner.runs.values().filter(|entry| entry.work.capture().is_some());
        sessions.map(|entry| (entry.ledger.snapshot.clone(), entry.directory.clone())).collect()
    };
    for (session, directory) in sessions {
        if may_go(&session, &directory, keep_days, book.clock.now()).is_ok() {
            remove(book, &session);
        }
    }
}

/// Removes a session that is still as it was looked at: out of the list and under another name in one step, its files after that.
fn remove(book: &Book, session: &SessionSnapshot) {
    let id = session.id.as_str();
    let (grave, disk) = {
        let mut inner = book.lock();
        let unchanged = |entry: &Entry| entry.ledger.snapshot == *session;
        let wanted = inner.queue.running().is_some_and(|(_, running)| running == id)
            || inner.refits.iter().any(|refit| refit == id)
            || inner.verifying.as_ref().and_then(Verification::running) == Some(id);
        if inner.shutdown || wanted || !inner.runs.get(id).is_some_and(unchanged) {
            return;
        }
        let Some(directory) = inner.runs.get(id).map(|entry| entry.directory.clone()) else { return };
        match inner.store.take_out(&directory) {
            Ok(grave) => {
                inner.runs.remove(id);
                (grave, inner.store.disk())
            }
            Err(error) => return tracing::error!(session = id, %error, "a session that may go is not removed"),
        }
    };
    book.tell();
    let (name, ended) = (session.name.as_str(), session.ended.as_deref());
    match disk.remove_directory(&grave) {
        Ok(()) => tracing::info!(session = id, name, ended, "removed after its time (storage.keep_days)"),
        Err(error) => tracing::error!(session = id, %error, "removed in part: the rest goes at the next start"),
    }
}
