//! `rigd render` and what it is made of, against closed forms, brute force, another language's numbers and hostile files.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

mod closed_forms;
mod command;
mod hostile;
mod meshes;
mod models;
mod texture;
mod tree;

use rigd::numerics::brdf::{Lobe, Material};
use rigd::numerics::geometry::{Light, Vec3};
use rigd::numerics::render::Scene;
use rigd::numerics::render::mesh::{Mesh, Parts};
use rigd::numerics::render::seam::overlap;
use rigd::numerics::render::tile::{Texels, Tile};
use rigd::numerics::render::tree::Tree;

/// The same weights everywhere.
pub fn plain(weights: [f32; 4]) -> Tile {
    let side = 8 + overlap(8);
    Tile::of(&Texels { size: (side, side), weights: vec![weights; side * side] }, 8)
}

/// A triangle mesh of these corners, without normals and texture coordinates.
pub fn triangles(corners: &[[[f64; 3]; 3]]) -> Mesh {
    Mesh::new(Parts {
        positions: corners.iter().flatten().map(|&corner| Vec3::from(corner)).collect(),
        triangles: (0..corners.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        ..Parts::default()
    })
    .unwrap()
}

/// A square of side `2 half` about the z axis, at height z.
pub fn square(half: f64, z: f64) -> [[[f64; 3]; 3]; 2] {
    let [a, b, c, d] = [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]];
    [[a, b, c], [a, c, d]]
}

/// Everything a scene needs, owned.
pub struct Stage {
    pub mesh: Mesh,
    pub tree: Tree,
    pub tile: Tile,
    pub materials: Vec<Material>,
    pub lobe: &'static dyn Lobe,
    pub light: Light,
}

impl Stage {
    pub fn new(mesh: Mesh, lobe: &'static dyn Lobe, materials: &[Material], weights: [f32; 4], light: Light) -> Self {
        let tree = Tree::new(&mesh);
        Self { mesh, tree, tile: plain(weights), materials: materials.to_vec(), lobe, light }
    }

    pub fn scene(&self) -> Scene<'_> {
        Scene {
            mesh: &self.mesh,
            tree: &self.tree,
            tile: &self.tile,
            repeats: 2.0,
            lobe: self.lobe,
            materials: &self.materials,
            light: &self.light,
        }
    }
}

pub fn matt(rho_d: [f64; 3]) -> Material {
    Material { rho_d, rho_s: [0.0; 3], beta: 1.0 }
}
