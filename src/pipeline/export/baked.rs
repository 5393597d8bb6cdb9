//! One surface a texel in place of a mixture: what formats hold that know one lobe, its strength and width from pictures.

use super::Captured;
use super::ggx::{DIELECTRIC_F0, Ggx, closest};

/// A matt surface under one lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texel {
    /// Diffuse albedo per channel.
    pub diffuse: [f64; 3],
    /// Reflectance of the lobe at normal incidence per channel.
    pub f0: [f64; 3],
    /// Reflectance at grazing light.
    pub f90: f64,
    /// Width of the lobe.
    pub alpha: f64,
}

/// The texels of the tile, row by row.
///
/// Albedos and reflectances add up as the mixture's do. The one lobe has the mixture's height in the mirror direction:
/// `f0 / alpha^2` is the sum of those of its parts. What is lost is the sum of a narrow and a wide lobe in one texel.
pub fn baked(captured: &Captured) -> Vec<Texel> {
    let lobes: Vec<Ggx> = captured.materials.iter().map(|material| closest(captured.lobe, material)).collect();
    let texel = |weights: &[f32]| {
        let (mut diffuse, mut f0, mut f90, mut height) = ([0.0; 3], [0.0; 3], 0.0, 0.0);
        for (lobe, &weight) in lobes.iter().zip(weights) {
            let weight = f64::from(weight);
            for c in 0..3 {
                diffuse[c] += weight * lobe.diffuse[c];
                f0[c] += weight * lobe.f0[c];
            }
            let strongest = lobe.f0.into_iter().fold(0.0, f64::max);
            f90 += weight * if lobe.rises { strongest / DIELECTRIC_F0 } else { strongest };
            height += weight * lobe.f0.iter().sum::<f64>() / (lobe.alpha * lobe.alpha);
        }
        let sum: f64 = f0.iter().sum();
        let alpha = if height > 0.0 { (sum / height).sqrt() } else { 1.0 };
        Texel { diffuse, f0: f0.map(|f| f.min(1.0)), f90: f90.min(1.0), alpha }
    };
    captured.tile.texels().weights.iter().map(|weights| texel(weights)).collect()
}

/// The largest of some values, for a factor by which a picture of them is multiplied: its levels then reach as far as they can.
/// 1 where all are zero.
pub fn largest(values: impl Iterator<Item = f64>) -> f64 {
    let most = values.fold(0.0, f64::max);
    if most > 0.0 { most } else { 1.0 }
}
