//! Pictures of the tile as files hold them: whole levels, which readers decode and interpolate.

use crate::numerics::render::tile::neighbours;
use image::{ExtendedColorType, ImageFormat};
use std::io::Cursor;

/// What a level of a channel says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coding {
    /// The value.
    Linear,
    /// The value through the curve of sRGB (IEC 61966-2-1): fine steps in the dark.
    Srgb,
}

/// How many levels there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// 256.
    Eight,
    /// 65 536.
    Sixteen,
}

/// A square picture of one, three or four channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture<const N: usize> {
    side: usize,
    codings: [Coding; N],
    depth: Depth,
    levels: Vec<[u16; N]>,
}

impl<const N: usize> Texture<N> {
    /// Rounds values from 0 to 1, given row by row, to levels.
    pub fn of(side: usize, codings: [Coding; N], depth: Depth, values: impl Iterator<Item = [f64; N]>) -> Self {
        let encode = |value: [f64; N]| {
            std::array::from_fn(|c| {
                let value = value[c].clamp(0.0, 1.0);
                let coded = if codings[c] == Coding::Srgb { to_srgb(value) } else { value };
                (coded * full(depth)).round() as u16
            })
        };
        Self { side, codings, depth, levels: values.map(encode).collect() }
    }

    /// The picture as PNG.
    ///
    /// # Errors
    /// It cannot be encoded.
    pub fn png(&self) -> Result<Vec<u8>, String> {
        let (bytes, colour) = match self.depth {
            Depth::Eight => {
                let colour = match N {
                    1 => ExtendedColorType::L8,
                    3 => ExtendedColorType::Rgb8,
                    _ => ExtendedColorType::Rgba8,
                };
                (self.levels.iter().flatten().map(|&level| level as u8).collect::<Vec<u8>>(), colour)
            }
            Depth::Sixteen => {
                let colour = match N {
                    1 => ExtendedColorType::L16,
                    3 => ExtendedColorType::Rgb16,
                    _ => ExtendedColorType::Rgba16,
                };
                (self.levels.iter().flatten().flat_map(|level| level.to_ne_bytes()).collect(), colour)
            }
        };
        let (mut encoded, side) = (Cursor::new(Vec::new()), self.side as u32);
        image::write_buffer_with_format(&mut encoded, &bytes, side, side, colour, ImageFormat::Png)
            .map_err(|e| format!("a texture cannot be written as PNG: {e}"))?;
        Ok(encoded.into_inner())
    }

    /// Values at a place of the texture, in tiles: decoded, then linear between the texels' middles, as a reader samples it.
    pub fn at(&self, [u, v]: [f64; 2]) -> [f64; N] {
        let mut sum = [0.0; N];
        for (texel, part) in neighbours(self.side, u, v) {
            for c in 0..N {
                let coded = f64::from(self.levels[texel][c]) / full(self.depth);
                sum[c] += part * if self.codings[c] == Coding::Srgb { from_srgb(coded) } else { coded };
            }
        }
        sum
    }
}

fn full(depth: Depth) -> f64 {
    match depth {
        Depth::Eight => f64::from(u8::MAX),
        Depth::Sixteen => f64::from(u16::MAX),
    }
}

fn to_srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

fn from_srgb(coded: f64) -> f64 {
    if coded <= 0.04045 { coded / 12.92 } else { ((coded + 0.055) / 1.055).powf(2.4) }
}
