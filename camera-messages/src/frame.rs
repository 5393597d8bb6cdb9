//! Frames: u32 length of the header, u32 length of the blob, both little-endian; the header in JSON; the blob.

use serde::Serialize;
use serde::de::DeserializeOwned;
use std::io::{self, Read, Write};

/// Longest header, bytes.
pub const LONGEST_HEADER: u32 = 1 << 20;
/// Longest blob, bytes: a raw file and a JPEG of the largest body many times over.
pub const LONGEST_BLOB: u32 = 1 << 28;

/// Why a frame could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// The stream ended between two frames: the other side is gone.
    #[error("the other side has ended")]
    End,
    /// Reading or writing failed, or the stream ended amid a frame.
    #[error("the stream to the other side failed: {0}")]
    Io(#[from] io::Error),
    /// A length is out of bounds.
    #[error("a frame has {header} bytes of header and {blob} of blob; {LONGEST_HEADER} and {LONGEST_BLOB} are taken")]
    Length {
        /// Bytes of header.
        header: u64,
        /// Bytes of blob.
        blob: u64,
    },
    /// The header is none of ours.
    #[error("a frame's header is not understood: {0}")]
    Header(#[from] serde_json::Error),
}

/// Writes one frame and flushes.
pub fn write(to: &mut impl Write, header: &impl Serialize, blob: &[u8]) -> Result<(), FrameError> {
    let header = serde_json::to_vec(header)?;
    let lengths = bounded(header.len() as u64, blob.len() as u64)?;
    for length in lengths {
        to.write_all(&length.to_le_bytes())?;
    }
    to.write_all(&header)?;
    to.write_all(blob)?;
    Ok(to.flush()?)
}

/// Reads one frame.
pub fn read<T: DeserializeOwned>(from: &mut impl Read) -> Result<(T, Vec<u8>), FrameError> {
    let mut lengths = [[0; 4]; 2];
    let [header, blob] = &mut lengths;
    if !read_or_end(from, header)? {
        return Err(FrameError::End);
    }
    from.read_exact(blob)?;
    let [header, blob] = lengths.map(u32::from_le_bytes);
    bounded(header.into(), blob.into())?;
    let header = serde_json::from_slice(&exactly(from, header)?)?;
    Ok((header, exactly(from, blob)?))
}

fn bounded(header: u64, blob: u64) -> Result<[u32; 2], FrameError> {
    match (u32::try_from(header), u32::try_from(blob)) {
        (Ok(header @ ..=LONGEST_HEADER), Ok(blob @ ..=LONGEST_BLOB)) => Ok([header, blob]),
        _ => Err(FrameError::Length { header, blob }),
    }
}

/// Grows with what really comes, so that a length alone takes no memory.
fn exactly(from: &mut impl Read, length: u32) -> Result<Vec<u8>, FrameError> {
    let mut bytes = Vec::new();
    from.take(length.into()).read_to_end(&mut bytes)?;
    if bytes.len() as u64 != u64::from(length) {
        return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
    }
    Ok(bytes)
}

/// Fills `buffer`; false if the stream ended before its first byte.
fn read_or_end(from: &mut impl Read, buffer: &mut [u8; 4]) -> Result<bool, FrameError> {
    let [first, rest @ ..] = buffer;
    loop {
        match from.read(std::slice::from_mut(first)) {
            Ok(0) => return Ok(false),
            Ok(_) => break,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error.into()),
        }
    }
    from.read_exact(rest)?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_frame_is_as_written_by_hand() {
        let mut bytes = Vec::new();
        write(&mut bytes, &"hi", b"xyz").unwrap();
        assert_eq!(bytes, b"\x04\0\0\0\x03\0\0\0\"hi\"xyz");
        assert_eq!(read::<String>(&mut &bytes[..]).unwrap(), ("hi".into(), b"xyz".to_vec()));
    }

    #[test]
    fn ends_and_lengths_are_told_apart() {
        let failed = |bytes: &[u8]| read::<String>(&mut &*bytes).unwrap_err();
        assert!(matches!(failed(b""), FrameError::End));
        assert!(matches!(failed(b"\x04\0"), FrameError::Io(_)));
        assert!(matches!(failed(b"\x04\0\0\0\x03\0\0\0\"hi\"xy"), FrameError::Io(_)));
        assert!(matches!(failed(b"\xff\xff\xff\xff\0\0\0\0"), FrameError::Length { header: 0xffff_ffff, blob: 0 }));
        assert!(matches!(failed(b"\x01\0\0\0\0\0\0\x20{"), FrameError::Length { blob: 0x2000_0000, .. }));
        assert!(matches!(failed(b"\x01\0\0\0\0\0\0\0{"), FrameError::Header(_)));
    }

    proptest! {
        #[test]
        fn no_bytes_make_the_reader_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = read::<crate::message::Call>(&mut &bytes[..]);
        }
    }
}
