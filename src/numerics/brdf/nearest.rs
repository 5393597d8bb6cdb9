//! Lobes of other programs, and the parameters with which they come nearest to a material of ours.

use super::{Lobe, Material};
use crate::numerics::geometry::Angles;
use nalgebra::Complex;
use std::f64::consts::{FRAC_1_PI, FRAC_PI_2};

/// A lobe of another program: its value, 1/sr, under angles with a roughness alpha.
pub type Other = dyn Fn(&Angles, f64) -> f64 + Send + Sync;

/// D of Trowbridge and Reitz with Smith's masking, light and view masked independently, over 4 cos_i cos_r (Walter et al. 2007, Eq.
/// 20, 33, 34): GGX as in [`super::ggx`], without Fresnel.
pub fn ggx_smith(angles: &Angles, alpha: f64) -> f64 {
    let g1 = |cos: f64| 2.0 / (1.0 + (1.0 + alpha * alpha * tan2(cos)).sqrt());
    trowbridge_reitz(angles, alpha) * g1(angles.cos_i) * g1(angles.cos_r) / (4.0 * angles.cos_i * angles.cos_r)
}

/// The same with the masking of light and view correlated by height (Heitz 2014, Eq. 99), as glTF, pbrt-v4 and most game engines
/// have it.
pub fn ggx_correlated(angles: &Angles, alpha: f64) -> f64 {
    let lambda = |cos: f64| 0.5 * ((1.0 + alpha * alpha * tan2(cos)).sqrt() - 1.0);
    let masking = 1.0 / (1.0 + lambda(angles.cos_i) + lambda(angles.cos_r));
    trowbridge_reitz(angles, alpha) * masking / (4.0 * angles.cos_i * angles.cos_r)
}

/// Beckmann's D with Smith's masking in the rational form of Walter et al. 2007 (section 5.2), over 4 cos_i cos_r; no Fresnel.
pub fn beckmann_smith(angles: &Angles, alpha: f64) -> f64 {
    let g1 = |cos: f64| {
        let a = 1.0 / (alpha * tan2(cos).sqrt());
        if a >= 1.6 { 1.0 } else { (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a) }
    };
    let inverse_cos2 = 1.0 + angles.tan2_half;
    let distribution =
        (-angles.tan2_half / (alpha * alpha)).exp() * inverse_cos2 * inverse_cos2 * FRAC_1_PI / (alpha * alpha);
    distribution * g1(angles.cos_i) * g1(angles.cos_r) / (4.0 * angles.cos_i * angles.cos_r)
}

fn trowbridge_reitz(angles: &Angles, alpha: f64) -> f64 {
    let a2 = alpha * alpha;
    let inverse_cos2 = 1.0 + angles.tan2_half;
    let slope = 1.0 + angles.tan2_half / a2;
    FRAC_1_PI * inverse_cos2 * inverse_cos2 / (a2 * slope * slope)
}

fn tan2(cos: f64) -> f64 {
    (1.0 / (cos * cos) - 1.0).max(0.0)
}

/// Fresnel reflectance of a smooth boundary of complex index `eta`, unpolarised, at this cosine of incidence.
pub fn fresnel(cos: f64, eta: Complex<f64>) -> f64 {
    let cos = cos.clamp(0.0, 1.0);
    let within = (Complex::new(1.0, 0.0) - Complex::new(1.0 - cos * cos, 0.0) / (eta * eta)).sqrt();
    let parallel = (eta * cos - within) / (eta * cos + within);
    let across = (Complex::new(cos, 0.0) - eta * within) / (Complex::new(cos, 0.0) + eta * within);
    0.5 * (parallel.norm_sqr() + across.norm_sqr())
}

/// A material as another program says it: `diffuse / pi + specular x lobe(alpha)` per channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Diffuse albedo per channel.
    pub diffuse: [f64; 3],
    /// Factor of the lobe per channel.
    pub specular: [f64; 3],
    /// Its roughness.
    pub alpha: f64,
    /// Root mean square of the relative difference over the grid of angles, weighted as in the fit.
    pub error: f64,
}

/// The grid of angles: half angles, crowded towards the highlight, difference angles, and turns.
const GRID: [usize; 3] = [32, 12, 6];
/// Largest half and difference angle of the grid, radians: 80 degrees.
const WIDEST: f64 = 80.0 / 90.0 * FRAC_PI_2;
/// Least cosine of light and view: nearer to the horizon models part ways, and little is seen.
const LEAST_COSINE: f64 = 0.1;
/// What is darker than this part of the brightest value is not weighed up by being dark.
const FLOOR: f64 = 1e-3;
/// Least and largest roughness.
const ALPHA: [f64; 2] = [2e-3, 1.0];
/// Roughnesses tried before the best is refined, between these factors of beta.
const TRIES: usize = 24;
const AROUND: f64 = 4.0;
/// Steps of the golden section: 1e-6 of the interval.
const STEPS: usize = 30;

