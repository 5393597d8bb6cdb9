//! PTP's data types as bytes: little-endian numbers, counted arrays, counted UTF-16 strings (PTP, ISO 15740, section 5.3).

/// A data set under construction.
#[derive(Default)]
pub(crate) struct Pack(pub(crate) Vec<u8>);

impl Pack {
    pub(crate) fn u8(mut self, value: u8) -> Self {
        self.0.push(value);
        self
    }

    pub(crate) fn u16(mut self, value: u16) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(crate) fn u32(mut self, value: u32) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(crate) fn u64(mut self, value: u64) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(crate) fn bytes(mut self, value: &[u8]) -> Self {
        self.0.extend(value);
        self
    }

    pub(crate) fn u16s(self, values: &[u16]) -> Self {
        values.iter().fold(self.u32(count(values.len())), |pack, value| pack.u16(*value))
    }

    pub(crate) fn u32s(self, values: &[u32]) -> Self {
        values.iter().fold(self.u32(count(values.len())), |pack, value| pack.u32(*value))
    }

    /// A PTP string: number of UTF-16 units with the closing zero, then the units; an empty one is a single zero byte.
    pub(crate) fn string(self, text: &str) -> Self {
        if text.is_empty() {
            return self.u8(0);
        }
        let units: Vec<u16> = text.encode_utf16().take(254).chain([0]).collect();
        let length = u8::try_from(units.len()).unwrap_or(u8::MAX);
        units.iter().fold(self.u8(length), |pack, unit| pack.u16(*unit))
    }
}

/// A length as the wire counts it. Nothing here comes near 4 GiB; a longer one would be cut by the reader.
pub(crate) fn count(length: usize) -> u32 {
    u32::try_from(length).unwrap_or(u32::MAX)
}

/// The little-endian number at `offset`, if it is there.
pub(crate) fn u32_at(bytes: &[u8], offset: usize) -> Option<u32> {
    let end = offset.checked_add(4)?;
    Some(u32::from_le_bytes(bytes.get(offset..end)?.try_into().ok()?))
}

/// Likewise for 16 bits.
pub(crate) fn u16_at(bytes: &[u8], offset: usize) -> Option<u16> {
    let end = offset.checked_add(2)?;
    Some(u16::from_le_bytes(bytes.get(offset..end)?.try_into().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strings_are_counted_with_their_closing_zero() {
        assert_eq!(Pack::default().string("EOS").0, b"\x04E\0O\0S\0\0\0");
        assert_eq!(Pack::default().string("").0, [0]);
        assert_eq!(Pack::default().string(&"x".repeat(999)).0.len(), 1 + 2 * 255);
    }

    #[test]
    fn numbers_beyond_the_end_are_absent() {
        assert_eq!(u32_at(&[1, 0, 0, 0, 9], 0), Some(1));
        assert_eq!(u32_at(&[1, 0, 0, 0], 1), None);
        assert_eq!(u32_at(&[], usize::MAX), None);
        assert_eq!(u16_at(&[1, 2], 0), Some(0x0201));
    }
}
