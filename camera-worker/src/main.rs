//! Drives one camera through libgphoto2 for the daemon (package `camera-messages` has the words they speak).
//!
//! One request at a time from stdin, its reply on stdout. A call of the library that never returns takes this process with it: the
//! daemon kills it at the request's deadline and starts another. It ends when stdin does. `HOME` must be a directory for it alone:
//! the library keeps there where pictures go.

mod camera;
mod home;
mod library;
mod session;
mod settings;
mod shoot;

use anyhow::Context;
use camera_messages::frame::{self, FrameError};
use camera_messages::message::{Answer, Call};
use session::Session;
use std::fs::File;
use std::io;
use std::os::fd::AsFd;
use std::path::PathBuf;
use std::process::ExitCode;

fn main() -> ExitCode {
    match serve() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("camera-worker: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn serve() -> anyhow::Result<()> {
    let home = std::env::var_os("HOME").map(PathBuf::from).filter(|home| home.is_absolute());
    let home = home.context("HOME is not set: set it to a directory for this process alone")?;
    home::remember_card(&home)
        .with_context(|| format!("{}: libgphoto2's settings cannot be kept there", home.display()))?;
    // libgphoto2 2.5.30 closes file descriptor 0 with every PTP/IP camera (camlibs/ptp2/ptpip.c, ptp_ptpip_disconnect: jpgfd is 0
    // where it was never opened), and the next socket takes its number. Requests come over a number of our own.
    let mut requests = File::from(io::stdin().as_fd().try_clone_to_owned()?);
    let mut replies = io::stdout().lock();
    let mut session = Session::default();
    loop {
        let call: Call = match frame::read(&mut requests) {
            Ok((call, _)) => call,
            Err(FrameError::End) => return Ok(()),
            Err(error) => return Err(error.into()),
        };
        let (reply, blob) = session.answer(call.request);
        frame::write(&mut replies, &Answer { number: call.number, reply }, &blob)?;
    }
}
