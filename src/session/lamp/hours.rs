//! How long the lamp was lit, in a small file that outlives daemon and crashes.

use crate::store::{Clock, Store, StoreError};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

/// Its file in the data directory.
const FILE: &str = "lamp.json";
/// Version of that file.
const FORMAT: u32 = 1;
/// What a crash may take away of the time, at most, beside what the engine does without a record or a wait: a long exposure.
const KEPT_EVERY: Duration = Duration::from_secs(60);
const HOUR_S: f64 = 3600.0;
/// Part of its rated life after which a lamp is to be replaced.
const WORN: f64 = 0.7;

#[derive(Serialize, Deserialize)]
struct LampFile {
    format: u32,
    lit_hours: f64,
}

/// The hours of the lamp that is in the rig.
#[derive(Debug)]
pub struct LampHours {
    /// Up to when it was last switched or kept.
    hours: f64,
    /// When that was, by the clock, if it is lit.
    since: Option<Duration>,
    /// Seconds of the rig for a second of the clock.
    speed: f64,
    /// When they were last written down, and whether some were not.
    kept: Duration,
    unwritten: bool,
    clock: Arc<dyn Clock>,
}

impl LampHours {
    /// Reads the hours of a data directory; 0 where there are none. Time passes `speed` times faster than real.
    ///
    /// # Errors
    /// A file that is none of ours: it is not written over.
    pub fn read(store: &Store, speed: f64) -> Result<Self, StoreError> {
        let hours = match store.read_file(FILE)? {
            Some(bytes) => parse(&bytes)?,
            None => 0.0,
        };
        let clock = store.clock();
        Ok(Self { hours, since: None, speed, kept: clock.elapsed(), unwritten: false, clock })
    }

    /// Hours so far.
    pub fn hours(&self) -> f64 {
        let lit_s = self.since.map_or(0.0, |since| self.since(since).as_secs_f64());
        self.hours + self.speed * lit_s / HOUR_S
    }

    fn since(&self, moment: Duration) -> Duration {
        self.clock.elapsed().saturating_sub(moment)
    }

    /// True while it is lit, as far as is known.
    pub fn is_lit(&self) -> bool {
        self.since.is_some()
    }

    /// The lamp goes on.
    pub fn light(&mut self) {
        self.since.get_or_insert(self.clock.elapsed());
    }

    /// The lamp goes off.
    pub fn put_out(&mut self) {
        if self.since.is_some() {
            (self.hours, self.since) = (self.hours(), None);
            self.unwritten = true;
        }
    }

    /// Writes the time down, if it was not for a minute, or if `now`.
    pub fn keep(&mut self, store: &Store, now: bool) {
        let open = self.unwritten || self.since.is_some();
        if open && (now || self.since(self.kept) >= KEPT_EVERY) {
            (self.hours, self.since) = (self.hours(), self.since.map(|_| self.clock.elapsed()));
            self.write(store);
        }
    }

    /// A disk that does not take it must not keep a session from going on: the next time tells of this one as well.
    fn write(&mut self, store: &Store) {
        (self.kept, self.unwritten) = (self.clock.elapsed(), false);
        let bytes = serde_json::to_vec(&LampFile { format: FORMAT, lit_hours: self.hours }).unwrap_or_default();
        if let Err(error) = store.write_file(FILE, &bytes) {
            tracing::error!(hours = self.hours, %error, "the lamp's hours are not written down");
        }
    }

    /// What to know before another session, if its rated life is nearly over.
    pub fn warning(&self, rated_hours: Option<f64>) -> Option<String> {
        let (hours, rated) = (self.hours(), rated_hours?);
        (hours >= WORN * rated).then(|| {
            format!(
                "the lamp was lit for {hours:.0} of its {rated:.0} hours (lamp.rated_hours): replace it, and remove {FILE} from the data \
                 directory while no daemon runs"
            )
        })
    }
}

fn parse(bytes: &[u8]) -> Result<f64, StoreError> {
    let corrupt = |reason: String| StoreError::Corrupt {
        path: FILE.into(),
        reason: format!("{reason}: move it away, nothing but the hours of the lamp is in it"),
    };
    let file: LampFile =
        serde_json::from_slice(bytes).map_err(|e| corrupt(format!("it is no count of hours ({e})")))?;
    if file.format != FORMAT {
        return Err(corrupt(format!("it has format {}, this version reads {FORMAT}", file.format)));
    }
    if !(file.lit_hours.is_finite() && file.lit_hours >= 0.0) {
        return Err(corrupt(format!("it says {} hours", file.lit_hours)));
    }
    Ok(file.lit_hours)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// A clock that stands until it is set.
    #[derive(Debug, Default)]
    struct Hand(std::sync::Mutex<Duration>);

    impl Hand {
        fn set(&self, seconds: u64) {
            *self.0.lock().unwrap() = Duration::from_secs(seconds);
        }
    }

    impl Clock for Hand {
        fn now(&self) -> jiff::Timestamp {
            jiff::Timestamp::UNIX_EPOCH + self.elapsed()
        }
        fn elapsed(&self) -> Duration {
            *self.0.lock().unwrap()
        }
        fn rest(&self, time: Duration) -> Duration {
            time
        }
        fn new_id(&self) -> uuid::Uuid {
            uuid::Uuid::nil()
        }
    }

    #[test]
    fn a_crash_takes_a_minute_at_most() {
        let (data, clock) = (tempfile::tempdir().unwrap(), Arc::new(Hand::default()));
        let store = Store::open(data.path(), 0).unwrap().with_clock(clock.clone());
        // An hour a second.
        let mut lamp = LampHours::read(&store, 3600.0).unwrap();
        lamp.light();
        clock.set(50);
        lamp.keep(&store, false);
        assert_eq!(store.read_file(FILE).unwrap(), None, "the disk is not written to every second");
        clock.set(61);
        lamp.keep(&store, false);
        clock.set(100);
        // The daemon is killed: nobody puts the lamp out.
        let after = LampHours::read(&store, 3600.0).unwrap();
        assert_eq!((after.is_lit(), after.hours(), lamp.hours()), (false, 61.0, 100.0));
        let mut again = after;
        again.light();
        clock.set(107);
        again.put_out();
        again.keep(&store, true);
        assert_eq!(LampHours::read(&store, 1.0).unwrap().hours(), 68.0);
    }

    #[test]
    fn files_that_are_none_are_refused_in_words() {
        for (text, says) in [
            ("", "no count of hours"),
            ("{\"format\": 2, \"lit_hours\": 1}", "format 2"),
            ("{\"format\": 1, \"lit_hours\": -1}", "-1 hours"),
            ("[]", "no count of hours"),
        ] {
            let error = parse(text.as_bytes()).unwrap_err().to_string();
            assert!(error.contains(says) && error.contains("lamp.json"), "{text}: {error}");
        }
        assert_eq!(parse(b"{\"format\": 1, \"lit_hours\": 2.5}").unwrap(), 2.5);
    }
}
