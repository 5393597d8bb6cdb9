//! Huffman codes of a JPEG scan (ITU-T T.81, annexes C and F).

/// A code table: for every length the first code, how many there are, and where their values begin.
#[derive(Clone, Debug)]
pub(super) struct Table {
    lengths: [(u32, u32, usize); 17],
    values: Vec<u8>,
}

impl Table {
    /// From the number of codes of each length 1 to 16, and their values. None if the codes overflow.
    pub(super) fn new(counts: &[u8], values: &[u8]) -> Option<Self> {
        let mut lengths = [(0, 0, 0); 17];
        let (mut code, mut begin) = (0_u32, 0_usize);
        for (length, &count) in (1..=16).zip(counts.get(..16)?) {
            lengths[length] = (code, u32::from(count), begin);
            code += u32::from(count);
            begin += usize::from(count);
            if code > 1 << length {
                return None;
            }
            code <<= 1;
        }
        Some(Self { lengths, values: values.get(..begin)?.to_vec() })
    }
}

/// The bits of an entropy-coded segment.
pub(super) struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
    held: u32,
    count: u32,
}

impl<'a> Bits<'a> {
    /// From the first byte after a scan's header.
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, held: 0, count: 0 }
    }

    fn bit(&mut self) -> Option<u32> {
        if self.count == 0 {
            let byte = *self.bytes.get(self.at)?;
            self.at += 1;
            if byte == 0xff {
                // A stuffed zero follows data; anything else is a marker, at which data end.
                if *self.bytes.get(self.at)? != 0 {
                    return None;
                }
                self.at += 1;
            }
            (self.held, self.count) = (u32::from(byte), 8);
        }
        self.count -= 1;
        Some(self.held >> self.count & 1)
    }

    /// The next value of a table.
    pub(super) fn symbol(&mut self, table: &Table) -> Option<u8> {
        let mut code = 0;
        for (first, count, begin) in &table.lengths[1..] {
            code = code << 1 | self.bit()?;
            if code >= *first && code - first < *count {
                return table.values.get(begin + (code - first) as usize).copied();
            }
        }
        None
    }

    /// A signed number of `size` bits (F.2.2.1).
    pub(super) fn number(&mut self, size: u32) -> Option<i32> {
        if size > 15 {
            return None;
        }
        let mut value = 0_i32;
        for _ in 0..size {
            value = value << 1 | self.bit()?.cast_signed();
        }
        let half = 1 << size >> 1;
        Some(if value < half { value - (1 << size) + 1 } else { value })
    }

    /// Goes on behind the next restart marker.
    pub(super) fn restart(&mut self) -> Option<()> {
        self.count = 0;
        let rest = self.bytes.get(self.at..)?;
        let marker = rest.windows(2).position(|pair| pair[0] == 0xff && (0xd0..=0xd7).contains(&pair[1]))?;
        self.at += marker + 2;
        Some(())
    }
}