/// The parameters with which `other` comes nearest to `material`: least squares of the relative difference over a fixed grid of
/// angles, times cos_i cos_r: what light arrives and how much of the surface is seen. Diffuse and specular part in closed form,
/// neither negative, roughness by search. The same input gives the same bits.
pub fn nearest(material: &Material, lobe: &dyn Lobe, other: &Other) -> Nearest {
    if !lobe.has_lobe() {
        return Nearest { diffuse: material.rho_d, specular: [0.0; 3], alpha: ALPHA[1], error: 0.0 };
    }
    let angles = grid();
    let ours: Vec<[f64; 3]> = angles.iter().map(|angles| material.brdf(lobe, angles)).collect();
    let with = |log_alpha: f64| solve(&angles, &ours, other, log_alpha.exp());
    let bound = |alpha: f64| alpha.clamp(ALPHA[0], ALPHA[1]).ln();
    let (low, high) = (bound(material.beta / AROUND), bound(material.beta * AROUND));
    let step = (high - low) / (TRIES - 1) as f64;
    let tries = (0..TRIES).map(|i| low + step * i as f64);
    let best = tries.min_by(|a, b| with(*a).error.total_cmp(&with(*b).error)).unwrap_or(low);
    let (mut low, mut high) = ((best - step).max(low), (best + step).min(high));
    for _ in 0..STEPS {
        let part = 0.381_966 * (high - low);
        if with(low + part).error <= with(high - part).error { high -= part } else { low += part }
    }
    with(0.5 * (low + high))
}

fn grid() -> Vec<Angles> {
    let [halves, differences, turns] = GRID;
    let part = |i: usize, of: usize| (i as f64 + 0.5) / of as f64;
    let mut angles = Vec::new();
    for h in 0..halves {
        for d in 0..differences {
            for t in 0..turns {
                let half = part(h, halves).powi(2) * WIDEST;
                let one = Angles::of_half(half, part(d, differences) * WIDEST, part(t, turns) * FRAC_PI_2);
                if one.cos_i.min(one.cos_r) > LEAST_COSINE {
                    angles.push(one);
                }
            }
        }
    }
    angles
}

/// The best diffuse and specular part of every channel at one roughness.
fn solve(angles: &[Angles], ours: &[[f64; 3]], other: &Other, alpha: f64) -> Nearest {
    let lobe: Vec<f64> = angles.iter().map(|angles| other(angles, alpha)).collect();
    let mut found = Nearest { diffuse: [0.0; 3], specular: [0.0; 3], alpha, error: 0.0 };
    for c in 0..3 {
        let floor = FLOOR * ours.iter().map(|f| f[c]).fold(0.0, f64::max);
        if floor <= 0.0 {
            continue;
        }
        // Normal equations of d / (pi f) + s lobe / f = 1.
        let (mut dd, mut ds, mut ss, mut d, mut s, mut all, mut weights) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for ((f, lobe), angles) in ours.iter().map(|f| f[c]).zip(&lobe).zip(angles) {
            let weight = angles.cos_i * angles.cos_r;
            let scale = weight / (f + floor);
            weights += weight * weight;
            let (a, b, one) = (FRAC_1_PI * scale, lobe * scale, f * scale);
            (dd, ds, ss) = (dd + a * a, ds + a * b, ss + b * b);
            (d, s, all) = (d + a * one, s + b * one, all + one * one);
        }
        let determinant = dd * ss - ds * ds;
        let both = ((d * ss - s * ds) / determinant, (s * dd - d * ds) / determinant);
        let (diffuse, specular) = match both {
            (diffuse, specular) if diffuse >= 0.0 && specular >= 0.0 => both,
            (diffuse, _) if diffuse < 0.0 => (0.0, s / ss),
            _ => (d / dd, 0.0),
        };
        let (x, y) = (diffuse, specular);
        let squares = all - 2.0 * (x * d + y * s) + x * x * dd + 2.0 * x * y * ds + y * y * ss;
        (found.diffuse[c], found.specular[c]) = both_finite(x, y);
        found.error += squares.max(0.0) / (3.0 * weights);
    }
    found.error = found.error.sqrt();
    found
}

/// Nothing where a part is not a number, as of a lobe that is zero everywhere.
fn both_finite(diffuse: f64, specular: f64) -> (f64, f64) {
    let finite = |value: f64| if value.is_finite() { value } else { 0.0 };
    (finite(diffuse), finite(specular))
}
