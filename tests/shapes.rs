//! Cylinders and normal maps: against closed forms, against the sphere, through files, and in a fit.
#![allow(clippy::unwrap_used, missing_docs)]

use rand::{RngExt, SeedableRng, rngs::StdRng};
use rigd::numerics::brdf::{Material, lambert::Lambert};
use rigd::numerics::geometry::{Angles, Cylinder, Light, Projection, Ray, Shape, Vec3};
use rigd::numerics::image::{Image, RadianceImage};
use rigd::pipeline::dataset::{Dataset, Geometry, NamedLight};
use rigd::pipeline::fit::{FitOptions, fit};
use rigd::pipeline::relight::relight;
use rigd::store::dataset;
use rigd::store::exr::{Planes, write_planes};
use std::f64::consts::PI;
use std::ops::ControlFlow;
use std::path::Path;

fn vector(random: &mut StdRng, size: f64) -> Vec3 {
    Vec3::from(std::array::from_fn(|_| random.random_range(-size..size)))
}

/// Signed distance from the lateral surface and from the ends, both negative inside, by cross and dot products.
fn outside(point: &Vec3, start: &Vec3, end: &Vec3, radius: f64) -> (f64, f64) {
    let axis = (end - start).normalize();
    let along = (point - start).dot(&axis);
    ((point - start).cross(&axis).norm() - radius, (-along).max(along - (end - start).norm()))
}

/// Where marching along a ray first enters the solid through its side; none where it misses or enters through an end.
fn march(ray: &Ray, start: &Vec3, end: &Vec3, radius: f64) -> Option<Vec3> {
    const STEP: f64 = 0.02;
    let at = |t: f64| ray.origin + ray.direction * t;
    let inside = |t: f64| {
        let (side, ends) = outside(&at(t), start, end, radius);
        side <= 0.0 && ends <= 0.0
    };
    let first = (1..10_000).map(|i| f64::from(i) * STEP).find(|&t| inside(t))?;
    let (mut before, mut after) = (first - STEP, first);
    for _ in 0..60 {
        let middle = (before + after) / 2.0;
        *(if inside(middle) { &mut after } else { &mut before }) = middle;
    }
    let (side, ends) = outside(&at(after), start, end, radius);
    (side > ends).then(|| at(after))
}

#[test]
fn a_ray_meets_a_cylinder_where_marching_along_it_does() {
    let mut random = StdRng::seed_from_u64(31);
    let (mut hits, mut misses) = (0, 0);
    for _ in 0..400 {
        let middle = Vec3::new(0.0, 0.0, 100.0);
        let (start, end) = (middle + vector(&mut random, 25.0), middle + vector(&mut random, 25.0));
        let radius = random.random_range(4.0..20.0);
        let aim = middle + vector(&mut random, 20.0);
        let ray = Ray { origin: Vec3::zeros(), direction: aim.normalize() };
        let cylinder = Cylinder::new(start, end, radius).unwrap();
        let Some(truth) = march(&ray, &start, &end, radius) else {
            misses += 1;
            assert!(cylinder.intersect(&ray).is_none(), "{cylinder:?} {ray:?}");
            continue;
        };
        hits += 1;
        let found = cylinder.intersect(&ray).unwrap();
        assert!((found.position - truth).norm() < 1e-6, "{} is not {truth}", found.position);
        assert!(outside(&found.position, &start, &end, radius).0.abs() < 1e-9, "off the surface");
        assert!(found.normal.dot(&(end - start).normalize()).abs() < 1e-12, "the normal leans along the axis");
        assert!((found.normal.norm() - 1.0).abs() < 1e-12);
        assert!(found.normal.dot(&ray.direction) <= 0.0, "the far side was returned");
    }
    assert!(hits > 100 && misses > 50, "{hits} hits and {misses} misses prove little");
}

#[test]
fn a_ray_along_the_axis_and_one_through_an_end_meet_nothing() {
    let cylinder = Cylinder::new(Vec3::new(0.0, 0.0, 50.0), Vec3::new(0.0, 0.0, 90.0), 10.0).unwrap();
    for direction in [Vec3::z(), Vec3::new(0.1, 0.0, 1.0).normalize()] {
        assert!(cylinder.intersect(&Ray { origin: Vec3::zeros(), direction }).is_none(), "{direction}");
    }
    assert_eq!(Cylinder::new(Vec3::zeros(), Vec3::zeros(), 1.0), None);
    assert_eq!(Cylinder::new(Vec3::zeros(), Vec3::x(), 0.0), None);
    assert_eq!(Cylinder::new(Vec3::zeros(), Vec3::x() * f64::NAN, 1.0), None);
}

