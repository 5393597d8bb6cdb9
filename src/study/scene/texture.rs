//! Weight textures: smooth variation with veins or rings, and a set share of points of one material only.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, UnitSphere};
use std::f64::consts::TAU;

/// Where which material lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Texture {
    /// Patches crossed by thin veins; 27 % of the points are of one material only.
    Marble,
    /// Rings about a tilted axis; 50 % of the points are of one material only.
    Wood,
}

impl Texture {
    /// Shares of points without the first and without the second material.
    fn pure_shares(self) -> (f64, f64) {
        match self {
            Self::Marble => (0.09, 0.18),
            Self::Wood => (0.25, 0.25),
        }
    }
}

/// A sum of plane waves with random directions: a smooth field of about unit size.
struct Waves(Vec<(Vector3<f64>, f64)>);

impl Waves {
    fn new(rng: &mut StdRng, wavenumber: f64) -> Self {
        let wave = |rng: &mut StdRng| {
            let direction: [f64; 3] = UnitSphere.sample(rng);
            (Vector3::from(direction) * wavenumber * rng.random_range(0.5..1.5), rng.random_range(0.0..TAU))
        };
        Self((0..12).map(|_| wave(rng)).collect())
    }

    fn at(&self, normal: &Vector3<f64>) -> f64 {
        self.0.iter().map(|(wave, phase)| (wave.dot(normal) + phase).sin()).sum::<f64>() / (self.0.len() as f64).sqrt()
    }
}

/// `gamma[point * materials + m]` at the unit normals of a ball's points; their sum is 0.75 to 1.
pub fn weights(texture: Texture, materials: usize, normals: &[Vector3<f64>], seed: u64) -> Vec<f64> {
    let mut rng = StdRng::seed_from_u64(seed ^ 0x7e_87c4);
    let shade = Waves::new(&mut rng, 3.0);
    let mut split: Vec<Vec<f64>> = Vec::new();
    for _ in 1..materials {
        split.push(share(texture, normals, &mut rng));
    }
    let mut gamma = Vec::with_capacity(normals.len() * materials);
    for (point, normal) in normals.iter().enumerate() {
        let mut left = 0.875 + 0.125 * shade.at(normal).clamp(-1.0, 1.0);
        for part in &split {
            gamma.push(left * part[point]);
            left *= 1.0 - part[point];
        }
        gamma.push(left);
    }
    gamma
}

/// Share of the first of two materials at every point: a field, cut at the ranks that leave the set shares at 0 and 1.
fn share(texture: Texture, normals: &[Vector3<f64>], rng: &mut StdRng) -> Vec<f64> {
    let field = field(texture, normals, rng);
    let mut sorted = field.clone();
    sorted.sort_by(f64::total_cmp);
    let (without_first, without_second) = texture.pure_shares();
    let rank = |share: f64| sorted[((share * sorted.len() as f64) as usize).min(sorted.len() - 1)];
    let (low, high) = (rank(without_first), rank(1.0 - without_second));
    field.iter().map(|value| ((value - low) / (high - low)).clamp(0.0, 1.0)).collect()
}

fn field(texture: Texture, normals: &[Vector3<f64>], rng: &mut StdRng) -> Vec<f64> {
    let (coarse, fine) = (Waves::new(rng, 4.0), Waves::new(rng, 25.0));
    let axis = Vector3::from(<UnitSphere as Distribution<[f64; 3]>>::sample(&UnitSphere, rng));
    let at = |normal: &Vector3<f64>| match texture {
        Texture::Marble => {
            let vein = (6.0 * axis.dot(normal) + 1.5 * coarse.at(normal)).sin().abs().powf(0.4);
            vein + 0.5 * coarse.at(normal) + 0.1 * fine.at(normal)
        }
        Texture::Wood => {
            let from_axis = axis.cross(normal).norm();
            (TAU * (4.0 * from_axis + 0.25 * coarse.at(normal))).sin() + 0.2 * fine.at(normal)
        }
    };
    normals.iter().map(at).collect()
}
