//! CR2 files of a simulated EOS 5D, for the tests of raw frames. Written for the tests alone, after the published
//! descriptions of the format (L. Clévy, "Inside the Canon RAW format version 2"; ITU-T T.81, annex H): it shares
//! nothing with the decoder.
#![allow(dead_code, missing_docs, clippy::unwrap_used)]

pub mod ljpeg;

use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rand_distr::{Distribution, StandardNormal};

pub const LEFT: usize = 90;
pub const TOP: usize = 34;
pub const WHITE: u16 = 3692;
pub const FULL_WELL_E: f64 = 80_000.0;
pub const READ_NOISE_E: f64 = 30.0;
/// Counts of an electron at ISO 100.
pub const COUNTS_PER_E: f64 = (3692.0 - 128.0) / FULL_WELL_E;

/// A file to be written.
#[derive(Clone)]
pub struct Cr2 {
    /// Columns and rows of the sensor, border included; even.
    pub width: usize,
    pub height: usize,
    pub counts: Vec<u16>,
    pub model: &'static str,
    /// Exposure time as the EXIF says, seconds.
    pub exposure: (u32, u32),
    pub iso: u16,
    pub orientation: u16,
    /// Widths of the vertical slices, the last one's own; one for no slices.
    pub slices: Vec<usize>,
}

impl Cr2 {
    /// A file of these counts, shot at ISO 100 by a 5D.
    pub fn new(width: usize, height: usize, counts: Vec<u16>, exposure: (u32, u32)) -> Self {
        let part = (width / 3).next_multiple_of(2);
        let slices = vec![part, part, width - 2 * part];
        Self { width, height, counts, model: "Canon EOS 5D", exposure, iso: 100, orientation: 6, slices }
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mut file = b"II\x2a\0\x10\0\0\0CR\x02\0\0\0\0\0".to_vec();
        let preview = b"\xff\xd8\xff\xe0 stands for a preview \xff\xd9";
        let jpeg = ljpeg::encode(&self.in_slices(), self.width / 2, self.height);
        // The data come first, the directories last but for the counts: each knows where its data are.
        let exif = Directory(vec![
            Entry::rational(0x829a, self.exposure),
            Entry::rational(0x829d, (56, 10)),
            Entry::short(0x8827, &[self.iso]),
            Entry::ascii(0x9003, "2026:11:23 12:00:00"),
            Entry { tag: 0x927c, kind: 7, count: 40, bytes: (0..40).collect() },
        ]);
        let shown = Directory(vec![
            Entry::short(0x0100, &[2496]),
            Entry::short(0x0101, &[1664]),
            Entry::ascii(0x010f, "Canon"),
            Entry::ascii(0x0110, self.model),
            Entry::long(0x0111, 0),
            Entry::short(0x0112, &[self.orientation]),
            Entry::long(0x0117, preview.len() as u32),
            Entry::long(0x8769, 0),
        ]);
        let thumbnail = Directory(vec![Entry::long(0x0201, 0), Entry::long(0x0202, preview.len() as u32)]);
        let small = Directory(vec![Entry::short(0x0103, &[6]), Entry::long(0x0111, 0), Entry::long(0x0117, 0)]);
        let mut raw = vec![
            Entry::short(0x0103, &[6]),
            Entry::long(0x0111, 0),
            Entry::long(0x0117, jpeg.len() as u32),
            Entry::long(0xc5d8, 1),
            Entry::long(0xc5e0, 1),
        ];
        if self.slices.len() > 1 {
            let (count, first, last) = (self.slices.len() - 1, self.slices[0], self.slices[self.slices.len() - 1]);
            raw.push(Entry::short(0xc640, &[count as u16, first as u16, last as u16]));
        }
        let mut chain = [shown, thumbnail, small, Directory(raw)];
        let mut at = file.len() as u32;
        let starts = chain.each_ref().map(|directory| (at, at += directory.size()).0);
        let at_exif = at;
        let at_preview = at_exif + exif.size();
        let at_counts = at_preview + preview.len() as u32;
        file[12..16].copy_from_slice(&starts[3].to_le_bytes());
        chain[0].set(0x0111, at_preview);
        chain[0].set(0x8769, at_exif);
        chain[1].set(0x0201, at_preview);
        chain[2].set(0x0111, at_preview);
        chain[3].set(0x0111, at_counts);
        for (i, directory) in chain.iter().enumerate() {
            directory.write(&mut file, starts.get(i + 1).copied().unwrap_or(0));
        }
        exif.write(&mut file, 0);
        file.extend(preview);
        file.extend(jpeg);
        file
    }

