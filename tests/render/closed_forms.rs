//! Pictures whose every pixel is known beforehand.

use crate::{Stage, matt, square, triangles};
use rigd::numerics::brdf::lambert::Lambert;
use rigd::numerics::brdf::{Material, ward::Ward};
use rigd::numerics::geometry::{Light, Ray, Vec3};
use rigd::numerics::render::camera::{Camera, View};
use rigd::numerics::render::mesh::Mesh;
use rigd::numerics::render::{render, shapes};
use std::f64::consts::PI;

const RHO: [f64; 3] = [0.6, 0.4, 0.2];

/// Lambert: radiance = irradiance x cos(theta_i) x rho / pi, with the normal of the ball itself at every pixel.
#[test]
fn a_matt_ball_under_a_distant_light() {
    let direction = Vec3::new(0.5, 0.4, 0.6).normalize();
    let light = Light::Distant { direction, irradiance: [2.0, 3.0, 4.0] };
    let stage =
        Stage::new(Mesh::new(shapes::sphere(100)).unwrap(), &Lambert, &[matt(RHO)], [1.0, 0.0, 0.0, 0.0], light);
    let view = View { position: Vec3::new(0.0, 0.0, 6.0), look_at: Vec3::zeros(), field_deg: 22.0 };
    let camera = Camera::new(&view, (150, 120)).unwrap();
    let picture = render(&stage.scene(), &camera, 1);
    let (mut lit, mut dark) = (0, 0);
    for y in 0..120 {
        for x in 0..150 {
            let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
            let along = -ray.origin.dot(&ray.direction);
            let miss2 = (ray.origin + along * ray.direction).norm_squared();
            assert!(*picture.seen.at(x, y) || miss2 > 0.999, "column {x}, row {y}: the ball has a hole");
            assert!(!*picture.seen.at(x, y) || miss2 < 1.0, "column {x}, row {y}: there is no ball");
            if miss2 > 0.95 {
                continue;
            }
            let normal = ray.origin + (along - (1.0 - miss2).sqrt()) * ray.direction;
            let cos = normal.dot(&direction);
            for c in 0..3 {
                let white = [2.0, 3.0, 4.0][c] * RHO[c] / PI;
                let found = f64::from(picture.radiance.at(x, y)[c]);
                let expected = white * cos.max(0.0);
                // At the edge of its own shadow a facet is lit whole or not at all.
                let tolerance = if cos.abs() < 0.02 { 0.02 } else { 5e-4 };
                assert!((found - expected).abs() <= tolerance * white, "column {x}, row {y}: {found}, {expected}");
                if cos > 0.02 { lit += 1 } else { dark += 1 }
            }
        }
    }
    assert!(lit > 9000 && dark > 1500, "{lit} values lit, {dark} dark");
}

/// Radiance = intensity / distance^2 x cos(theta_i) x rho / pi.
#[test]
fn a_matt_plane_under_a_small_lamp() {
    let (lamp, intensity) = (Vec3::new(1.0, 2.0, 3.0), [40.0, 30.0, 20.0]);
    let light = Light::Point { position: lamp, intensity };
    let stage = Stage::new(triangles(&square(10.0, 0.0)), &Lambert, &[matt(RHO)], [0.5, 0.0, 0.0, 0.0], light);
    for i in 0..400 {
        let point = Vec3::new(f64::from(i % 20) * 0.7 - 6.3, f64::from(i / 20) * 0.7 - 6.4, 0.0);
        let origin = Vec3::new(0.3, -0.2, 8.0);
        let radiance = stage.scene().radiance(&Ray { origin, direction: (point - origin).normalize() }).unwrap();
        let distance2 = (lamp - point).norm_squared();
        for c in 0..3 {
            let expected = 0.5 * intensity[c] / distance2 * (3.0 / distance2.sqrt()) * RHO[c] / PI;
            assert!((radiance[c] / expected - 1.0).abs() < 1e-12, "point {i}: {} there, {expected}", radiance[c]);
        }
    }
    let below = Ray { origin: Vec3::new(0.0, 0.0, -5.0), direction: Vec3::z() };
    assert_eq!(stage.scene().radiance(&below), Some([0.0; 3]), "the lamp stands behind what is seen from below");
    let beside = Ray { origin: Vec3::new(20.0, 0.0, 5.0), direction: -Vec3::z() };
    assert_eq!(stage.scene().radiance(&beside), None);
}

