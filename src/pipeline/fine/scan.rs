//! Segments of a baseline JPEG down to the dequantised coefficients of its blocks (ITU-T T.81, annexes A, B and F).

use super::Unread;
use super::huffman::{Bits, Table};
use crate::pipeline::decode::MAX_PIXELS;

/// One of luminance, blue and red difference.
#[derive(Clone, Debug)]
pub(super) struct Component {
    id: u8,
    /// Samples across and down in a unit of the scan.
    pub(super) sampling: (usize, usize),
    quantisation: usize,
    /// Blocks across, those that only fill units included.
    across: usize,
    /// 64 coefficients a block, row by row.
    coefficients: Vec<i16>,
}

impl Component {
    /// The coefficients of a block.
    pub(super) fn block(&self, x: usize, y: usize) -> Option<&[i16]> {
        let begin = 64 * (y * self.across + x);
        self.coefficients.get(begin..begin + 64).filter(|_| x < self.across)
    }
}

/// A picture before the inverse transform.
#[derive(Clone, Debug, Default)]
pub(super) struct Coefficients {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Greatest sampling factors, across and down.
    pub(super) most: (usize, usize),
    pub(super) components: Vec<Component>,
}

/// Order in which a block's coefficients are stored: place in the block, row by row.
const ZIGZAG: [usize; 64] = [
    0, 1, 8, 16, 9, 2, 3, 10, 17, 24, 32, 25, 18, 11, 4, 5, 12, 19, 26, 33, 40, 48, 41, 34, 27, 20, 13, 6, 7, 14, 21,
    28, 35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51, 58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54,
    47, 55, 62, 63,
];

#[derive(Default)]
struct Tables {
    quantisation: [Option<[i32; 64]>; 4],
    /// Of the mean and of the other coefficients.
    huffman: [[Option<Table>; 4]; 2],
    restart: usize,
}

/// The coefficients of a baseline file of one or three components in one scan.
pub(super) fn coefficients(bytes: &[u8]) -> Result<Coefficients, Unread> {
    let (mut picture, tables, header, data) = headers(bytes).ok_or(Unread::Unsuited)?;
    let coders = coders(&picture, &tables, header).ok_or(Unread::Unsuited)?;
    scan(&mut picture, &coders, tables.restart, data).ok_or(Unread::Damaged)?;
    Ok(picture)
}

/// All segments up to the scan: an empty picture, the tables, the scan's header, and what follows it. None for files of another
/// kind.
fn headers(bytes: &[u8]) -> Option<(Coefficients, Tables, &[u8], &[u8])> {
    let mut tables = Tables::default();
    let mut picture = Coefficients::default();
    let mut at = 2;
    loop {
        let (marker, rest) = (*bytes.get(at + 1)?, bytes.get(at + 2..)?);
        if bytes[at] != 0xff {
            return None;
        }
        let length = usize::from(u16::from_be_bytes([*rest.first()?, *rest.get(1)?]));
        let body = rest.get(2..length)?;
        match marker {
            0xdb => tables.read_quantisation(body)?,
            0xc4 => tables.read_huffman(body)?,
            0xdd => tables.restart = usize::from(u16::from_be_bytes([*body.first()?, *body.get(1)?])),
            0xc0 | 0xc1 => picture = frame(body)?,
            // Adobe's: 1 says luminance and differences, anything else other colours.
            0xee if body.starts_with(b"Adobe") && *body.get(11)? != 1 => return None,
            0xda => return Some((picture, tables, body, &rest[length..])),
            // Progressive, lossless, arithmetic.
            0xc2..=0xcf => return None,
            _ => {}
        }
        at += 2 + length;
    }
}

impl Tables {
    fn read_quantisation(&mut self, mut body: &[u8]) -> Option<()> {
        while let Some((&kind, rest)) = body.split_first() {
            let wide = kind >> 4 != 0;
            let size = if wide { 128 } else { 64 };
            let values = rest.get(..size)?;
            let step = |k: usize| {
                if wide {
                    i32::from(u16::from_be_bytes([values[2 * k], values[2 * k + 1]]))
                } else {
                    i32::from(values[k])
                }
            };
            *self.quantisation.get_mut(usize::from(kind & 15))? = Some(std::array::from_fn(step));
            body = &rest[size..];
        }
        Some(())
    }

    fn read_huffman(&mut self, mut body: &[u8]) -> Option<()> {
        while let Some((&kind, rest)) = body.split_first() {
            let counts = rest.get(..16)?;
            let size = counts.iter().map(|&count| usize::from(count)).sum::<usize>();
            let table = Table::new(counts, rest.get(16..)?)?;
            *self.huffman.get_mut(usize::from(kind >> 4))?.get_mut(usize::from(kind & 15))? = Some(table);
            body = rest.get(16 + size..)?;
        }
        Some(())
    }
}

