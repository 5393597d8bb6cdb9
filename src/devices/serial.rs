//! One serial port: opened exclusively, read with a short time-out, closed by dropping it.
//!
//! Blocking: whoever holds it gives it a thread of its own. Nothing here flushes, because a drain with a dead peer can
//! block for ever.

use super::arm::ArmError;
use serialport::{ErrorKind, TTYPort};
use std::io::{self, Read, Write};
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

/// Longest time one read or write blocks.
const TIMEOUT: Duration = Duration::from_millis(50);
/// Bytes that one read takes at most.
pub const CHUNK: usize = 2048;
/// Least time between two reads: a line that babbles must not wake its thread for every byte.
const GATHER: Duration = Duration::from_millis(5);

/// An open port.
pub struct SerialTransport {
    port: TTYPort,
    path: String,
    /// When the next read may be.
    next_read: Instant,
}

impl SerialTransport {
    /// Opens `path` at `baud`, 8 data bits, no parity, one stop bit; nobody else can then open it.
    ///
    /// # Errors
    /// [`ArmError::Port`] with what the operating system said and what to do about it.
    pub fn open(path: &Path, baud: u32) -> Result<Self, ArmError> {
        let path = path.display().to_string();
        match serialport::new(&path, baud).timeout(TIMEOUT).open_native() {
            Ok(port) => Ok(Self { port, path, next_read: Instant::now() }),
            Err(error) => Err(ArmError::Port { reason: open_advice(&error), port: path }),
        }
    }

    /// Sends all of `bytes`, or as many as a peer that does not read lets through: silence will tell.
    ///
    /// # Errors
    /// [`ArmError::Port`] once the port is gone.
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), ArmError> {
        match self.port.write_all(bytes) {
            Err(error) if !passes(&error) => Err(self.gone(&error.to_string())),
            _ => Ok(()),
        }
    }

    /// Reads what is there into `buffer`; 0 bytes when nothing came for 50 ms.
    ///
    /// # Errors
    /// [`ArmError::Port`] once the port is gone.
    pub fn read(&mut self, buffer: &mut [u8]) -> Result<usize, ArmError> {
        thread::sleep(self.next_read.saturating_duration_since(Instant::now()));
        match self.port.read(buffer) {
            Ok(0) => Err(self.gone("end of file")),
            Ok(count) => {
                // More is waiting behind a full buffer.
                let pause = if count < buffer.len() { GATHER } else { Duration::ZERO };
                self.next_read = Instant::now() + pause;
                Ok(count)
            }
            Err(error) if passes(&error) => Ok(0),
            Err(error) => Err(self.gone(&error.to_string())),
        }
    }

    fn gone(&self, reason: &str) -> ArmError {
        let reason = format!("the device went away ({reason}): check its cable and power");
        ArmError::Port { port: self.path.clone(), reason }
    }
}

/// True for what a later call may get over; every other error means that the port is gone.
fn passes(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::Interrupted | io::ErrorKind::WouldBlock)
}

fn open_advice(error: &serialport::Error) -> String {
    let advice = match error.kind() {
        ErrorKind::Io(io::ErrorKind::NotFound) => "no such device: check the cable and arm.port in the rig file",
        ErrorKind::Io(io::ErrorKind::PermissionDenied) => {
            "permission denied (EACCES): add the user to the group dialout and log in again"
        }
        ErrorKind::NoDevice | ErrorKind::Io(io::ErrorKind::ResourceBusy) => {
            "another program may hold it, or it is no serial port: find the holder with `fuser -v`"
        }
        _ => "check arm.port and arm.baud in the rig file",
    };
    format!("cannot be opened ({error}): {advice}")
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;

    fn reason(path: &Path) -> String {
        match SerialTransport::open(path, 115_200) {
            Err(ArmError::Port { port, reason }) => {
                assert_eq!(port, path.display().to_string());
                reason
            }
            Err(other) => panic!("{other}"),
            Ok(_) => panic!("{} opened", path.display()),
        }
    }

    #[test]
    fn a_missing_or_foreign_port_is_refused_with_advice() {
        assert!(reason(Path::new("/dev/no-such-port")).contains("arm.port"));
        let file = tempfile::NamedTempFile::new().unwrap();
        assert!(reason(file.path()).contains("cannot be opened"));
    }

    #[test]
    fn a_port_has_one_owner_and_says_when_its_peer_is_gone() {
        let (mut master, slave) = TTYPort::pair().unwrap();
        let path = serialport::SerialPort::name(&slave).unwrap();
        drop(slave);
        let mut port = SerialTransport::open(Path::new(&path), 115_200).unwrap();
        assert!(reason(Path::new(&path)).contains("another program"));

        master.write_all(b"\0ok\r\n").unwrap();
        let mut buffer = [0; 16];
        assert_eq!(port.read(&mut buffer).unwrap(), 5);
        assert_eq!(&buffer[..5], b"\0ok\r\n");
        assert_eq!(port.read(&mut buffer).unwrap(), 0);
        drop(master);
        assert!(matches!(port.read(&mut buffer), Err(ArmError::Port { .. })));
        assert!(matches!(port.write(b"?"), Err(ArmError::Port { .. })));
    }
}
