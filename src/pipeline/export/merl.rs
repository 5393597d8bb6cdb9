//! One table a material in the format of the MERL database (Matusik, Pfister, Brand, McMillan 2003): 90 half angles, crowded
//! towards 0, 90 difference angles, 180 turns, three channels.

use super::{Captured, Export, File, Format, Words};
use crate::numerics::brdf::{Lobe, Material};
use crate::numerics::geometry::Angles;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};

/// The format.
pub const FORMAT: Format = Format { name: "merl", about: "MERL BRDF tables", make };

/// Half angles, difference angles, turns of the light about the half vector.
const SIZE: [usize; 3] = [90, 90, 180];
/// What a stored number is multiplied by to give 1/sr, per channel.
const SCALE: [f64; 3] = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0];
/// Places within a cell, each way, over which its value is the mean.
const WITHIN: usize = 2;
/// Least cosine of a place: below it is the horizon, where models have no sensible value.
const LEAST_COSINE: f64 = 0.01;

fn make(captured: &Captured) -> Result<Export, String> {
    let (lobe, materials) = (captured.lobe, captured.materials.clone());
    let table = |(m, material): (usize, &Material)| {
        File::bytes(format!("material_{}.binary", m + 1), bytes(&|cell| mean(lobe, material, cell)))
    };
    let mut files: Vec<File> = materials.iter().enumerate().map(table).collect();
    files.push(File { name: "tile.exr".to_owned(), content: captured.tile_planes() });
    let tile = captured.tile.clone();
    let model = move |[u, v]: [f64; 2], angles: &Angles| {
        let (cell, mut sum) = (cell(angles), [0.0; 3]);
        for (material, weight) in materials.iter().zip(tile.at(u, v)) {
            let value = mean(lobe, material, cell);
            (0..3).for_each(|c| sum[c] += weight * value[c]);
        }
        sum
    };
    let words = Words {
        carries: vec![
            "material_1.binary ...: a material each, of weight 1, diffuse and specular together, as 90 x 90 x 180 values of each channel.".to_owned(),
            "tile.exr: weight.1 ... of the square that repeats without a seam.".to_owned(),
        ],
        loses: vec![
            "A table knows no parameters: a cell holds the mean of eight places in it, 0 below the horizon. Highlights narrower than some cells, and light and view near the horizon, lose most.".to_owned(),
            "The format has no weights: a reader mixes the tables by tile.exr itself.".to_owned(),
        ],
        open: vec!["Any reader of the MERL database: Disney's BRDF Explorer, dj_brdf, pbrt-v3 (fourier after conversion).".to_owned()],
    };
    Ok(Export { files, model: Some(Box::new(model)), words })
}

/// The file: three int32, then float64, little-endian, channel by channel.
fn bytes(value: &(dyn Fn([usize; 3]) -> [f64; 3] + Sync)) -> Vec<u8> {
    let [halves, differences, turns] = SIZE;
    let cells = halves * differences * turns;
    let place = |i: usize| [i / (differences * turns), i / turns % differences, i % turns];
    let values: Vec<[f64; 3]> = (0..cells).into_par_iter().map(|i| value(place(i))).collect();
    let mut bytes = Vec::with_capacity(12 + 24 * cells);
    SIZE.iter().for_each(|size| bytes.extend((*size as u32).to_le_bytes()));
    for c in 0..3 {
        values.iter().for_each(|value| bytes.extend((value[c] / SCALE[c]).to_le_bytes()));
    }
    bytes
}

/// The cell of these angles, as the database's own reader finds it.
fn cell(angles: &Angles) -> [usize; 3] {
    let (half, difference) = (angles.half_angle(), angles.cos_difference().acos());
    let across = half.sin() * difference.sin();
    let cos_turn = (half.cos() * difference.cos() - angles.cos_i) / across;
    let turn = if across > 0.0 { cos_turn.clamp(-1.0, 1.0).acos() } else { 0.0 };
    let index = |part: f64, size: usize| ((part * size as f64) as usize).min(size - 1);
    [index((half / FRAC_PI_2).sqrt(), SIZE[0]), index(difference / FRAC_PI_2, SIZE[1]), index(turn / PI, SIZE[2])]
}

/// The mean BRDF over the part of a cell that lies above the horizon, 1/sr per channel; 0 below.
fn mean(lobe: &dyn Lobe, material: &Material, cell: [usize; 3]) -> [f64; 3] {
    let part = |axis: usize, i: usize| (cell[axis] as f64 + (i as f64 + 0.5) / WITHIN as f64) / SIZE[axis] as f64;
    let (mut sum, mut count) = ([0.0; 3], 0);
    for i in 0..WITHIN.pow(3) {
        let (half, difference, turn) = (part(0, i % 2), part(1, i / 2 % 2), part(2, i / 4));
        let angles = Angles::of_half(half * half * FRAC_PI_2, difference * FRAC_PI_2, turn * PI);
        if angles.cos_i.min(angles.cos_r) > LEAST_COSINE {
            let brdf = material.brdf(lobe, &angles);
            (0..3).for_each(|c| sum[c] += brdf[c]);
            count += 1;
        }
    }
    sum.map(|s| if count > 0 { s / f64::from(count) } else { 0.0 })
}
