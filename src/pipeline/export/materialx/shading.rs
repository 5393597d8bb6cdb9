//! How standard_surface reflects with a matt base under a dielectric lobe: MaterialX 1.39, `oren_nayar_diffuse_bsdf` without
//! roughness under `dielectric_bsdf` by `layer`.

use crate::numerics::brdf::nearest::{fresnel, ggx_correlated};
use crate::numerics::geometry::Angles;
use nalgebra::Complex;
use std::f64::consts::{FRAC_1_PI, TAU};

/// Cosines at which the albedo of a lobe is known, from 1/COSINES to 1.
const COSINES: usize = 64;
/// Facets a side of the grid over which it is integrated.
const FACETS: usize = 32;

/// A matt surface under a lobe.
pub struct Layered {
    /// Diffuse albedo per channel.
    pub diffuse: [f64; 3],
    /// `specular` where all weights add up to 1.
    pub weight: f64,
    /// `specular_color`.
    pub tint: [f64; 3],
    /// Square of `specular_roughness`.
    pub alpha: f64,
    /// `specular_IOR`.
    pub ior: f64,
    /// Albedo of the lobe at [`COSINES`] cosines of the view, of a reflectance of 1 throughout, and of its own.
    albedos: Vec<[f64; 2]>,
}

impl Layered {
    /// The surface of these parameters.
    pub fn new(diffuse: [f64; 3], weight: f64, tint: [f64; 3], alpha: f64, ior: f64) -> Self {
        let albedos = (1..=COSINES).map(|i| albedos(i as f64 / COSINES as f64, alpha, ior)).collect();
        Self { diffuse, weight, tint, alpha, ior, albedos }
    }

    /// Part of the light that the lobe reflects at normal incidence, for a weight of 1.
    pub fn albedo(&self) -> f64 {
        let [whole, own] = self.albedos_at(1.0);
        own * compensation(whole, fresnel(1.0, self.index()))
    }

    /// BRDF per channel, 1/sr, where `specular` and `base_color` are `scale` times theirs, less the highlight's part of the latter.
    pub fn brdf(&self, scale: f64, angles: &Angles) -> [f64; 3] {
        let weight = scale * self.weight;
        let reflectance = fresnel(angles.cos_difference(), self.index());
        let [whole, own] = self.albedos_at(angles.cos_r);
        let gain = compensation(whole, reflectance);
        let lobe = ggx_correlated(angles, self.alpha) * reflectance * gain * weight;
        let base = scale / (1.0 - weight * self.albedo());
        let left = 1.0 - own * gain * weight;
        std::array::from_fn(|c| left * base * self.diffuse[c] * FRAC_1_PI + self.tint[c] * lobe)
    }

    fn index(&self) -> Complex<f64> {
        Complex::new(self.ior, 0.0)
    }

    fn albedos_at(&self, cosine: f64) -> [f64; 2] {
        let place = (cosine * COSINES as f64 - 1.0).clamp(0.0, COSINES as f64 - 1.0);
        let below = (place as usize).min(COSINES - 2);
        let part = place - below as f64;
        std::array::from_fn(|i| (1.0 - part) * self.albedos[below][i] + part * self.albedos[below + 1][i])
    }
}

/// What light that bounces between facets adds to the lobe (Turquin 2019, Eq. 14 and 16).
fn compensation(albedo: f64, reflectance: f64) -> f64 {
    1.0 + reflectance * (1.0 - albedo) / albedo
}

/// Smith's masking with heights correlated (Heitz 2014, Eq. 99).
fn masking(alpha: f64, light: f64, view: f64) -> f64 {
    let lambda = |cosine: f64| 0.5 * ((1.0 + alpha * alpha * (1.0 / (cosine * cosine) - 1.0)).sqrt() - 1.0);
    1.0 / (1.0 + lambda(light) + lambda(view))
}

/// Directional albedo of a lobe: of a reflectance of 1 throughout, and of Schlick's with the dielectric's at normal incidence, by
/// a sum over facets that are spread as the distribution is.
fn albedos(view: f64, alpha: f64, ior: f64) -> [f64; 2] {
    let f0 = ((ior - 1.0) / (ior + 1.0)).powi(2);
    let side = (1.0 - view * view).max(0.0).sqrt();
    let mut sums = [0.0; 2];
    for i in 0..FACETS {
        let part = (i as f64 + 0.5) / FACETS as f64;
        let tan2 = alpha * alpha * part / (1.0 - part);
        let normal = 1.0 / (1.0 + tan2).sqrt();
        for j in 0..FACETS {
            let across = (1.0 - normal * normal).sqrt() * (TAU * (j as f64 + 0.5) / FACETS as f64).cos();
            let along = view * normal + side * across;
            let light = 2.0 * along * normal - view;
            if along <= 0.0 || light <= 0.0 {
                continue;
            }
            let seen = masking(alpha, light, view) * along / (view * normal);
            let rise = (1.0 - along).powi(5);
            sums[0] += seen;
            sums[1] += seen * (f0 + (1.0 - f0) * rise);
        }
    }
    sums.map(|sum| sum / (FACETS * FACETS) as f64)
}