const SIDE: usize = 32;

fn distant(directions: &[[f64; 3]]) -> Vec<NamedLight> {
    let light = |(i, d): (usize, &[f64; 3])| NamedLight {
        name: format!("{i}.exr"),
        light: Light::Distant { direction: Vec3::from(*d).normalize(), irradiance: [1.0; 3] },
    };
    directions.iter().enumerate().map(light).collect()
}

/// A bar along y, 8 px from the left edge to 24: its normal has sin = (x - 16) / 8, whatever the row between 4 and 28.
fn bar() -> Dataset {
    let lights = distant(&[[0.0, 0.0, -1.0], [0.5, 0.2, -0.8], [-0.4, 0.3, -0.8]]);
    let image = |light: &NamedLight| {
        let Light::Distant { direction, .. } = &light.light else { unreachable!("only distant lights were made") };
        let shade = |i: usize| {
            let (sin, y) = (((i % SIDE) as f64 + 0.5 - 16.0) / 8.0, (i / SIDE) as f64 + 0.5);
            if sin.abs() >= 1.0 || !(4.0..28.0).contains(&y) {
                return [0.0; 3];
            }
            let cos_i = sin * direction.x - (1.0 - sin * sin).sqrt() * direction.z;
            [0.6, 0.3, 0.1].map(|rho| (rho / PI * cos_i.max(0.0)) as f32)
        };
        RadianceImage {
            radiance: Image { width: SIDE, height: SIDE, pixels: (0..SIDE * SIDE).map(shade).collect() },
            variance: None,
            valid: Image::filled(SIDE, SIDE, true),
        }
    };
    let images = lights.iter().map(image).collect();
    let object = Cylinder::new(Vec3::new(16.0, 4.0, 7.0), Vec3::new(16.0, 28.0, 7.0), 8.0).unwrap();
    let geometry = Geometry {
        width: SIDE,
        height: SIDE,
        projection: Projection::Orthographic { mm_per_px: 1.0 },
        object: Shape::Cylinder(object),
        mask: None,
        lights,
        cosine_cutoff: 0.2,
    };
    Dataset { geometry, images }
}

#[test]
fn a_lambert_bar_is_fitted_and_relit_without_error() {
    let dataset = bar();
    let options = FitOptions { model: "lambert".into(), materials: Some(1), ..FitOptions::default() };
    let result = fit(&dataset, &options, &mut |_| ControlFlow::Continue(())).unwrap();
    assert!(result.report.mean_relative_error < 1e-6, "{}", result.report.mean_relative_error);
    assert!(result.report.pixels > 250, "{} pixels", result.report.pixels);
    for (found, truth) in result.material.materials[0].rho_d.iter().zip([0.6, 0.3, 0.1]) {
        assert!((found.value - truth).abs() < 1e-5, "{} is not {truth}", found.value);
    }
    let material = Material { rho_d: [0.6, 0.3, 0.1], rho_s: [0.0; 3], beta: 1.0 };
    let weights = [Image::filled(SIDE, SIDE, 1.0)];
    for (light, image) in dataset.geometry.lights.iter().zip(&dataset.images) {
        let relit = relight(&Lambert, &[material], &weights, &dataset.geometry, &light.light);
        for (relit, image) in relit.pixels.as_flattened().iter().zip(image.radiance.pixels.as_flattened()) {
            assert!((relit - image).abs() < 1e-6, "{relit} is not {image}");
        }
    }
}

fn write_map(path: &Path, names: [&str; 3], size: usize, value: impl Fn(usize, usize) -> [f32; 3]) {
    let pixels: Vec<[f32; 3]> = (0..size * size).map(|i| value(i % size, i / size)).collect();
    let channels = (0..3).map(|c| (names[c].to_owned(), pixels.iter().map(|p| p[c]).collect())).collect();
    write_planes(path, Planes { origin: (0, 0), full: (size, size), size: (size, size), channels }, "").unwrap();
}

