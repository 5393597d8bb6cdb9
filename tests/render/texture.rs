//! The weight map as texture: which square is taken, that it repeats without a seam, that it is looked up as it should.

use crate::{Stage, matt, plain};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rigd::numerics::brdf::lambert::Lambert;
use rigd::numerics::geometry::{Light, Ray, Vec3};
use rigd::numerics::image::Image;
use rigd::numerics::radiometry::response::Response;
use rigd::numerics::render::mesh::Mesh;
use rigd::numerics::render::patch::{Patch, PatchError, best};
use rigd::numerics::render::seam::overlap;
use rigd::numerics::render::shapes;
use rigd::numerics::render::tile::{Texels, Tile};
use rigd::pipeline::render::exposed;
use rigd::sim::scene::Scene;
use std::f64::consts::PI;

const SIDE: usize = 64;

/// A square of the simulated surface, as the camera sees it in the middle of the ball.
fn surface(kind: rig_config::Scene, seed: u64) -> Texels {
    let (scene, side) = (Scene::new(kind, seed), SIDE + overlap(SIDE));
    let texel = |i: usize| {
        let [x, y] = [i % side, i / side].map(|at| (at as f64 + 0.5) / side as f64 * 1.2 - 0.6);
        let [a, b] = scene.weights(&Vec3::new(x, y, -(1.0 - x * x - y * y).sqrt()));
        [a as f32, b as f32, 0.0, 0.0]
    };
    Texels { size: (side, side), weights: (0..side * side).map(texel).collect() }
}

fn apart(a: &[f32; 4], b: &[f32; 4]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum()
}

/// Mean squared difference of neighbours inside the first `side` texels, and across the edges where they meet themselves.
fn steps(texels: &Texels, side: usize) -> [f64; 2] {
    let mut sums = [(0.0, 0.0); 2];
    for j in 0..side {
        for i in 0..side {
            let across = usize::from(i + 1 == side);
            for (a, b) in [((i, j), ((i + 1) % side, j)), ((j, i), (j, (i + 1) % side))] {
                sums[across].0 += apart(texels.at(a.0, a.1), texels.at(b.0, b.1));
                sums[across].1 += 1.0;
            }
        }
    }
    sums.map(|(sum, count)| sum / count)
}

#[test]
fn across_its_edges_a_tile_goes_on_as_inside() {
    let (mut uncut, mut cut, mut original) = ([0.0; 2], [0.0; 2], 0.0);
    for kind in [rig_config::Scene::Marble, rig_config::Scene::Wood] {
        for seed in 0..12 {
            let square = surface(kind, seed);
            let tile = Tile::of(&square, SIDE);
            assert_eq!(tile.texels().size, (SIDE, SIDE));
            for (sums, texels) in [(&mut uncut, &square), (&mut cut, tile.texels())] {
                for (sum, step) in sums.iter_mut().zip(steps(texels, SIDE)) {
                    *sum += step;
                }
            }
            original += steps(&square, SIDE)[0];
            // Every texel is one of the four of the square that may lie there, or lies between them.
            for (i, texel) in tile.texels().weights.iter().enumerate() {
                let (x, y) = (i % SIDE, i / SIDE);
                let columns = if x < overlap(SIDE) { vec![x, x + SIDE] } else { vec![x] };
                let rows = if y < overlap(SIDE) { vec![y, y + SIDE] } else { vec![y] };
                let candidates: Vec<_> = rows.iter().flat_map(|&y| columns.iter().map(move |&x| (x, y))).collect();
                for m in 0..4 {
                    let values = || candidates.iter().map(|&(x, y)| square.at(x, y)[m]);
                    let (low, high) = (values().fold(1.0, f32::min), values().fold(0.0, f32::max));
                    let rounding = if candidates.len() == 1 { 0.0 } else { 1e-6 };
                    assert!((low - rounding..=high + rounding).contains(&texel[m]), "{kind:?} {seed}: {x}, {y}");
                }
            }
        }
    }
    let ratio = |[inside, across]: [f64; 2]| across / inside;
    println!(
        "across over inside: uncut {:.2}, cut {:.2}; inside over original {:.2}",
        ratio(uncut),
        ratio(cut),
        cut[0] / original
    );
    assert!(ratio(uncut) > 15.0, "these surfaces would show no seam anyway: {uncut:?}");
    assert!((0.8..1.25).contains(&ratio(cut)), "{cut:?}");
    // The cuts themselves run where both sides are alike.
    assert!(cut[0] < 1.2 * original, "inside {} instead of {original}", cut[0]);
}

#[test]
fn weights_are_looked_up_between_texels_and_around_the_edges() {
    let tile = Tile::of(&surface(rig_config::Scene::Wood, 3), SIDE);
    let middle = |i: usize| (i as f64 + 0.5) / SIDE as f64;
    for (x, y) in [(0, 0), (17, 40), (63, 5), (63, 63)] {
        let right = (x + 1) % SIDE;
        for m in 0..4 {
            let [here, beside] = [tile.texels().at(x, y)[m], tile.texels().at(right, y)[m]].map(f64::from);
            for turns in [0.0, 1.0, -3.0] {
                let at = |part: f64| tile.at(middle(x) + part / SIDE as f64 + turns, middle(y) - turns)[m];
                assert!((at(0.0) - here).abs() < 1e-9);
                assert!((at(0.25) - (0.75 * here + 0.25 * beside)).abs() < 1e-9, "texel {x}, {y}");
            }
        }
    }
}

