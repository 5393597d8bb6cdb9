//! Waiting for what others do to the book.

use super::{Book, Inner};
use std::sync::PoisonError;
use std::time::{Duration, Instant};

/// A wait without an end of its own is renewed this often.
const LONG: Duration = Duration::from_secs(3600);

/// What the engine finds to do.
pub enum Next {
    /// This run.
    Run(String),
    /// Nothing came in time.
    Nothing,
    /// The daemon ends.
    End,
}

/// Whoever waits shows at least so often that it does so.
const BEAT: Duration = Duration::from_secs(1);

impl Book {
    /// Waits for a run, for `at_most` if that is given, or for the daemon's end.
    pub fn next_session(&self, at_most: Option<Duration>) -> Next {
        let look = |inner: &mut Inner| {
            let run = inner.pending.take();
            if run.is_some() && !inner.shutdown {
                self.cancel.clear();
            }
            run.map(Next::Run).or_else(|| inner.shutdown.then_some(Next::End))
        };
        loop {
            match (self.wait(at_most.unwrap_or(LONG), look), at_most) {
                (Some(next), _) => return next,
                (None, Some(_)) => return Next::Nothing,
                (None, None) => {}
            }
        }
    }

    /// Waits until `look` finds something or the time is over.
    pub fn wait<T>(&self, time: Duration, look: impl FnMut(&mut Inner) -> Option<T>) -> Option<T> {
        self.wait_with(time, || self.cancel.beat(), look)
    }

    /// The same for others than the engine and who works for it: it is no sign of life of theirs.
    pub fn watch<T>(&self, time: Duration, look: impl FnMut(&mut Inner) -> Option<T>) -> Option<T> {
        self.wait_with(time, || {}, look)
    }

    fn wait_with<T>(
        &self,
        time: Duration,
        beat: impl Fn(),
        mut look: impl FnMut(&mut Inner) -> Option<T>,
    ) -> Option<T> {
        let end = Instant::now() + time;
        let mut inner = self.lock();
        loop {
            if let Some(found) = look(&mut inner) {
                return Some(found);
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return None;
            }
            beat();
            let now = &mut *inner;
            now.lamp.keep(&now.store, false);
            inner = self.changed.wait_timeout(inner, left.min(BEAT)).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}
