//! Options and data that cannot be fitted are refused with what and what to do.
#![allow(clippy::unwrap_used, missing_docs)]

use rigd::numerics::brdf::{Lobe, MODELS, Material};
use rigd::numerics::geometry::{Light, Projection, Sphere, Vec3};
use rigd::numerics::image::{Image, RadianceImage};
use rigd::pipeline::dataset::{Dataset, Geometry, NamedLight};
use rigd::pipeline::fit::{FitOptions, fit};
use rigd::pipeline::relight::relight;
use std::ops::ControlFlow;

/// A small ball of one grey material under three distant lights, radiance computed by Lambert's law.
fn ball() -> Dataset {
    let object = Sphere { center: Vec3::new(8.0, 8.0, 0.0), radius: 7.0 };
    let projection = Projection::Orthographic { mm_per_px: 1.0 };
    let directions = [[0.0, 0.0, -1.0], [0.5, 0.0, -0.8], [-0.4, 0.3, -0.8]].map(|d| Vec3::from(d).normalize());
    let image = |direction: &Vec3| {
        let shade = |i: usize| {
            let ray = projection.ray((i % 16) as f64 + 0.5, (i / 16) as f64 + 0.5);
            let point = object.intersect(&ray);
            [point.map_or(0.0, |p| 0.2 * p.normal.dot(direction).max(0.0) as f32); 3]
        };
        RadianceImage {
            radiance: Image { width: 16, height: 16, pixels: (0..256).map(shade).collect() },
            variance: None,
            valid: Image::filled(16, 16, true),
        }
    };
    let images = directions.iter().map(image).collect();
    let light = |(i, direction): (usize, &Vec3)| NamedLight {
        name: format!("{i}.png"),
        light: Light::Distant { direction: *direction, irradiance: [1.0; 3] },
    };
    let lights = directions.iter().enumerate().map(light).collect();
    let geometry =
        Geometry { width: 16, height: 16, projection, object: object.into(), mask: None, lights, cosine_cutoff: 0.2 };
    Dataset { geometry, images }
}

fn refusal(options: FitOptions) -> String {
    fit(&ball(), &options, &mut |_| ControlFlow::Continue(())).map(|_| ()).unwrap_err().to_string()
}

#[test]
fn what_cannot_be_used_is_named() {
    let lambert = || FitOptions { model: "lambert".into(), materials: Some(1), ..FitOptions::default() };
    assert!(refusal(FitOptions { threads: Some(0), ..lambert() }).contains("threads"));
    assert!(refusal(FitOptions { threads: Some(10_000_000), ..lambert() }).contains("1 to 256"));
    assert!(refusal(FitOptions { materials: Some(5), ..lambert() }).contains("1 to 4"));
    assert!(refusal(FitOptions { leave_out: vec![3], ..lambert() }).contains("3 lights"));
    assert!(refusal(FitOptions { leave_out: vec![0, 1, 2], ..lambert() }).contains("every light"));
    assert!(refusal(FitOptions { cosine_cutoff: Some(f64::NAN), ..lambert() }).contains("cut-off"));
    assert!(refusal(FitOptions { model: "wardd".into(), ..lambert() }).contains("ward"));
    assert!(refusal(FitOptions { solver: "magic".into(), ..lambert() }).contains("zheng2008"));
}

#[test]
fn a_lambert_ball_is_fitted_without_error() {
    let options = FitOptions { model: "lambert".into(), materials: Some(1), ..FitOptions::default() };
    let result = fit(&ball(), &options, &mut |_| ControlFlow::Continue(())).unwrap();
    assert!(result.report.mean_relative_error < 1e-6, "{}", result.report.mean_relative_error);
    assert!((result.material.materials[0].rho_d[0].value - 0.2 * std::f64::consts::PI).abs() < 1e-5);
}

/// Errors of the lights, weighed by their samples, are the errors of the whole: of the fitted ones, and of those left out.
#[test]
fn the_lights_make_up_the_whole() {
    let mut dataset = ball();
    for (image, factor) in dataset.images.iter_mut().zip([1.0, 1.1, 0.8]) {
        image.radiance.pixels.iter_mut().for_each(|pixel| *pixel = pixel.map(|v| factor * v));
    }
    // Gains would explain the lights away.
    let options = FitOptions {
        model: "lambert".into(),
        materials: Some(1),
        leave_out: vec![2],
        gains: "off".into(),
        ..FitOptions::default()
    };
    let report = fit(&dataset, &options, &mut |_| ControlFlow::Continue(())).unwrap().report;
    let mean = |left_out: bool| {
        let of = report.lights.iter().filter(|light| light.left_out == left_out);
        let (sum, samples) = of.fold((0.0, 0), |(sum, samples), light| {
            (sum + light.samples as f64 * light.mean_relative_error.unwrap(), samples + light.samples)
        });
        (sum / samples as f64, samples)
    };
    let ((fitted, samples), (left_out, _)) = (mean(false), mean(true));
    assert_eq!(samples, report.samples);
    assert!(fitted > 0.01 && (fitted - report.mean_relative_error).abs() < 1e-12, "{fitted}");
    assert!((left_out - report.left_out_relative_error.unwrap()).abs() < 1e-12, "{left_out}");
    let names: Vec<&str> = report.lights.iter().map(|light| light.image.as_str()).collect();
    assert_eq!(names, ["0.png", "1.png", "2.png"]);
}

/// The ball under more lights, its radiance made by `material` with the model called `model`.
fn glossy_ball(model: &dyn Lobe, material: &Material) -> Dataset {
    let mut dataset = ball();
    let geometry = &mut dataset.geometry;
    let directions = (0..9).map(|i| Vec3::new(0.4 * f64::from(i % 3) - 0.5, 0.4 * f64::from(i / 3) - 0.3, -1.0));
    geometry.lights = directions
        .enumerate()
        .map(|(i, d)| NamedLight {
            name: format!("{i}.exr"),
            light: Light::Distant { direction: d.normalize(), irradiance: [1.0; 3] },
        })
        .collect();
    let weights = [Image::filled(16, 16, 1.0)];
    let image = |light: &NamedLight| RadianceImage {
        radiance: relight(model, &[*material], &weights, geometry, &light.light),
        variance: None,
        valid: Image::filled(16, 16, true),
    };
    dataset.images = geometry.lights.iter().map(image).collect();
    dataset
}

#[test]
fn every_model_finds_the_roughness_of_its_own_ball() {
    // Values of the models are checked elsewhere, against an independent script; here the solver runs through each family.
    let truth = Material { rho_d: [0.5, 0.3, 0.2], rho_s: [0.04, 0.03, 0.05], beta: 0.25 };
    for &model in MODELS.iter().filter(|model| model.has_lobe()) {
        let options = FitOptions { model: model.name().into(), materials: Some(1), ..FitOptions::default() };
        let result = fit(&glossy_ball(model, &truth), &options, &mut |_| ControlFlow::Continue(())).unwrap();
        let found = &result.material.materials[0];
        let beta = found.beta.as_ref().unwrap().value;
        assert!((beta / truth.beta - 1.0).abs() < 0.01, "{}: beta {beta}", model.name());
        assert!((found.rho_s[0].value / truth.rho_s[0] - 1.0).abs() < 0.02, "{}: {:?}", model.name(), found.rho_s);
    }
}