fn map(side: usize, value: impl Fn(usize, usize) -> f32) -> Image<f32> {
    Image { width: side, height: side, pixels: (0..side * side).map(|i| value(i % side, i / side)).collect() }
}

#[test]
fn the_square_lies_deepest_inside_and_then_where_errors_are_least() {
    // A band of 20 rows: squares of 10 are deepest along its middle line, and best where the error has its minimum.
    let inside = |y: usize| (15..35).contains(&y);
    let weights = [map(60, |_, y| if inside(y) { 0.5 } else { 0.0 })];
    let sigma = [map(60, |x, y| if inside(y) { 0.01 + 1e-3 * (x as f32 - 33.5).abs() } else { 0.0 })];
    assert_eq!(best(&weights, &sigma, 10), Ok(Patch { x: 29, y: 20, side: 10 }));
    // An error that is infinite, or none at all, keeps a pixel out of no square, but costs as much as an error can.
    let broken = [map(60, |x, y| if inside(y) && x == 33 { f32::INFINITY } else { sigma[0].pixels[y * 60 + x] })];
    let found = best(&weights, &broken, 10).unwrap();
    assert!(found.y == 20 && !(found.x..found.x + 10).contains(&33), "{found:?}");
    assert_eq!(best(&weights, &sigma, 21), Err(PatchError { wanted: 21, largest: 20 }));
    assert_eq!(best(&[map(9, |_, _| 0.0)], &[map(9, |_, _| 0.0)], 1), Err(PatchError { wanted: 1, largest: 0 }));
}

#[test]
fn a_square_is_measured_throughout_and_the_largest_is_found() {
    for seed in 0..40 {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let holes: Vec<bool> = (0..24 * 24).map(|_| random.random_bool(0.03)).collect();
        let weights = [map(24, |x, y| if holes[y * 24 + x] { 0.0 } else { 1.0 })];
        let sigma = [map(24, |_, _| 0.0)];
        let whole =
            |side: usize, x: usize, y: usize| (0..side * side).all(|i| !holes[(y + i / side) * 24 + x + i % side]);
        let there_is = |side: usize| (0..=24 - side).any(|y| (0..=24 - side).any(|x| whole(side, x, y)));
        let largest = (1..=24).rev().find(|&side| there_is(side)).unwrap();
        let Patch { x, y, side } = best(&weights, &sigma, largest).unwrap();
        assert!(side == largest && whole(side, x, y), "seed {seed}");
        assert_eq!(best(&weights, &sigma, largest + 1), Err(PatchError { wanted: largest + 1, largest }));
    }
}

/// Where all three projections say the same, so does their blend: a ball without texture coordinates has no seam in brightness.
#[test]
fn projected_weights_keep_their_sum() {
    let light = Light::Distant { direction: Vec3::z(), irradiance: [PI; 3] };
    let mesh = Mesh::new(shapes::sphere(12)).unwrap();
    let mut stage = Stage::new(mesh, &Lambert, &[matt([1.0; 3]), matt([1.0; 3])], [0.0; 4], light);
    stage.tile = plain([0.25, 0.5, 0.0, 0.0]);
    for i in 0..200 {
        let [x, y] = [i % 20, i / 20].map(|at| f64::from(at) * 0.08 - 0.7);
        let ray = Ray { origin: Vec3::new(x, y, 4.0), direction: -Vec3::z() };
        let Some(hit) = stage.tree.nearest(&ray) else { continue };
        let cos = stage.mesh.at(&hit, &ray.direction).normal.z;
        let radiance = stage.scene().radiance(&ray).unwrap();
        assert!((radiance[0] - 0.75 * cos).abs() < 1e-6, "{radiance:?}, {cos}");
    }
}

/// radiance x time = exposure, through the response to the level it stands at, in every channel.
#[test]
fn a_picture_has_the_levels_of_its_response() {
    let curve = |power: f64| (0..256).map(|z| power * (f64::from(z).max(0.3) / 128.0).ln()).collect::<Vec<f64>>();
    let response = Response { log_exposure: [curve(2.0), curve(2.2), curve(1.8)] };
    for time_s in [2.0, 0.01] {
        let radiance = |z: usize| std::array::from_fn(|c| (response.log_exposure[c][z].exp() / time_s) as f32);
        let image = Image { width: 256, height: 1, pixels: (0..256).map(radiance).collect() };
        let picture = exposed(&image, &response, time_s);
        assert!(picture.pixels.iter().enumerate().all(|(z, pixel)| *pixel == [z as u8; 3]), "{picture:?}");
    }
    let extremes = Image { width: 2, height: 1, pixels: vec![[0.0; 3], [f32::MAX; 3]] };
    assert_eq!(exposed(&extremes, &response, 2.0).pixels, [[0; 3], [255; 3]]);
    // sRGB by its definition: linear 0.5 is level 187.5, 0.18 is level 117.6.
    let srgb = Response::srgb();
    for (linear, level) in [(0.5_f64, 187.516), (0.18, 117.646), (0.002, 6.589)] {
        let middle = ((128.0_f64 / 255.0 + 0.055) / 1.055).powf(2.4);
        assert!((srgb.level(1, (linear / middle).ln()) - level).abs() < 0.02, "{linear}");
    }
}
