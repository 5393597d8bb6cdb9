//! Engine and worker one after the other, in an order that a seed chooses: without it the threads' chance would decide what a cut meets,
//! and a seed would not bring a failure back.

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use serde_json::Value;
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::Duration;

/// Calls of the arm that may come before a station that was handed over is developed.
const LATEST: usize = 8;

#[derive(Debug)]
pub struct Turns {
    exposures: usize,
    inner: Mutex<Inner>,
    changed: Condvar,
}

#[derive(Debug)]
struct Inner {
    random: StdRng,
    /// Nobody waits: a cut came, or the threads run as they like.
    free: bool,
    /// Calls of the arm since the session runs: those before are of a clean-up.
    calls: usize,
    running: bool,
    /// The call at which each station handed over is developed.
    due: Vec<usize>,
    developed: usize,
    /// A whole bracket is committed; the next record says that it is handed over.
    whole: bool,
    /// A record was written that counts with its sync.
    told: Option<Told>,
    /// All frames are in: what is not developed yet is at the engine's next call, of its clean-up.
    frames_in: bool,
    /// Nothing more is to be developed: the worker goes on as it likes.
    fitting: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Told {
    Fitting,
    Developed,
}

impl Inner {
    fn frames_are_in(&mut self) {
        self.frames_in = true;
        let next = self.calls + 1;
        self.due.iter_mut().for_each(|due| *due = next.min(*due));
    }
}

impl Turns {
    /// Stations have `exposures` frames; `whole` of them are handed over before the arm is called; none: the threads run as they like.
    pub fn new(seed: u64, exposures: usize, whole: Option<usize>) -> Self {
        let mut random = StdRng::seed_from_u64(seed);
        let due = (0..whole.unwrap_or(0)).map(|_| random.random_range(1..LATEST)).collect();
        let inner = Inner {
            random,
            free: whole.is_none(),
            calls: 0,
            running: false,
            due,
            developed: 0,
            whole: false,
            told: None,
            frames_in: false,
            fitting: false,
        };
        Self { exposures, inner: Mutex::new(inner), changed: Condvar::new() }
    }

    /// The engine calls the arm: stations that are due are developed first.
    pub fn engine(&self) {
        let mut inner = self.lock();
        if !inner.running {
            return;
        }
        inner.calls += 1;
        self.changed.notify_all();
        self.wait(inner, |inner| inner.due.get(inner.developed).is_none_or(|&due| due > inner.calls));
    }

    /// The worker begins to develop.
    pub fn worker(&self) {
        let inner = self.lock();
        self.wait(inner, |inner| {
            inner.fitting || inner.due.get(inner.developed).is_some_and(|&due| due <= inner.calls)
        });
    }

    /// Nobody waits any more: the power is off, or the session is over.
    pub fn end(&self) {
        self.lock().free = true;
        self.changed.notify_all();
    }

    /// An operation of the disk has succeeded; `bytes` were written.
    pub fn passed(&self, bytes: &[u8]) {
        let mut inner = self.lock();
        match inner.told.take() {
            Some(Told::Fitting) => inner.frames_are_in(),
            Some(Told::Developed) => inner.developed += 1,
            None => {}
        }
        inner.fitting |= inner.frames_in && (inner.calls == 0 || inner.developed >= inner.due.len());
        let record: Value = serde_json::from_slice(bytes).unwrap_or_default();
        match record["type"].as_str() {
            Some("frame.committed") => inner.whole = record["exposure"] == self.exposures - 1,
            Some("time.budget") if std::mem::take(&mut inner.whole) => {
                let due = inner.calls + inner.random.random_range(1..LATEST);
                inner.due.push(due);
            }
            Some("session.state") if record["state"] == "fitting" => inner.told = Some(Told::Fitting),
            Some("session.state") if record["state"] == "running" => inner.running = true,
            Some("station.developed") => inner.told = Some(Told::Developed),
            _ => {}
        }
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap()
    }

    fn wait(&self, inner: MutexGuard<'_, Inner>, until: impl Fn(&Inner) -> bool) {
        let waits = |inner: &mut Inner| !(inner.free || until(inner));
        let (inner, late) = self.changed.wait_timeout_while(inner, Duration::from_secs(60), waits).unwrap();
        assert!(!late.timed_out(), "engine and worker wait for each other: {inner:?}");
    }
}
