//! One frame: `00 COBS( version:u8 kind:u8 seq:u16 session:u32 payload:0..48 crc:u16 ) 00`, little-endian.

use crc::{CRC_16_IBM_3740, Crc};

/// Version of the frame layout described here.
pub const VERSION: u8 = 1;
/// Longest payload, bytes.
pub const MAX_PAYLOAD: usize = 48;
/// Longest frame on the wire with both zero bytes, bytes.
pub const MAX_WIRE: usize = MAX_ENCODED + 2;

const HEADER: usize = 8;
const CRC_BYTES: usize = 2;
const MIN_RAW: usize = HEADER + CRC_BYTES;
const MAX_RAW: usize = MIN_RAW + MAX_PAYLOAD;
pub(crate) const MAX_ENCODED: usize = cobs::max_encoding_length(MAX_RAW);

/// Its table is made by the compiler, for a microcontroller would take longer to make it than to use it.
static CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_IBM_3740);

/// CRC-16/IBM-3740 (CCITT-FALSE: polynomial 0x1021, start 0xffff, not reflected, no final xor).
pub fn crc16(bytes: &[u8]) -> u16 {
    CRC.checksum(bytes)
}

/// Up to [`MAX_PAYLOAD`] bytes.
#[derive(Clone, Copy, Debug)]
pub struct Payload {
    bytes: [u8; MAX_PAYLOAD],
    len: usize,
}

impl Payload {
    /// A copy of `bytes`, or none if they are more than [`MAX_PAYLOAD`].
    pub fn new(bytes: &[u8]) -> Option<Self> {
        let mut payload = Self { bytes: [0; MAX_PAYLOAD], len: bytes.len() };
        payload.bytes.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(payload)
    }

    /// The bytes.
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }
}

impl<const N: usize> From<[u8; N]> for Payload {
    /// The payload of a message, whose length is known when it is compiled.
    fn from(message: [u8; N]) -> Self {
        const { assert!(N <= MAX_PAYLOAD) }
        let mut bytes = [0; MAX_PAYLOAD];
        for (to, from) in bytes.iter_mut().zip(message) {
            *to = from;
        }
        Self { bytes, len: N }
    }
}

impl PartialEq for Payload {
    fn eq(&self, other: &Self) -> bool {
        self.as_slice() == other.as_slice()
    }
}
impl Eq for Payload {}

/// A frame whose CRC held, or one about to be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Layout version.
    pub version: u8,
    /// What the payload means: see `Request` and `Answer`.
    pub kind: u8,
    /// Sequence number; an answer carries that of its request.
    pub seq: u16,
    /// The host's random session; an answer carries that of its request.
    pub session: u32,
    /// The message's fields.
    pub payload: Payload,
}

/// Why bytes between two zero bytes are no frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// The COBS code is broken or its content longer than any frame.
    Cobs,
    /// Fewer bytes than header and CRC take.
    TooShort,
    /// The CRC does not match.
    Crc,
}

/// A frame as sent, with both zero bytes.
#[derive(Clone, Copy, Debug)]
pub struct Wire {
    bytes: [u8; MAX_WIRE],
    len: usize,
}

impl Wire {
    /// The bytes to send.
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }
}

impl Frame {
    /// A frame of this crate's version.
    pub fn new(kind: u8, seq: u16, session: u32, payload: Payload) -> Self {
        Self { version: VERSION, kind, seq, session, payload }
    }

    /// The frame as sent.
    pub fn to_wire(&self) -> Wire {
        let mut raw = [0; MAX_RAW];
        let body = HEADER + self.payload.len;
        raw[0] = self.version;
        raw[1] = self.kind;
        raw[2..4].copy_from_slice(&self.seq.to_le_bytes());
        raw[4..8].copy_from_slice(&self.session.to_le_bytes());
        raw[HEADER..body].copy_from_slice(self.payload.as_slice());
        let crc = crc16(&raw[..body]);
        raw[body..body + CRC_BYTES].copy_from_slice(&crc.to_le_bytes());

        let mut bytes = [0; MAX_WIRE];
        let encoded = cobs::encode(&raw[..body + CRC_BYTES], &mut bytes[1..=MAX_ENCODED]);
        // The byte before and the byte after are the zeros that end any noise and this frame.
        Wire { bytes, len: encoded + 2 }
    }

    /// Reads what stood between two zero bytes.
    pub fn from_encoded(encoded: &[u8]) -> Result<Self, FrameError> {
        let mut raw = [0; MAX_RAW];
        let len = cobs::decode(encoded, &mut raw).map_err(|_| FrameError::Cobs)?.frame_size();
        let raw = raw.get(..len).ok_or(FrameError::Cobs)?;
        let (body, crc) = raw.split_last_chunk().ok_or(FrameError::TooShort)?;
        let [version, kind, s0, s1, n0, n1, n2, n3] = *body.first_chunk().ok_or(FrameError::TooShort)?;
        if crc16(body) != u16::from_le_bytes(*crc) {
            return Err(FrameError::Crc);
        }
        let payload = body.get(HEADER..).and_then(Payload::new).ok_or(FrameError::Cobs)?;
        Ok(Self {
            version,
            kind,
            seq: u16::from_le_bytes([s0, s1]),
            session: u32::from_le_bytes([n0, n1, n2, n3]),
            payload,
        })
    }
}
