//! Calls of the driver: four i32 (call, time in ms or endpoint, bytes wanted, bytes that follow) and those bytes. Answers: two i32
//! (result, bytes that follow) and those bytes. All in the machine's own order.

use std::io::{self, Read, Write};
use std::time::Duration;

/// Longest data of a call taken, bytes. libgphoto2 writes 4 KiB at a time.
const LONGEST: usize = 1 << 20;

/// Results, as gphoto2-port-result.h has them.
pub(super) const OK: i32 = 0;
pub(super) const BAD_PARAMETERS: i32 = -2;
pub(super) const IO: i32 = -7;
pub(super) const TIMEOUT: i32 = -10;
pub(super) const IO_READ: i32 = -34;
pub(super) const IO_USB_FIND: i32 = -52;
pub(super) const IO_USB_CLAIM: i32 = -53;

/// What the driver is asked for.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Call {
    /// Every port with a device, one a line.
    List,
    /// Whether there is a device at this port.
    Find(String),
    /// Claiming it.
    Open(String),
    /// Letting go of it.
    Close,
    /// Bytes for the bulk endpoint out.
    Write(Vec<u8>),
    /// Bytes from the bulk endpoint in, at most so many and within this time.
    Read(usize, Duration),
    /// An event from the interrupt endpoint within this time.
    Interrupt(Duration),
    /// The host makes a halted endpoint go on.
    ClearHalt,
}

impl Call {
    /// Reads one; `InvalidData` if it is none.
    pub(super) fn read(from: &mut impl Read) -> io::Result<Self> {
        let mut header = [[0; 4]; 4];
        from.read_exact(header.as_flattened_mut())?;
        let [kind, time, wanted, size] = header.map(i32::from_ne_bytes);
        let nonsense = || io::Error::new(io::ErrorKind::InvalidData, "no call of the driver");
        let mut bytes = vec![0; usize::try_from(size).ok().filter(|size| *size <= LONGEST).ok_or_else(nonsense)?];
        from.read_exact(&mut bytes)?;
        let time = Duration::from_millis(u64::try_from(time).unwrap_or(0));
        let text = |bytes| String::from_utf8(bytes).map_err(|_| nonsense());
        Ok(match kind {
            1 => Self::List,
            2 => Self::Find(text(bytes)?),
            3 => Self::Open(text(bytes)?),
            4 => Self::Close,
            5 => Self::Write(bytes),
            6 => Self::Read(usize::try_from(wanted).unwrap_or(0), time),
            7 => Self::Interrupt(time),
            8 => Self::ClearHalt,
            _ => return Err(nonsense()),
        })
    }
}

/// Writes an answer.
pub(super) fn answer(to: &mut impl Write, result: i32, bytes: &[u8]) -> io::Result<()> {
    let size = i32::try_from(bytes.len()).unwrap_or(i32::MAX);
    let header = [result, size].map(i32::to_ne_bytes);
    to.write_all(&[header.as_flattened(), bytes].concat())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn call(header: [i32; 4], bytes: &[u8]) -> io::Result<Call> {
        let whole = [header.map(i32::to_ne_bytes).as_flattened(), bytes].concat();
        Call::read(&mut &whole[..])
    }

    #[test]
    fn calls_are_told_from_nonsense() {
        assert_eq!(call([3, 20_000, 0, 11], b"usb:001,005").unwrap(), Call::Open("usb:001,005".into()));
        assert_eq!(call([6, 20_000, 512, 0], b"").unwrap(), Call::Read(512, Duration::from_secs(20)));
        for (header, bytes) in
            [([9, 0, 0, 0], &b""[..]), ([5, 0, 0, -1], b""), ([5, 0, 0, i32::MAX], b""), ([2, 0, 0, 1], b"\xff")]
        {
            assert_eq!(call(header, bytes).unwrap_err().kind(), io::ErrorKind::InvalidData, "{header:?}");
        }
        assert_eq!(call([5, 0, 0, 2], b"x").unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
    }
}