/// The frame's header; takes the memory of its coefficients.
fn frame(body: &[u8]) -> Option<Coefficients> {
    let number = |at: usize| Some(usize::from(u16::from_be_bytes([*body.get(at)?, *body.get(at + 1)?])));
    let (precision, height, width, count) = (*body.first()?, number(1)?, number(3)?, *body.get(5)?);
    if precision != 8 || ![1, 3].contains(&count) || width == 0 || height == 0 || width * height > MAX_PIXELS {
        return None;
    }
    let count = usize::from(count);
    let mut components = Vec::with_capacity(count);
    for entry in body.get(6..6 + 3 * count)?.chunks_exact(3) {
        // The blocks of a single component follow one another row by row, whatever its sampling (A.2.2).
        let stated = (usize::from(entry[1] >> 4), usize::from(entry[1] & 15));
        let sampling = if count == 1 { (1, 1) } else { stated };
        if !(1..=4).contains(&sampling.0) || !(1..=4).contains(&sampling.1) {
            return None;
        }
        let quantisation = usize::from(entry[2]);
        components.push(Component { id: entry[0], sampling, quantisation, across: 0, coefficients: Vec::new() });
    }
    let greatest = |of: fn(&Component) -> usize| components.iter().map(of).max().unwrap_or(1);
    let most = (greatest(|c| c.sampling.0), greatest(|c| c.sampling.1));
    let units = (width.div_ceil(8 * most.0), height.div_ceil(8 * most.1));
    for component in &mut components {
        component.across = units.0 * component.sampling.0;
        component.coefficients = vec![0; 64 * component.across * units.1 * component.sampling.1];
    }
    Some(Coefficients { width, height, most, components })
}

/// What a component's blocks are decoded with: codes of the mean and of the other coefficients, and the quantisation.
type Coder<'a> = (&'a Table, &'a Table, &'a [i32; 64]);

/// The coders of all components; none if the scan does not hold all of them or lacks a table.
fn coders<'a>(picture: &Coefficients, tables: &'a Tables, header: &[u8]) -> Option<Vec<Coder<'a>>> {
    let count = picture.components.len();
    if count == 0 || usize::from(*header.first()?) != count {
        return None;
    }
    let mut coders = Vec::with_capacity(count);
    for (component, entry) in picture.components.iter().zip(header.get(1..1 + 2 * count)?.chunks_exact(2)) {
        let table = |kind: usize, index: u8| tables.huffman[kind].get(usize::from(index))?.as_ref();
        let steps = tables.quantisation.get(component.quantisation)?.as_ref()?;
        if entry[0] != component.id {
            return None;
        }
        coders.push((table(0, entry[1] >> 4)?, table(1, entry[1] & 15)?, steps));
    }
    Some(coders)
}

/// Decodes the one scan that holds all components.
fn scan(picture: &mut Coefficients, coders: &[Coder<'_>], restart: usize, data: &[u8]) -> Option<()> {
    let units = picture.width.div_ceil(8 * picture.most.0) * picture.height.div_ceil(8 * picture.most.1);
    let across = picture.width.div_ceil(8 * picture.most.0);
    let (mut bits, mut means) = (Bits::new(data), [0_i32; 3]);
    for unit in 0..units {
        if restart > 0 && unit > 0 && unit.is_multiple_of(restart) {
            bits.restart()?;
            means = [0; 3];
        }
        for ((component, coder), mean) in picture.components.iter_mut().zip(coders).zip(&mut means) {
            let (wide, high) = component.sampling;
            for part in 0..wide * high {
                let (x, y) = (unit % across * wide + part % wide, unit / across * high + part / wide);
                let begin = 64 * (y * component.across + x);
                block(&mut bits, *coder, mean, component.coefficients.get_mut(begin..begin + 64)?)?;
            }
        }
    }
    Some(())
}

/// One block (F.2.2): the mean as a difference to the last one, then runs of zeros and numbers.
fn block(bits: &mut Bits<'_>, (first, others, steps): Coder<'_>, mean: &mut i32, out: &mut [i16]) -> Option<()> {
    let store = |k: usize, value: i32| i16::try_from(value.checked_mul(*steps.get(k)?)?).ok();
    let size = bits.symbol(first)?;
    *mean = mean.checked_add(bits.number(u32::from(size))?)?;
    out[0] = store(0, *mean)?;
    let mut k = 1;
    while k < 64 {
        let symbol = bits.symbol(others)?;
        let (run, size) = (usize::from(symbol >> 4), u32::from(symbol & 15));
        match (run, size) {
            (15, 0) => k += 16,
            (_, 0) => break,
            _ => {
                k += run;
                *out.get_mut(*ZIGZAG.get(k)?)? = store(k, bits.number(size)?)?;
                k += 1;
            }
        }
    }
    Some(())
}