/// A square of side 1 at height 1 under a lamp at height 3 throws a shadow of side 1.5, and a lamp below it throws none.
#[test]
fn a_square_throws_the_shadow_of_similar_triangles() {
    let plane = square(10.0, 0.0);
    let stage = |height: f64| {
        let light = Light::Point { position: Vec3::new(0.0, 0.0, height), intensity: [1.0; 3] };
        let both = [plane, square(0.5, 1.0)].concat();
        Stage::new(triangles(&both), &Lambert, &[matt(RHO)], [1.0, 0.0, 0.0, 0.0], light)
    };
    let (above, below) = (stage(3.0), stage(0.9));
    let mut shadowed = 0;
    for i in 0..1600 {
        let point = Vec3::new(f64::from(i % 40) * 0.1 - 1.96, f64::from(i / 40) * 0.1 - 1.97, 0.0);
        let aside = Vec3::new(5.0, 0.0, 0.25);
        let ray = Ray { origin: point + aside, direction: -aside.normalize() };
        let inside = point.x.abs() < 0.75 && point.y.abs() < 0.75;
        let dark = |stage: &Stage| stage.scene().radiance(&ray).unwrap() == [0.0; 3];
        assert_eq!(dark(&above), inside, "{point:?}");
        assert!(!dark(&below), "{point:?}");
        shadowed += usize::from(inside);
    }
    assert_eq!(shadowed, 15 * 15);
}

/// A lamp in the surface, a lamp in its plane: no light arrives, and nothing is not a number.
#[test]
fn a_lamp_in_the_surface_gives_no_light() {
    for position in [Vec3::zeros(), Vec3::new(3.0, 0.0, 0.0)] {
        let light = Light::Point { position, intensity: [1.0; 3] };
        let stage = Stage::new(triangles(&square(10.0, 0.0)), &Lambert, &[matt(RHO)], [1.0, 0.0, 0.0, 0.0], light);
        let ray = Ray { origin: Vec3::new(0.0, 0.0, 5.0), direction: -Vec3::z() };
        assert_eq!(stage.scene().radiance(&ray), Some([0.0; 3]));
    }
}

#[test]
fn the_same_bits_at_any_number_of_threads() {
    let materials = [
        Material { rho_d: [0.6, 0.5, 0.4], rho_s: [0.05; 3], beta: 0.06 },
        Material { rho_d: [0.1, 0.2, 0.3], rho_s: [0.03; 3], beta: 0.11 },
    ];
    let light = Light::Point { position: Vec3::new(-4.0, 6.0, 8.0), intensity: [300.0; 3] };
    let mesh = Mesh::new(shapes::knot(140, 20)).unwrap();
    let stage = Stage::new(mesh, &Ward, &materials, [0.7, 0.3, 0.0, 0.0], light);
    let camera = Camera::new(&View::of(&stage.mesh, 30.0, (96, 64)), (96, 64)).unwrap();
    let bits = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let picture = pool.install(|| render(&stage.scene(), &camera, 2));
        picture.radiance.pixels.iter().flatten().map(|value| value.to_bits()).collect::<Vec<u32>>()
    };
    let one = bits(1);
    assert!(one.iter().filter(|&&bits| bits != 0).count() > 2000);
    for threads in [2, 3] {
        assert_eq!(bits(threads), one, "{threads} threads");
    }
}

/// The bundled shapes are shown whole, and the knot has the size that the bar speaks of.
#[test]
fn bundled_shapes_fill_their_pictures() {
    for name in shapes::NAMES {
        let mesh = Mesh::new(shapes::by_name(name).unwrap()).unwrap();
        assert_eq!(mesh.dropped(), 0, "{name}");
        assert!(name != "knot" || mesh.triangles() == 70_000);
        let light = Light::Distant { direction: Vec3::z(), irradiance: [1.0; 3] };
        let stage = Stage::new(mesh, &Lambert, &[matt(RHO)], [1.0, 0.0, 0.0, 0.0], light);
        let size = (60, 40);
        let picture = render(&stage.scene(), &Camera::new(&View::of(&stage.mesh, 30.0, size), size).unwrap(), 1);
        let seen = |x: usize, y: usize| *picture.seen.at(x, y);
        let edge = (0..60).any(|x| seen(x, 0) || seen(x, 39)) || (0..40).any(|y| seen(0, y) || seen(59, y));
        assert!(!edge, "{name} is cut off");
        let share = picture.seen.pixels.iter().filter(|&&seen| seen).count() as f64 / 2400.0;
        assert!(share > 0.15, "{name} covers {share}");
    }
    assert!(shapes::by_name("teapot").is_none());
}
