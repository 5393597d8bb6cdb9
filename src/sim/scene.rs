//! The simulated object's surface: two materials and how much of each every point is made of.

use crate::numerics::brdf::Material;
use crate::numerics::geometry::Vec3;

/// A sphere's material weight map with its two materials. The same kind and seed give the same surface.
#[derive(Clone, Debug)]
pub struct Scene {
    kind: rig_config::Scene,
    materials: [Material; 2],
    /// Where the sphere sits in the stuff it is cut from.
    offset: Vec3,
    seed: u64,
}

/// Cream stone with a sharp lobe, blue-grey veins with a wider one.
const MARBLE: [Material; 2] = [
    Material { rho_d: [0.62, 0.53, 0.40], rho_s: [0.050, 0.050, 0.048], beta: 0.06 },
    Material { rho_d: [0.16, 0.23, 0.31], rho_s: [0.030, 0.032, 0.035], beta: 0.11 },
];
/// Yellow early wood, red-brown late wood, both with soft lobes.
const WOOD: [Material; 2] = [
    Material { rho_d: [0.56, 0.42, 0.17], rho_s: [0.070, 0.065, 0.055], beta: 0.16 },
    Material { rho_d: [0.32, 0.11, 0.07], rho_s: [0.050, 0.045, 0.040], beta: 0.23 },
];

impl Scene {
    /// The surface of this kind and seed.
    pub fn new(kind: rig_config::Scene, seed: u64) -> Self {
        let materials = match kind {
            rig_config::Scene::Marble => MARBLE,
            rig_config::Scene::Wood => WOOD,
        };
        let shift = |axis| 16.0 * lattice(seed, [axis, 0, 0]);
        Self { kind, materials, offset: Vec3::new(shift(1), shift(2), shift(3)), seed }
    }

    /// The two materials (alpha of paper Eq. 1), the truth a fit has to find.
    pub fn materials(&self) -> [Material; 2] {
        self.materials
    }

    /// Material weights at the point with this unit normal: non-negative, at most 1 in sum, each near 1 somewhere.
    pub fn weights(&self, normal: &Vec3) -> [f64; 2] {
        let point = normal + self.offset;
        let (share, brightness) = match self.kind {
            rig_config::Scene::Marble => (self.marble(normal, &point), 0.75 + 0.25 * self.cloud(&(point * 1.7))),
            rig_config::Scene::Wood => (self.wood(normal, &point), 0.80 + 0.20 * self.cloud(&(point * 2.3))),
        };
        [brightness * (1.0 - share), brightness * share]
    }

    /// Veins: bands across one direction, warped by noise. The bands overshoot [0, 1] so that about 27 % of the surface is
    /// one pure material.
    fn marble(&self, normal: &Vec3, point: &Vec3) -> f64 {
        let along = normal.dot(&Vec3::new(0.6, 0.64, -0.48));
        let warp = self.fractal(&(point * 2.5));
        (0.5 + 0.55 * (11.0 * along + 7.0 * warp).sin()).clamp(0.0, 1.0)
    }

    /// Year rings about a tilted axis beside the sphere's centre, slightly wavy. About 50 % of the surface is one pure material.
    fn wood(&self, normal: &Vec3, point: &Vec3) -> f64 {
        let axis = Vec3::new(0.20, 0.95, 0.24);
        let from_pith = normal - Vec3::new(0.9, 0.0, 0.5);
        let radius = (from_pith - axis * from_pith.dot(&axis)).norm();
        let warp = self.fractal(&(point * 1.5));
        (0.5 + 0.71 * (19.0 * radius + 2.5 * warp).sin()).clamp(0.0, 1.0)
    }

    /// Slow variation in [0, 1] that reaches both ends.
    fn cloud(&self, point: &Vec3) -> f64 {
        (0.5 + 1.1 * noise(self.seed ^ 0x5bd1, point)).clamp(0.0, 1.0)
    }

    /// Three octaves of noise, about [-1, 1].
    fn fractal(&self, point: &Vec3) -> f64 {
        (0..3).map(|octave| 0.5_f64.powi(octave) * noise(self.seed, &(point * 2_f64.powi(octave)))).sum()
    }
}

/// Smooth value noise in [-1, 1] on the unit lattice.
fn noise(seed: u64, point: &Vec3) -> f64 {
    let cell = point.map(f64::floor);
    let part = (point - cell).map(|t| t * t * (3.0 - 2.0 * t));
    let (x, y, z) = (cell.x as i64, cell.y as i64, cell.z as i64);
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let edge = |y: i64, z: i64| mix(lattice(seed, [x, y, z]), lattice(seed, [x + 1, y, z]), part.x);
    let face = |z: i64| mix(edge(y, z), edge(y + 1, z), part.y);
    mix(face(z), face(z + 1), part.z)
}

/// A fixed random number in [-1, 1) for every lattice point (the finaliser of splitmix64).
fn lattice(seed: u64, at: [i64; 3]) -> f64 {
    let mut bits = seed;
    for coordinate in at {
        bits = bits.wrapping_add(coordinate as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
        bits = (bits ^ bits >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ bits >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^= bits >> 31;
    }
    (bits >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Weights at evenly spread normals that face the camera.
    fn visible(scene: &Scene) -> Vec<[f64; 2]> {
        const N: usize = 20_000;
        let golden = std::f64::consts::PI * (3.0 - 5_f64.sqrt());
        let normal = |i: usize| {
            let z = -(i as f64 + 0.5) / N as f64;
            let (sin, cos) = (golden * i as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Vec3::new(r * cos, r * sin, z)
        };
        (0..N).map(|i| scene.weights(&normal(i))).collect()
    }

    #[test]
    fn weights_are_a_mixture_with_the_stated_share_of_pure_points() {
        for (kind, pure_share) in [(rig_config::Scene::Marble, 0.27), (rig_config::Scene::Wood, 0.50)] {
            for seed in [0, 1, 7, 2008] {
                let weights = visible(&Scene::new(kind, seed));
                assert!(weights.iter().all(|w| w[0] >= 0.0 && w[1] >= 0.0 && w[0] + w[1] <= 1.0));
                let pure = weights.iter().filter(|w| w.contains(&0.0)).count() as f64 / weights.len() as f64;
                assert!((pure - pure_share).abs() < 0.06, "{kind:?} {seed}: {pure} of the points are pure");
                for m in 0..2 {
                    let greatest = weights.iter().map(|w| w[m]).fold(0.0, f64::max);
                    assert!(greatest > 0.97, "{kind:?} {seed}: material {m} reaches {greatest}");
                }
            }
        }
    }

    #[test]
    fn the_seed_decides_the_pattern() {
        let scene = |seed| visible(&Scene::new(rig_config::Scene::Marble, seed));
        assert_eq!(scene(3), scene(3));
        assert_ne!(scene(3), scene(4));
    }
}
