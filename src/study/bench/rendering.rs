//! What a rendered picture costs: a knot of 70 000 triangles on a megapixel.

use super::merging::Cost;
use super::{Bar, BenchError, Times, repeated};
use crate::numerics::brdf::Material;
use crate::numerics::fit::MAX_MATERIALS;
use crate::numerics::geometry::{Light, Vec3};
use crate::numerics::render::camera::{Camera, View};
use crate::numerics::render::mesh::{Mesh, Parts};
use crate::numerics::render::seam::overlap;
use crate::numerics::render::tile::{Texels, Tile};
use crate::numerics::render::tree::Tree;
use crate::numerics::render::{Scene, render, shapes};
use crate::study::clock::{OneThread, time_of_process};
use crate::study::method::LOBE;
use crate::study::scene;
use std::time::Instant;

/// Columns and rows of the picture that the bar is about.
pub const SIZE: (usize, usize) = (1024, 1024);
/// Side of the texture, texels.
const SIDE: usize = 64;

/// Measures everything on a picture of `size`.
///
/// # Errors
/// A clock is missing, or nobody reads the table any more.
pub fn run(
    size: (usize, usize),
    repeats: usize,
    told: &mut dyn FnMut(&Cost) -> std::io::Result<()>,
) -> Result<(), BenchError> {
    let refused = |error: &dyn ToString| BenchError::Scene(error.to_string());
    let parts = shapes::knot(700, 50);
    let mesh = Mesh::new(parts.clone()).map_err(|e| refused(&e))?;
    let camera = Camera::new(&View::of(&mesh, 30.0, size), size).map_err(|e| refused(&e))?;
    let mut told = |work: &str, wall: bool, times: Times, bar: Option<Bar>| {
        told(&Cost { work: work.to_owned(), times, wall, bar }).map_err(BenchError::from)
    };
    let thread = OneThread::new()?;
    let (tree, times) = repeated(repeats, || Ok(thread.time(|| Tree::new(&mesh))?))?;
    told(&format!("tree over {} triangles", mesh.triangles()), false, times, None)?;
    let (tile, materials) = (tile(), materials());
    let ((), times) = repeated(repeats, || {
        let (_, cpu_s) = thread.time(|| picture(&mesh, &tree, &tile, &materials, &camera))?;
        Ok(((), cpu_s))
    })?;
    told("picture, one thread", false, times, None)?;
    // As the command does it, all but the reading and writing of files.
    let whole = |parts: Parts| -> Result<(), BenchError> {
        let mesh = Mesh::new(parts).map_err(|e| refused(&e))?;
        picture(&mesh, &Tree::new(&mesh), &tile, &materials, &camera);
        Ok(())
    };
    let ((), times) = repeated(repeats, || {
        let (done, cpu_s) = time_of_process(|| whole(parts.clone()))?;
        done?;
        Ok(((), cpu_s))
    })?;
    told("mesh to radiance, all threads together", false, times, None)?;
    let ((), times) = repeated(repeats, || {
        let begin = Instant::now();
        whole(parts.clone())?;
        Ok(((), begin.elapsed().as_secs_f64()))
    })?;
    told("mesh to radiance", true, times, Some(Bar { most_s: 1.0, goal_s: 0.5 }))
}

fn picture(mesh: &Mesh, tree: &Tree, tile: &Tile, materials: &[Material], camera: &Camera) {
    let light = Light::Distant { direction: Vec3::new(-0.3, 0.4, 1.0).normalize(), irradiance: [6.0; 3] };
    let scene = Scene { mesh, tree, tile, repeats: 2.0, lobe: LOBE, materials, light: &light };
    std::hint::black_box(render(&scene, camera, 1));
}

/// The materials of the marble scene.
fn materials() -> Vec<Material> {
    let material = |truth: &crate::study::forward::TrueMaterial| Material {
        rho_d: truth.rho_d,
        rho_s: truth.rho_s,
        beta: truth.beta,
    };
    scene::Scene::marble().materials.iter().map(material).collect()
}

/// Waves of two materials; what they look like is of no account.
fn tile() -> Tile {
    let side = SIDE + overlap(SIDE);
    let texel = |i: usize| {
        let share = (0.5 + 0.5 * (0.3 * (i % side) as f32 + 0.1 * (i / side) as f32).sin()).clamp(0.0, 1.0);
        let mut weights = [0.0; MAX_MATERIALS];
        (weights[0], weights[1]) = (share, 1.0 - share);
        weights
    };
    Tile::of(&Texels { size: (side, side), weights: (0..side * side).map(texel).collect() }, SIDE)
}

/// What stands above the table.
pub fn heading((width, height): (usize, usize)) -> String {
    format!(
        "A knot rendered on {width} x {height} pixels, 2 materials, shadows; processor time, or wall time of all cores\n  {:<44}{:>10}{:>10}  bar",
        "work", "best", "median"
    )
}