const PINHOLE: &str =
    "projection = \"pinhole\"\nfocal_px = [900, 900]\nprincipal_px = [16, 16]\ndistortion = [-0.2, 0, 0, 0, 0]";
const ORTHOGRAPHIC: &str = "projection = \"orthographic\"\nmm_per_px = 2";

fn describe(folder: &Path, camera: &str, object: &str) {
    // In front of the ball: it lies at z = 1500 before the pinhole and at z = 0 before the parallel rays.
    let z = if camera == PINHOLE { 1200 } else { -300 };
    let light = format!("image = \"0.exr\"\nposition_mm = [600, -50, {z}]\nintensity = [1, 1, 1]");
    let text = format!(
        "format = 1\n[camera]\nwidth = {SIDE}\nheight = {SIDE}\n{camera}\n[object]\n{object}\n[[light]]\n{light}\n"
    );
    std::fs::write(folder.join(dataset::FILE), text).unwrap();
}

/// The point and normal of a ball at `center` (radius 25) that a ray shows, by the quadratic formula.
fn on_ball(ray: &Ray, center: Vec3) -> Option<(Vec3, Vec3)> {
    let b = ray.direction.dot(&(ray.origin - center));
    let discriminant = b * b - (ray.origin - center).norm_squared() + 25.0 * 25.0;
    let point = ray.origin + ray.direction * (-b - discriminant.sqrt());
    (discriminant >= 0.0).then(|| (point, (point - center) / 25.0))
}

#[test]
fn a_ball_as_sphere_and_as_maps_has_the_same_angles() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (camera, center, sphere, maps) in [
        (
            PINHOLE,
            Vec3::new(3.0, -2.0, 1500.0),
            "shape = \"sphere\"\ncenter_mm = [3, -2, 1500]\nradius_mm = 25",
            "shape = \"normals\"\nnormals = \"n.exr\"\npositions = \"p.exr\"",
        ),
        (
            ORTHOGRAPHIC,
            Vec3::new(30.0, 34.0, 0.0),
            "shape = \"sphere\"\ncenter_px = [15, 17]\nradius_px = 12.5",
            "shape = \"normals\"\nnormals = \"n.exr\"\npositions = \"p.exr\"",
        ),
    ] {
        describe(folder, camera, sphere);
        let sphere = dataset::read_geometry(folder).unwrap();
        let seen = |x: usize, y: usize| on_ball(&sphere.projection.ray(x as f64 + 0.5, y as f64 + 0.5), center);
        // Normals three times too long: they are normalised.
        let normal =
            |x, y| seen(x, y).map_or([0.0; 3], |(_, n)| [n.x as f32 * 3.0, n.y as f32 * 3.0, n.z as f32 * 3.0]);
        write_map(&folder.join("n.exr"), ["X", "Y", "Z"], SIDE, normal);
        let position = |x, y| seen(x, y).map_or([f32::NAN; 3], |(p, _)| [p.x as f32, p.y as f32, p.z as f32]);
        write_map(&folder.join("p.exr"), ["R", "G", "B"], SIDE, position);
        describe(folder, camera, maps);
        let map = dataset::read_geometry(folder).unwrap();
        let mut points = 0;
        for (x, y) in (0..SIDE * SIDE).map(|i| (i % SIDE, i / SIDE)) {
            let ray = sphere.projection.ray(x as f64 + 0.5, y as f64 + 0.5);
            let (Some(a), Some(b)) = (sphere.object.at(x, y, &ray), map.object.at(x, y, &ray)) else {
                assert!(sphere.object.at(x, y, &ray).is_none() && map.object.at(x, y, &ray).is_none(), "{x}, {y}");
                continue;
            };
            let angles = |p: &rigd::numerics::geometry::SurfacePoint| {
                let (to_light, irradiance) = sphere.lights[0].light.at(&p.position);
                (Angles::new(&p.normal, &to_light, &p.view), irradiance[0] * 1e6)
            };
            let ((a, near), (b, far)) = (angles(&a), angles(&b));
            if a.cos_i < 0.05 || a.cos_r < 0.05 {
                continue;
            }
            points += 1;
            let pairs = [(a.cos_i, b.cos_i), (a.cos_r, b.cos_r), (a.cos_iv, b.cos_iv), (near, far)];
            assert!(pairs.iter().all(|(a, b)| (a - b).abs() < 1e-6), "{x}, {y}: {a:?} and {b:?}");
            assert!((a.half_angle() - b.half_angle()).abs() < 1e-6, "{x}, {y}: {a:?} and {b:?}");
        }
        assert!(points > 250, "{points} points");
    }
}

