//! The tree against looking at every triangle.

use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rigd::numerics::geometry::{Ray, Vec3};
use rigd::numerics::render::mesh::{Mesh, Parts};
use rigd::numerics::render::tree::{Face, Hit, Tree};

type Random = Xoshiro256PlusPlus;

fn point(random: &mut Random, size: f64) -> Vec3 {
    Vec3::from_fn(|_, _| random.random_range(-size..size))
}

/// Kinds of meshes: loose triangles, slivers of very different sizes, flat ones on a grid, all about one middle.
fn soup(random: &mut Random, kind: usize, count: usize) -> Mesh {
    let mut parts = Parts::default();
    for t in 0..count as u32 {
        let size = match kind {
            1 => 10_f64.powi(random.random_range(-6..3)),
            3 => f64::from(t + 1),
            _ => 0.3,
        };
        let middle = if kind == 3 { Vec3::zeros() } else { point(random, 2.0) };
        let mut corners = [(); 3].map(|()| point(random, size));
        if kind == 3 {
            // The middle of the box is the origin, whatever the size.
            corners = [Vec3::new(-size, -size, -size), Vec3::new(size, size, size), Vec3::new(size, -size, 0.0)];
        }
        if kind == 2 {
            let axis = random.random_range(0..3);
            let plane = f64::from(random.random_range(-2..=2));
            for corner in &mut corners {
                *corner = (*corner + middle).map(|c| (4.0 * c).round() / 4.0);
                corner[axis] = plane;
            }
        } else {
            corners = corners.map(|corner| corner + middle);
        }
        parts.positions.extend(corners);
        parts.triangles.push([3 * t, 3 * t + 1, 3 * t + 2]);
    }
    // One that has an area, whatever the dice say.
    let first = parts.positions.len() as u32;
    parts.positions.extend([Vec3::zeros(), Vec3::x(), Vec3::y()]);
    parts.triangles.push([first, first + 1, first + 2]);
    Mesh::new(parts).unwrap()
}

/// Anywhere, along an axis, or on the grid, where boxes end.
fn ray(random: &mut Random) -> Ray {
    let mut origin = point(random, 4.0);
    let mut direction = point(random, 1.0).normalize();
    if random.random_bool(0.5) {
        origin = origin.map(f64::round);
        direction = Vec3::zeros();
        direction[random.random_range(0..3)] = if random.random_bool(0.5) { 1.0 } else { -1.0 };
    }
    Ray { origin, direction }
}

#[test]
fn the_first_triangle_is_the_one_that_brute_force_finds() {
    let (mut hits, mut blocked, mut ties) = (0, 0, 0);
    for seed in 0..60 {
        let mut random = Random::seed_from_u64(seed);
        let count = [1, 5, 40, 400][random.random_range(0..4)];
        let mesh = soup(&mut random, seed as usize % 4, count);
        let tree = Tree::new(&mesh);
        let faces: Vec<Face> = (0..mesh.triangles()).map(|triangle| Face::new(&mesh, triangle)).collect();
        for _ in 0..300 {
            let ray = ray(&mut random);
            let all: Vec<Hit> = faces.iter().filter_map(|face| face.meet(&ray)).collect();
            let order = |hit: &Hit| (hit.distance, hit.triangle);
            let first = all.iter().copied().reduce(|a, b| if order(&b) < order(&a) { b } else { a });
            assert_eq!(tree.nearest(&ray), first, "seed {seed}, {ray:?}");
            hits += usize::from(first.is_some());
            ties += usize::from(first.is_some_and(|f| all.iter().filter(|h| h.distance == f.distance).count() > 1));
            let (from, least, most) = (random.random_range(0..mesh.triangles()), 0.2, random.random_range(0.2..6.0));
            let between = |hit: &&Hit| hit.triangle != from && (least..=most).contains(&hit.distance);
            let expected = all.iter().find(between).is_some();
            assert_eq!(tree.is_blocked(&ray, from, least, most), expected, "seed {seed}, {ray:?}");
            blocked += usize::from(expected);
        }
    }
    assert!(hits > 2000 && blocked > 1000 && ties > 20, "{hits} hits, {blocked} blocked, {ties} ties");
}