    /// The counts in the order the slices are stored.
    fn in_slices(&self) -> Vec<u16> {
        assert_eq!(self.slices.iter().sum::<usize>(), self.width);
        let mut ordered = Vec::with_capacity(self.counts.len());
        let mut left = 0;
        for &slice in &self.slices {
            for row in self.counts.chunks_exact(self.width) {
                ordered.extend(&row[left..left + slice]);
            }
            left += slice;
        }
        ordered
    }
}

struct Entry {
    tag: u16,
    kind: u16,
    count: u32,
    bytes: Vec<u8>,
}

impl Entry {
    fn short(tag: u16, values: &[u16]) -> Self {
        Self { tag, kind: 3, count: values.len() as u32, bytes: values.iter().flat_map(|v| v.to_le_bytes()).collect() }
    }
    fn long(tag: u16, value: u32) -> Self {
        Self { tag, kind: 4, count: 1, bytes: value.to_le_bytes().to_vec() }
    }
    fn rational(tag: u16, (above, below): (u32, u32)) -> Self {
        Self { tag, kind: 5, count: 1, bytes: [above.to_le_bytes(), below.to_le_bytes()].concat() }
    }
    fn ascii(tag: u16, text: &str) -> Self {
        Self { tag, kind: 2, count: text.len() as u32 + 1, bytes: [text.as_bytes(), b"\0"].concat() }
    }
}

struct Directory(Vec<Entry>);

impl Directory {
    fn set(&mut self, tag: u16, value: u32) {
        self.0.iter_mut().find(|entry| entry.tag == tag).unwrap().bytes = value.to_le_bytes().to_vec();
    }

    /// Bytes with the values that do not fit into an entry.
    fn size(&self) -> u32 {
        let outside: usize = self.0.iter().map(|e| if e.bytes.len() > 4 { e.bytes.len() } else { 0 }).sum();
        (2 + 12 * self.0.len() + 4 + outside) as u32
    }

    fn write(&self, file: &mut Vec<u8>, next: u32) {
        let mut outside = (file.len() + 2 + 12 * self.0.len() + 4) as u32;
        let mut values = Vec::new();
        file.extend((self.0.len() as u16).to_le_bytes());
        for entry in &self.0 {
            file.extend(entry.tag.to_le_bytes());
            file.extend(entry.kind.to_le_bytes());
            file.extend(entry.count.to_le_bytes());
            if entry.bytes.len() <= 4 {
                let mut value = entry.bytes.clone();
                value.resize(4, 0);
                file.extend(value);
            } else {
                file.extend(outside.to_le_bytes());
                outside += entry.bytes.len() as u32;
                values.extend_from_slice(&entry.bytes);
            }
        }
        file.extend(next.to_le_bytes());
        file.extend(values);
    }
}

/// A simulated body in front of a scene.
pub struct Body<'a> {
    /// Lit columns and rows; even.
    pub size: (usize, usize),
    /// Electrons a second of a lit photosite (column, row).
    pub rate: &'a dyn Fn(usize, usize) -> f64,
    /// Electrons a second that the photosite gathers without light.
    pub dark: &'a dyn Fn(usize, usize) -> f64,
}

impl Body<'_> {
    /// Shoots with a shutter that is open for `time_s`: photon noise, read noise, 12 bits. The black level of a place
    /// of the pattern is not that of the others, and `black` above 128; masked photosites see read noise alone.
    pub fn shoot(&self, time_s: f64, black: f64, exposure: (u32, u32), seed: u64) -> Cr2 {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let (width, height) = (self.size.0 + LEFT, self.size.1 + TOP);
        let mut counts = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let lit = x >= LEFT && y >= TOP;
                let mean =
                    if lit { ((self.rate)(x - LEFT, y - TOP) + (self.dark)(x - LEFT, y - TOP)) * time_s } else { 0.0 };
                let normal: f64 = StandardNormal.sample(&mut random);
                let electrons = mean + normal * (mean + READ_NOISE_E.powi(2)).sqrt();
                let level = 128.0 + black + 0.25 * (2 * (y % 2) + x % 2) as f64;
                counts.push((level + COUNTS_PER_E * electrons).round().clamp(0.0, f64::from(WHITE)) as u16);
            }
        }
        Cr2::new(width, height, counts, exposure)
    }
}

/// The paper's bracket as powers of the cube root of two, s, and what the dial of a 5D says.
pub const THIRDS: [i32; 10] = [-20, -16, -12, -8, -4, 0, 3, 6, 9, 12];
pub const DIAL: [(u32, u32); 10] =
    [(1, 100), (1, 40), (1, 15), (1, 6), (4, 10), (1, 1), (2, 1), (4, 1), (8, 1), (15, 1)];

/// The times the shutter is really open, seconds.
pub fn times_s() -> [f64; 10] {
    THIRDS.map(|k| (f64::from(k) / 3.0).exp2())
}
