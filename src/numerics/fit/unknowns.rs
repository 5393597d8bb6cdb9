//! Which BRDF parameters are unknown in a fit: the lobe's colour, the pinned gauge, and the bounds.

use super::kernel::{PER_MATERIAL, Sums, triangle};
use super::levmar::{Bounds, Normal};
use super::{BETA_RANGE, alpha::specular_cap};
use crate::numerics::brdf::Material;
use nalgebra::{DMatrix, DVector};

/// How much of a lobe is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Colour {
    /// No lobe: rho_s is 0.
    None,
    /// One specular albedo for all channels.
    Achromatic,
    /// One for each channel.
    Coloured,
}

impl Colour {
    /// Every choice with its name, the smallest first.
    pub const ALL: [(&'static str, Self); 3] =
        [("none", Self::None), ("achromatic", Self::Achromatic), ("coloured", Self::Coloured)];

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::ALL[self as usize].0
    }

    /// Unknowns of a material seen in 1 or 3 independent channels, one of them the gauge.
    pub fn unknowns(self, channels: usize) -> usize {
        match self {
            Self::None => channels,
            Self::Achromatic => channels + 2,
            Self::Coloured => 2 * channels + 1,
        }
    }
}

/// Places of the parameters ([`PER_MATERIAL`] a material: rho_d, rho_s, ln beta) among the unknowns.
#[derive(Clone, Debug)]
pub struct Unknowns {
    place: Vec<Option<usize>>,
    start: Vec<Material>,
    count: usize,
}

impl Unknowns {
    /// The unknowns of a fit that starts at `start`. The gauge is pinned: the largest diffuse albedo of each material
    /// stays what it is (with a weight for every point it is no loss), or the largest specular one where that is greater
    /// by far.
    pub fn new(start: &[Material], colour: Colour) -> Self {
        let mut place = Vec::new();
        let mut count = 0;
        let mut take = || {
            count += 1;
            Some(count - 1)
        };
        for material in start {
            let pinned = pinned(material);
            let mut shared = None;
            for k in 0..PER_MATERIAL {
                place.push(match (k, colour) {
                    _ if k == pinned => None,
                    (3.., Colour::None) => None,
                    (3..6, Colour::Achromatic) => {
                        shared = shared.or_else(&mut take);
                        shared
                    }
                    _ => take(),
                });
            }
        }
        let mut start = start.to_vec();
        for material in &mut start {
            let mean = material.rho_s.iter().sum::<f64>() / 3.0;
            match colour {
                Colour::None => material.rho_s = [0.0; 3],
                Colour::Achromatic => material.rho_s = [mean; 3],
                Colour::Coloured => {}
            }
        }
        Self { place, start, count }
    }

    /// The starting values.
    pub fn pack(&self) -> DVector<f64> {
        let mut x = DVector::zeros(self.count);
        for (i, place) in self.place.iter().enumerate() {
            if let Some(place) = place {
                x[*place] = parameter(&self.start[i / PER_MATERIAL], i % PER_MATERIAL);
            }
        }
        x
    }

    /// Materials of some values.
    pub fn unpack(&self, x: &DVector<f64>) -> Vec<Material> {
        let mut materials = self.start.clone();
        for (i, place) in self.place.iter().enumerate() {
            let Some(place) = place else { continue };
            let material = &mut materials[i / PER_MATERIAL];
            match i % PER_MATERIAL {
                k @ 0..3 => material.rho_d[k] = x[*place],
                k @ 3..6 => material.rho_s[k - 3] = x[*place],
                _ => material.beta = x[*place].exp(),
            }
        }
        materials
    }

    /// Albedos are not negative, rho_s is capped, beta keeps to [`BETA_RANGE`] and moves by a factor of 2 a step at most.
    pub fn bounds(&self) -> Bounds {
        let mut bounds = Bounds {
            lower: DVector::zeros(self.count),
            upper: DVector::from_element(self.count, f64::INFINITY),
            step: DVector::from_element(self.count, f64::INFINITY),
        };
        for (i, place) in self.place.iter().enumerate() {
            let Some(place) = *place else { continue };
            match i % PER_MATERIAL {
                0..3 => {}
                3..6 => bounds.upper[place] = specular_cap(&self.start[i / PER_MATERIAL]),
                _ => {
                    bounds.lower[place] = BETA_RANGE[0].ln();
                    bounds.upper[place] = BETA_RANGE[1].ln();
                    bounds.step[place] = 0.7;
                }
            }
        }
        bounds
    }

    /// The normal equations of the unknowns alone.
    pub fn reduce(&self, sums: &Sums) -> Normal {
        let mut normal = Normal {
            cost: sums.cost,
            gradient: DVector::zeros(self.count),
            hessian: DMatrix::zeros(self.count, self.count),
        };
        for (i, place) in self.place.iter().enumerate() {
            let Some(p) = *place else { continue };
            normal.gradient[p] += sums.gradient[i];
            for (j, other) in self.place.iter().enumerate() {
                let Some(q) = *other else { continue };
                normal.hessian[(p, q)] += sums.hessian[triangle(i.max(j), i.min(j))];
            }
        }
        normal
    }

    /// Place among the unknowns of parameter `k` of material `m`.
    pub fn place(&self, m: usize, k: usize) -> Option<usize> {
        self.place[m * PER_MATERIAL + k]
    }

    /// Number of unknowns.
    pub fn count(&self) -> usize {
        self.count
    }

    /// True for the unknowns that start at a bound: they do not move with the data.
    pub fn at_bound(&self) -> Vec<bool> {
        let (x, bounds) = (self.pack(), self.bounds());
        // No bound is an infinite one, and everything would be near that.
        let near = |a: f64, b: f64| b.is_finite() && (a - b).abs() <= 1e-6 * b.abs();
        (0..self.count).map(|i| near(x[i], bounds.lower[i]) || near(x[i], bounds.upper[i])).collect()
    }
}

/// The parameter that is held to fix the gauge of a material.
fn pinned(material: &Material) -> usize {
    let largest = |rgb: &[f64; 3]| (0..3).fold(0, |best, c| if rgb[c] > rgb[best] { c } else { best });
    let (d, s) = (largest(&material.rho_d), largest(&material.rho_s));
    if material.rho_d[d] > 1e-3 * material.rho_s[s] { d } else { 3 + s }
}

fn parameter(material: &Material, k: usize) -> f64 {
    match k {
        0..3 => material.rho_d[k],
        3..6 => material.rho_s[k - 3],
        _ => material.beta.ln(),
    }
}
