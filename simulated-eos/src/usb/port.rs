//! One port that a host has open: its calls and their answers.

use super::bus::Shared;
use super::claim::{Claim, HostGone};
use super::wire::{self, Call};
use std::io::{self, Read};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

/// How often a waiting thread looks up.
pub(super) const LOOK: Duration = Duration::from_millis(5);

pub(super) struct Port<'a> {
    pub(super) shared: &'a Shared,
    pub(super) stream: &'a UnixStream,
    pub(super) claim: Option<Claim<'a>>,
}

impl Port<'_> {
    /// Serves the port until its host closes it.
    pub(super) fn serve(mut self) -> io::Result<()> {
        loop {
            let call = Call::read(&mut self.stream)?;
            let (result, bytes) = self.answer(call).map_err(|HostGone| io::ErrorKind::BrokenPipe)?;
            wire::answer(&mut self.stream, result, &bytes)?;
        }
    }

    fn answer(&mut self, call: Call) -> Result<(i32, Vec<u8>), HostGone> {
        let only = |result| Ok((result, Vec::new()));
        match (call, self.claim.as_mut()) {
            (Call::List, _) => Ok(counted(self.shared.ports().join("\n").into_bytes())),
            (Call::Find(port), _) if self.shared.device_at(&port).is_some() => only(wire::OK),
            (Call::Find(_), _) => only(wire::IO_USB_FIND),
            (Call::Open(port), _) => {
                self.claim = None;
                match Claim::new(self.shared, &port) {
                    Ok(claim) => self.claim = Some(claim),
                    Err(result) => return only(result),
                }
                only(wire::OK)
            }
            (Call::Close, _) => {
                self.claim = None;
                only(wire::OK)
            }
            (Call::Write(bytes), Some(claim)) => only(claim.write(&bytes)),
            (Call::Read(wanted, timeout), Some(claim)) => {
                let read = claim.read(wanted, timeout, || pause(self.stream))?;
                Ok(read.map_or_else(|result| (result, Vec::new()), counted))
            }
            // An EOS tells its events when it is asked for them (0x9116), not by interrupts.
            (Call::Interrupt(timeout), Some(_)) => {
                let end = Instant::now() + timeout;
                while Instant::now() < end {
                    pause(self.stream)?;
                }
                only(wire::TIMEOUT)
            }
            (Call::ClearHalt, Some(claim)) => {
                claim.clear_halt();
                only(wire::OK)
            }
            (_, None) => only(wire::BAD_PARAMETERS),
        }
    }
}

/// Bytes with the result that says how many.
fn counted(bytes: Vec<u8>) -> (i32, Vec<u8>) {
    (i32::try_from(bytes.len()).unwrap_or(i32::MAX), bytes)
}

/// Waits a moment. The host waits for its answer, so all that can come of it is its end.
fn pause(mut stream: &UnixStream) -> Result<(), HostGone> {
    let waited = stream.set_read_timeout(Some(LOOK)).and_then(|()| stream.read(&mut [0]));
    match (waited, stream.set_read_timeout(None)) {
        (Err(error), Ok(())) if error.kind() == io::ErrorKind::WouldBlock => Ok(()),
        _ => Err(HostGone),
    }
}