#[test]
fn without_positions_a_map_lies_where_its_parallel_rays_begin() {
    let folder = tempfile::tempdir().unwrap();
    write_map(&folder.path().join("n.exr"), ["X", "Y", "Z"], SIDE, |x, _| [0.0, 0.0, if x < 4 { 0.0 } else { -2.0 }]);
    describe(folder.path(), ORTHOGRAPHIC, "shape = \"normals\"\nnormals = \"n.exr\"");
    let geometry = dataset::read_geometry(folder.path()).unwrap();
    let at = |x: usize, y: usize| geometry.object.at(x, y, &geometry.projection.ray(x as f64 + 0.5, y as f64 + 0.5));
    assert!(at(3, 7).is_none() && at(SIDE, 0).is_none());
    let point = at(5, 7).unwrap();
    assert_eq!((point.position, point.normal), (Vec3::new(11.0, 15.0, 0.0), -Vec3::z()));
}

#[test]
fn maps_that_contradict_the_camera_are_refused_with_the_place() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let projection = Projection::Pinhole { focal_px: [900.0; 2], principal_px: [16.0; 2], distortion: [0.0; 5] };
    let seen = |x: usize, y: usize| {
        on_ball(&projection.ray(x as f64 + 0.5, y as f64 + 0.5), Vec3::new(0.0, 0.0, 1500.0))
            .map_or(([0.0; 3], [0.0; 3]), |(p, n)| (<[f64; 3]>::from(p), <[f64; 3]>::from(n)))
    };
    let single = |v: [f64; 3]| v.map(|v| v as f32);
    describe(folder, PINHOLE, "shape = \"normals\"\nnormals = \"n.exr\"\npositions = \"p.exr\"");
    let refusal = || dataset::read_geometry(folder).map(|_| ()).unwrap_err().to_string();
    let (n, p) = (folder.join("n.exr"), folder.join("p.exr"));
    let normals = |change: &dyn Fn(usize, [f32; 3]) -> [f32; 3]| {
        write_map(&n, ["X", "Y", "Z"], SIDE, |x, y| change(y * SIDE + x, single(seen(x, y).1)));
    };
    let positions = |change: &dyn Fn([f32; 3]) -> [f32; 3]| {
        write_map(&p, ["X", "Y", "Z"], SIDE, |x, y| change(single(seen(x, y).0)));
    };
    let middle = 16 * SIDE + 16;
    assert!(refusal().contains("n.exr: there is no such OpenEXR file"), "{}", refusal());

    normals(&|_, n| n);
    positions(&|p| p);
    dataset::read_geometry(folder).unwrap();

    normals(&|i, n| if i == middle { [f32::NAN; 3] } else { n });
    assert!(refusal().contains("column 16, row 16 is [NaN"), "{}", refusal());
    normals(&|_, _| [0.0; 3]);
    assert!(refusal().contains("no pixel has a normal"), "{}", refusal());
    normals(&|_, [x, y, z]| [x, y, -z]);
    assert!(refusal().contains("point away from the camera"), "{}", refusal());
    write_map(&n, ["X", "Y", "Z"], SIDE + 1, |_, _| [0.0, 0.0, -1.0]);
    assert!(refusal().contains("33 x 33 pixels, 32 x 32 expected"), "{}", refusal());
    write_map(&n, ["X", "Y", "Q"], SIDE, |_, _| [0.0, 0.0, -1.0]);
    assert!(refusal().contains("X, Y and Z (or R, G and B) are needed"), "{}", refusal());

    normals(&|_, n| n);
    positions(&|p| if p == [0.0; 3] { p } else { [f32::INFINITY; 3] });
    assert!(refusal().contains("p.exr") && refusal().contains("finite point in front"), "{}", refusal());
    positions(&|[x, y, z]| [x, y, -z]);
    assert!(refusal().contains("in front of the camera"), "{}", refusal());
    positions(&|[x, y, z]| [x, -y, z]);
    assert!(refusal().contains("points in the camera frame"), "{}", refusal());
}
