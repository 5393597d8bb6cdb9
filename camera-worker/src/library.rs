//! Calls of libgphoto2, and what its errors say.

use camera_messages::message::{Failure, HandleState, LibraryError, Step};
use camera_messages::words;
use gphoto2::task::Task;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Longest error text kept, characters.
const LONGEST_TEXT: usize = 500;

/// Keeps the last error text of the library: its errors are numbers, and what they mean is only logged.
struct LastError(Mutex<Option<String>>);

static LAST_ERROR: LastError = LastError(Mutex::new(None));

impl LastError {
    fn text(&self) -> MutexGuard<'_, Option<String>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl log::Log for LastError {
    fn enabled(&self, metadata: &log::Metadata<'_>) -> bool {
        metadata.level() == log::Level::Error
    }

    fn log(&self, record: &log::Record<'_>) {
        if self.enabled(record.metadata()) {
            let text = record.args().to_string();
            *self.text() = Some(text.trim().chars().take(LONGEST_TEXT).collect());
        }
    }

    fn flush(&self) {}
}

/// Must come before the first context: the crate asks only then whether anybody listens to errors.
pub(crate) fn listen_to_errors() {
    // It fails where a logger is installed already, which is then this one.
    if log::set_logger(&LAST_ERROR).is_ok() {
        log::set_max_level(log::LevelFilter::Error);
    }
}

/// Runs a call to its end.
pub(crate) fn call<T: Send + 'static>(step: Step, task: Task<gphoto2::Result<T>>) -> Result<T, Failure> {
    *LAST_ERROR.text() = None;
    match task.try_wait() {
        Ok(result) => result.map_err(|error| failure(step, &error)),
        Err(_) => Err(Failure {
            step,
            what: "the library's thread has ended: start another worker".into(),
            library: None,
            handle: HandleState::Dead,
        }),
    }
}

/// An error of the library in our words and its own.
pub(crate) fn failure(step: Step, error: &gphoto2::Error) -> Failure {
    let (name, number) = words::error_code(&format!("{:?}", error.kind()));
    let context = LAST_ERROR.text().take();
    let told = context.as_deref().map(|context| format!(" ({context})")).unwrap_or_default();
    Failure {
        step,
        what: format!("{error}{told}: {}", words::advice(number)),
        library: Some(LibraryError { number, name: name.into(), context }),
        handle: words::handle_state(number),
    }
}

/// A refusal of our own, which leaves the camera usable.
pub(crate) fn refused(step: Step, what: impl Into<String>) -> Failure {
    Failure { step, what: what.into(), library: None, handle: HandleState::Ready }
}
