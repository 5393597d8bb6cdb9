//! The device's end of a pseudo terminal.

use nix::fcntl::OFlag;
use nix::poll::{PollFd, PollFlags, ppoll};
use nix::pty::{PtyMaster, grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};
use nix::sys::time::TimeSpec;
use std::io::{self, Read, Write};
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

/// An open pseudo terminal in raw mode. Dropping it hangs up whoever has the other end open.
pub struct Pty {
    master: PtyMaster,
    path: PathBuf,
}

impl Pty {
    /// Opens a free one. The other end is left closed, so that a host can lock it for itself as it locks a real port.
    ///
    /// # Errors
    /// What the system said when it gave none.
    pub fn open() -> io::Result<Self> {
        let master = posix_openpt(OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let mut settings = tcgetattr(&master)?;
        cfmakeraw(&mut settings);
        tcsetattr(&master, SetArg::TCSANOW, &settings)?;
        let path = PathBuf::from(ptsname_r(&master)?);
        Ok(Self { master, path })
    }

    /// The device file for the host to open.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Waits up to `wait` for bytes and reads them; 0 when none came or no host has the port open.
    pub fn read(&mut self, buffer: &mut [u8], wait: Duration) -> usize {
        let mut fds = [PollFd::new(self.master.as_fd(), PollFlags::POLLIN)];
        let ready = ppoll(&mut fds, Some(TimeSpec::from_duration(wait)), None).is_ok_and(|count| count > 0);
        let events = fds[0].revents().unwrap_or(PollFlags::empty());
        if !ready {
            return 0;
        }
        let count = if events.contains(PollFlags::POLLIN) { self.master.read(buffer).unwrap_or(0) } else { 0 };
        if count == 0 {
            // A closed far end makes poll return at once, for ever.
            thread::sleep(wait);
        }
        count
    }

    /// Sends `bytes`; what a host that does not read leaves no room for is lost, as on a real line.
    pub fn write(&mut self, bytes: &[u8]) {
        let _ = self.master.write_all(bytes);
    }
}
