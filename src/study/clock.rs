//! Processor time: what work costs, however busy the machine is. Never wall time.

use nix::time::{ClockId, clock_gettime};
use std::time::Duration;

/// Why no time could be taken.
#[derive(Debug, thiserror::Error)]
pub enum ClockError {
    /// The thread could not be started.
    #[error("no worker thread: {0}")]
    Thread(#[from] rayon::ThreadPoolBuildError),
    /// The clock cannot be read.
    #[error("the processor time cannot be read: {0}")]
    Clock(#[from] nix::Error),
}

/// One thread that does all the work it is given, parallel loops included.
pub struct OneThread {
    pool: rayon::ThreadPool,
}

impl OneThread {
    /// Starts the thread.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn new() -> Result<Self, ClockError> {
        Ok(Self { pool: rayon::ThreadPoolBuilder::new().num_threads(1).build()? })
    }

    /// What `work` gives, and the processor time of the thread, seconds.
    ///
    /// # Errors
    /// The clock cannot be read.
    pub fn time<T: Send>(&self, work: impl FnOnce() -> T + Send) -> Result<(T, f64), ClockError> {
        self.pool.install(|| timed(ClockId::CLOCK_THREAD_CPUTIME_ID, work))
    }
}

/// What `work` gives, and the processor time of all threads of the process meanwhile, seconds.
///
/// # Errors
/// The clock cannot be read.
pub fn time_of_process<T>(work: impl FnOnce() -> T) -> Result<(T, f64), ClockError> {
    timed(ClockId::CLOCK_PROCESS_CPUTIME_ID, work)
}

fn timed<T>(clock: ClockId, work: impl FnOnce() -> T) -> Result<(T, f64), ClockError> {
    let begin = clock_gettime(clock)?;
    let made = work();
    let end = clock_gettime(clock)?;
    Ok((made, Duration::from(end).saturating_sub(Duration::from(begin)).as_secs_f64()))
}
