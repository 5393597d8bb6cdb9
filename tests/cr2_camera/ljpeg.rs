//! Lossless JPEG (ITU-T T.81, annex H) of 12-bit counts: two components side by side, predictor 1.

/// Code lengths of a table: how many codes of 1, 2, ... 16 bits, and the categories they stand for, in order.
struct Table {
    lengths: [u8; 16],
    categories: [u8; 13],
}

/// Two tables unlike each other, as bodies write them.
const TABLES: [Table; 2] = [
    Table {
        lengths: [0, 1, 5, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0],
        categories: [4, 3, 5, 2, 6, 1, 7, 0, 8, 9, 10, 11, 12],
    },
    Table {
        lengths: [0, 0, 1, 10, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
        categories: [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12],
    },
];
const BITS: u32 = 12;

/// Codes of the categories: bits and their number.
fn codes(table: &Table) -> [(u32, u32); 13] {
    let mut codes = [(0, 0); 13];
    let (mut code, mut next) = (0, 0);
    for (i, &count) in table.lengths.iter().enumerate() {
        for _ in 0..count {
            codes[usize::from(table.categories[next])] = (code, i as u32 + 1);
            code += 1;
            next += 1;
        }
        code <<= 1;
    }
    codes
}

/// `counts` are `width` pairs by `height` rows.
pub fn encode(counts: &[u16], width: usize, height: usize) -> Vec<u8> {
    assert_eq!(counts.len(), 2 * width * height);
    let mut jpeg = vec![0xff, 0xd8];
    for (i, table) in TABLES.iter().enumerate() {
        jpeg.extend([0xff, 0xc4, 0, 2 + 1 + 16 + 13, i as u8]);
        jpeg.extend(table.lengths);
        jpeg.extend(table.categories);
    }
    jpeg.extend([0xff, 0xc3, 0, 8 + 2 * 3, BITS as u8]);
    jpeg.extend((height as u16).to_be_bytes());
    jpeg.extend((width as u16).to_be_bytes());
    jpeg.extend([2, 1, 0x11, 0, 2, 0x11, 0]);
    jpeg.extend([0xff, 0xda, 0, 6 + 2 * 2, 2, 1, 0x00, 2, 0x10, 1, 0, 0]);
    let codes = [codes(&TABLES[0]), codes(&TABLES[1])];
    let mut bits = Bits { jpeg, pending: 0, count: 0 };
    for i in 0..counts.len() {
        let (row, column) = (i / (2 * width), i % (2 * width));
        let predicted = match (row, column) {
            (0, 0 | 1) => 1 << (BITS - 1),
            (_, 0 | 1) => i32::from(counts[i - 2 * width]),
            _ => i32::from(counts[i - 2]),
        };
        let difference = i32::from(counts[i]) - predicted;
        let category = 32 - difference.unsigned_abs().leading_zeros();
        let (code, length) = codes[i % 2][category as usize];
        bits.put(code, length);
        // Negative differences are written one lower, so that their first bit is 0.
        let written = if difference < 0 { difference - 1 } else { difference };
        bits.put(written as u32 & ((1 << category) - 1), category);
    }
    bits.end()
}

struct Bits {
    jpeg: Vec<u8>,
    pending: u64,
    count: u32,
}

impl Bits {
    fn put(&mut self, bits: u32, count: u32) {
        self.pending = self.pending << count | u64::from(bits);
        self.count += count;
        while self.count >= 8 {
            self.count -= 8;
            let byte = (self.pending >> self.count) as u8;
            self.jpeg.push(byte);
            if byte == 0xff {
                self.jpeg.push(0);
            }
        }
    }

    fn end(mut self) -> Vec<u8> {
        let fill = (8 - self.count % 8) % 8;
        self.put((1 << fill) - 1, fill);
        self.jpeg.extend([0xff, 0xd9]);
        self.jpeg
    }
}
