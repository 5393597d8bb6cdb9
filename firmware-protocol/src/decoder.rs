//! Bytes in, frames out: no I/O, no allocation, nothing remembered beyond one frame.

use crate::frame::{Frame, MAX_ENCODED};

/// A push decoder. Noise, broken frames and overlong runs are skipped up to the next zero byte and counted.
#[derive(Clone, Debug)]
pub struct Decoder {
    buffer: [u8; MAX_ENCODED],
    len: usize,
    overflow: bool,
    rejected: u32,
}

impl Default for Decoder {
    fn default() -> Self {
        Self { buffer: [0; MAX_ENCODED], len: 0, overflow: false, rejected: 0 }
    }
}

impl Decoder {
    /// Takes one byte; gives a frame when this byte completes one.
    pub fn push(&mut self, byte: u8) -> Option<Frame> {
        if byte != 0 {
            match self.buffer.get_mut(self.len) {
                Some(slot) => {
                    *slot = byte;
                    self.len += 1;
                }
                None => self.overflow = true,
            }
            return None;
        }
        let (len, overflow) = (self.len, self.overflow);
        (self.len, self.overflow) = (0, false);
        if len == 0 {
            // Two zero bytes in a row: the end of one frame and the start of the next.
            return None;
        }
        let encoded = self.buffer.get(..len).filter(|_| !overflow);
        let frame = encoded.and_then(|encoded| Frame::from_encoded(encoded).ok());
        if frame.is_none() {
            self.rejected = self.rejected.saturating_add(1);
        }
        frame
    }

    /// Runs of bytes that were no frame, since the start.
    pub fn rejected(&self) -> u32 {
        self.rejected
    }
}
