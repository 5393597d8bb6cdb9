//! Containers (ISO 15740, annex D): u32 length with itself, u16 type, u16 code, u32 transaction, payload; little-endian.

use crate::pack::{Pack, count, u16_at, u32_at};

const HEADER: usize = 12;
/// Longest container taken, bytes.
const LONGEST: usize = 1 << 20;

const COMMAND: u16 = 1;
const DATA: u16 = 2;
const RESPONSE: u16 = 3;

/// What a host sends.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Incoming {
    /// An operation.
    Command { code: u16, transaction: u32, params: Vec<u32> },
    /// The data of the operation before.
    Data(Vec<u8>),
    /// What no host sends.
    Nonsense,
}

impl Incoming {
    /// Takes the first container off what was written, once it is whole.
    pub(super) fn take(written: &mut Vec<u8>) -> Option<Self> {
        let length = u32_at(written, 0)? as usize;
        if !(HEADER..=LONGEST).contains(&length) {
            written.clear();
            return Some(Self::Nonsense);
        }
        if written.len() < length {
            return None;
        }
        let rest = written.split_off(length);
        let whole = std::mem::replace(written, rest);
        Some(match (u16_at(&whole, 4)?, u16_at(&whole, 6)?, u32_at(&whole, 8)?) {
            (COMMAND, code, transaction) => {
                let params = (0..5).map_while(|index| u32_at(&whole, HEADER + 4 * index)).collect();
                Self::Command { code, transaction, params }
            }
            (DATA, ..) => Self::Data(whole.get(HEADER..)?.to_vec()),
            _ => Self::Nonsense,
        })
    }
}

/// The data of an operation, for the host.
pub(super) fn data(code: u16, transaction: u32, bytes: &[u8]) -> Vec<u8> {
    Pack::default().u32(count(HEADER + bytes.len())).u16(DATA).u16(code).u32(transaction).bytes(bytes).0
}

/// How an operation ended.
pub(super) fn response(code: u16, transaction: u32, params: &[u32]) -> Vec<u8> {
    let start = Pack::default().u32(count(HEADER + 4 * params.len())).u16(RESPONSE).u16(code).u32(transaction);
    params.iter().fold(start, |pack, param| pack.u32(*param)).0
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn containers_written_by_hand_are_taken_one_by_one() {
        let command = [16, 0, 0, 0, 1, 0, 0x10, 0x91, 5, 0, 0, 0, 1, 2, 3, 4];
        let data = [14, 0, 0, 0, 2, 0, 0x10, 0x91, 5, 0, 0, 0, 7, 8];
        let mut written = [&command[..], &data[..13]].concat();
        let taken = Incoming::take(&mut written);
        assert_eq!(taken, Some(Incoming::Command { code: 0x9110, transaction: 5, params: vec![0x0403_0201] }));
        assert_eq!(Incoming::take(&mut written), None, "not whole yet");
        written.push(data[13]);
        assert_eq!(Incoming::take(&mut written), Some(Incoming::Data(vec![7, 8])));
        assert!(written.is_empty());
    }

    #[test]
    fn answers_are_as_written_by_hand() {
        assert_eq!(data(0x1001, 3, b"ab"), b"\x0e\0\0\0\x02\0\x01\x10\x03\0\0\0ab");
        assert_eq!(response(0x2001, 3, &[7]), b"\x10\0\0\0\x03\0\x01\x20\x03\0\0\0\x07\0\0\0");
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(mut written in proptest::collection::vec(any::<u8>(), 0..60), length in 0_u32..64) {
            for byte in length.to_le_bytes().into_iter().rev() {
                written.insert(0, byte);
            }
            while Incoming::take(&mut written).is_some() && !written.is_empty() {}
        }
    }
}
