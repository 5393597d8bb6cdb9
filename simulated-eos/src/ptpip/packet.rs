//! Packets: u32 length with itself, u32 type, payload, all little-endian.

use crate::pack::{Pack, count, u16_at, u32_at};
use std::io::{self, Read};

/// Longest packet taken. libgphoto2 sends data in pieces of 64 KiB.
const LONGEST: u32 = 128 * 1024;
const HEADER: u32 = 8;

/// Why the bytes on the wire are no conversation.
#[derive(Debug, thiserror::Error)]
pub(super) enum WireError {
    #[error("the connection ended: {0}")]
    Io(#[from] io::Error),
    #[error("a packet says it is {0} bytes long; 8 to {LONGEST} are taken")]
    Length(u32),
    #[error("packet type {0} is none that a host sends")]
    Type(u32),
    #[error("a packet of type {0} ends before its fields do")]
    Short(u32),
    #[error("{0}")]
    OutOfOrder(&'static str),
}

/// What a host sends.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Incoming {
    InitCommand,
    InitEvent,
    Operation { sends_data: bool, code: u16, transaction: u32, params: Vec<u32> },
    StartData { total: u64 },
    Data(Vec<u8>),
    EndData(Vec<u8>),
    Ping,
}

/// What the body sends.
#[derive(Debug)]
pub(super) enum Outgoing<'a> {
    InitCommandAck { connection: u32 },
    InitEventAck,
    Response { code: u16, transaction: u32, params: &'a [u32] },
    StartData { transaction: u32, total: u64 },
    Data { transaction: u32, bytes: &'a [u8] },
    EndData { transaction: u32, bytes: &'a [u8] },
    Pong,
}

impl Incoming {
    /// Reads one packet.
    pub(super) fn read(from: &mut impl Read) -> Result<Self, WireError> {
        let mut header = [0; HEADER as usize];
        from.read_exact(&mut header)?;
        let [length, kind] = [0, 4].map(|offset| u32_at(&header, offset).unwrap_or(0));
        if !(HEADER..=LONGEST).contains(&length) {
            return Err(WireError::Length(length));
        }
        let mut payload = vec![0; (length - HEADER) as usize];
        from.read_exact(&mut payload)?;
        Self::parse(kind, &payload)
    }

    fn parse(kind: u32, payload: &[u8]) -> Result<Self, WireError> {
        let short = WireError::Short(kind);
        match kind {
            1 => Ok(Self::InitCommand),
            3 => Ok(Self::InitEvent),
            6 => Self::operation(payload).ok_or(short),
            9 => {
                let halves = u32_at(payload, 4).zip(u32_at(payload, 8)).ok_or(short)?;
                Ok(Self::StartData { total: u64::from(halves.0) | u64::from(halves.1) << 32 })
            }
            10 => Ok(Self::Data(payload.get(4..).ok_or(short)?.to_vec())),
            12 => Ok(Self::EndData(payload.get(4..).ok_or(short)?.to_vec())),
            13 => Ok(Self::Ping),
            _ => Err(WireError::Type(kind)),
        }
    }

    fn operation(payload: &[u8]) -> Option<Self> {
        Some(Self::Operation {
            sends_data: u32_at(payload, 0)? == 2,
            code: u16_at(payload, 4)?,
            transaction: u32_at(payload, 6)?,
            params: (0..5).map_while(|index| u32_at(payload, 10 + 4 * index)).collect(),
        })
    }
}

impl Outgoing<'_> {
    /// The whole packet.
    pub(super) fn bytes(&self) -> Vec<u8> {
        let pack = Pack::default();
        let (kind, payload) = match *self {
            Self::InitCommandAck { connection } => {
                let name = "Canon EOS 5D Mark II\0".encode_utf16();
                let start = pack.u32(connection).bytes(b"simulated EOS 5D");
                (2, name.fold(start, |pack, unit| pack.u16(unit)).u32(0x10000))
            }
            Self::InitEventAck => (4, pack),
            Self::Response { code, transaction, params } => {
                (7, params.iter().fold(pack.u16(code).u32(transaction), |pack, param| pack.u32(*param)))
            }
            Self::StartData { transaction, total } => (9, pack.u32(transaction).u64(total)),
            Self::Data { transaction, bytes } => (10, pack.u32(transaction).bytes(bytes)),
            Self::EndData { transaction, bytes } => (12, pack.u32(transaction).bytes(bytes)),
            Self::Pong => (14, pack),
        };
        Pack::default().u32(count(payload.0.len()) + HEADER).u32(kind).bytes(&payload.0).0
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_operation_written_by_hand_is_read() {
        let bytes = [
            22, 0, 0, 0, 6, 0, 0, 0, // length, type
            2, 0, 0, 0, // the host sends data
            0x10, 0x91, 5, 0, 0, 0, // code, transaction
            7, 0, 0, 0, // parameter
        ];
        let mut long = bytes;
        long[0] = 26;
        assert_eq!(
            Incoming::read(&mut &long[..]).unwrap_err().to_string(),
            "the connection ended: failed to fill whole buffer"
        );
        let whole = [&[26, 0, 0, 0][..], &bytes[4..], &[1, 2, 3, 4]].concat();
        let read = Incoming::read(&mut &whole[..]).unwrap();
        let params = vec![7, 0x0403_0201];
        assert_eq!(read, Incoming::Operation { sends_data: true, code: 0x9110, transaction: 5, params });
    }

    #[test]
    fn nonsense_is_refused_in_words() {
        let read = |bytes: &[u8]| Incoming::read(&mut &*bytes).unwrap_err().to_string();
        assert_eq!(read(b"GET / HTTP/1.1\r\n"), "a packet says it is 542393671 bytes long; 8 to 131072 are taken");
        assert_eq!(read(&[7, 0, 0, 0, 1, 0, 0, 0]), "a packet says it is 7 bytes long; 8 to 131072 are taken");
        assert_eq!(read(&[8, 0, 0, 0, 99, 0, 0, 0]), "packet type 99 is none that a host sends");
        assert_eq!(read(&[10, 0, 0, 0, 6, 0, 0, 0, 1, 0]), "a packet of type 6 ends before its fields do");
        assert_eq!(read(&[10, 0, 0, 0, 10, 0, 0, 0, 1, 0]), "a packet of type 10 ends before its fields do");
    }

    proptest! {
        #[test]
        fn no_bytes_make_the_reader_panic(kind in 0_u32..16, payload in proptest::collection::vec(any::<u8>(), 0..60)) {
            let _ = Incoming::parse(kind, &payload);
            let _ = Incoming::read(&mut &payload[..]);
        }
    }

    #[test]
    fn answers_are_as_written_by_hand() {
        let response = Outgoing::Response { code: 0x2001, transaction: 3, params: &[7] };
        assert_eq!(response.bytes(), [18, 0, 0, 0, 7, 0, 0, 0, 1, 0x20, 3, 0, 0, 0, 7, 0, 0, 0]);
        let start = Outgoing::StartData { transaction: 3, total: 2 };
        assert_eq!(start.bytes(), [20, 0, 0, 0, 9, 0, 0, 0, 3, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(Outgoing::EndData { transaction: 3, bytes: b"ab" }.bytes(), b"\x0e\0\0\0\x0c\0\0\0\x03\0\0\0ab");
    }
}
