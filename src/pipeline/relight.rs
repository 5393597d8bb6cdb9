//! Relighting: the radiance image a fitted material sends under any light (paper 3.7).

use super::dataset::Geometry;
use crate::numerics::brdf::{Lobe, Material};
use crate::numerics::geometry::{Angles, Light};
use crate::numerics::image::Image;
use rayon::prelude::*;

/// Radiance of every pixel of `geometry` under `light`; `weights` holds one image a material. Zero outside the object, in
/// attached shadow, and where the weights are zero.
pub fn relight(
    lobe: &dyn Lobe,
    materials: &[Material],
    weights: &[Image<f32>],
    geometry: &Geometry,
    light: &Light,
) -> Image<[f32; 3]> {
    let rows: Vec<Vec<[f32; 3]>> = (0..geometry.height)
        .into_par_iter()
        .map(|y| {
            (0..geometry.width)
                .map(|x| pixel(lobe, materials, weights, geometry, light, x, y).unwrap_or([0.0; 3]))
                .collect()
        })
        .collect();
    Image { width: geometry.width, height: geometry.height, pixels: rows.concat() }
}

fn pixel(
    lobe: &dyn Lobe,
    materials: &[Material],
    weights: &[Image<f32>],
    geometry: &Geometry,
    light: &Light,
    x: usize,
    y: usize,
) -> Option<[f32; 3]> {
    let gamma: Vec<f64> = weights.iter().map(|w| f64::from(*w.at(x, y))).collect();
    if gamma.iter().all(|&g| g == 0.0) {
        return None;
    }
    let surface = geometry.object.at(x, y, &geometry.projection.ray(x as f64 + 0.5, y as f64 + 0.5))?;
    let (to_light, irradiance) = light.at(&surface.position);
    let angles = Angles::new(&surface.normal, &to_light, &surface.view);
    if angles.cos_i <= 0.0 || angles.cos_r <= 0.0 {
        return None;
    }
    let mut sum = [0.0_f32; 3];
    for (material, weight) in materials.iter().zip(gamma) {
        let brdf = material.brdf(lobe, &angles);
        for c in 0..3 {
            sum[c] += (weight * irradiance[c] * angles.cos_i * brdf[c]) as f32;
        }
    }
    Some(sum)
}
