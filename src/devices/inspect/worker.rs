//! The camera worker program.

use super::Finding;
use crate::devices::gphoto2::{Worker, WorkerCommand, WorkerError};
use camera_messages::message::PROTOCOL;

/// Starts the worker, agrees on the messages, and ends it; no camera is touched.
pub fn worker(command: &WorkerCommand) -> Finding {
    let place = command.program.display();
    match Worker::start(command, &|| false) {
        Ok(_) => Finding::ok(place, format!("the camera worker starts and speaks version {PROTOCOL} of the messages")),
        Err(WorkerError::Start { reason, .. }) => Finding::error(
            place,
            format!("the camera worker cannot be started ({reason})"),
            "build it with `cargo build --release -p camera-worker` (Debian: libgphoto2-dev, libclang-dev, pkg-config) and put it \
             beside rigd",
        ),
        Err(error) => Finding::error(place, error.to_string(), "build it from the sources this rigd is built from"),
    }
}
