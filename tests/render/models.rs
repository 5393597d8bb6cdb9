//! Every BRDF model as a pixel shows it: against the numbers of an independent script (tests/oracle/brdf.py), and against what
//! the fit predicts for the same sample.

use crate::{Stage, matt, triangles};
use rigd::numerics::brdf::{MODELS, Material, by_name};
use rigd::numerics::fit::observations::Sample;
use rigd::numerics::fit::predict;
use rigd::numerics::geometry::{Angles, Light, Ray, Vec3};
use serde::Deserialize;

#[derive(Deserialize)]
struct Case {
    model: String,
    normal: [f64; 3],
    light: [f64; 3],
    view: [f64; 3],
    beta: f64,
    value: f64,
}

/// A large triangle through the origin, across `normal`.
fn facing(normal: &Vec3) -> [[f64; 3]; 3] {
    let across = normal.cross(&if normal.x.abs() < 0.9 { Vec3::x() } else { Vec3::y() }).normalize();
    let up = normal.cross(&across);
    [across + up, up - 2.0 * across, -2.0 * up + across].map(|corner| (10.0 * corner).into())
}

#[test]
fn a_pixel_is_what_the_script_and_the_fit_say() {
    let cases: Vec<Case> = serde_json::from_str(include_str!("../oracle/brdf.json")).unwrap();
    let (rho_s, irradiance) = ([1.0, 0.5, 0.25], [3.0, 2.0, 1.0]);
    let mut models = std::collections::HashSet::new();
    for (i, case) in cases.iter().enumerate() {
        let [normal, to_light, view] = [case.normal, case.light, case.view].map(Vec3::from);
        let lobe = by_name(&case.model).unwrap();
        let light = Light::Distant { direction: to_light, irradiance };
        let ray = Ray { origin: 2.0 * view, direction: -view };
        // A unit lobe alone, by half: what the script says of it, with cosine and light.
        let lobe_alone = Material { rho_d: [0.0; 3], rho_s, beta: case.beta };
        let stage = Stage::new(triangles(&[facing(&normal)]), lobe, &[lobe_alone], [0.5, 0.0, 0.0, 0.0], light.clone());
        let found = stage.scene().radiance(&ray).unwrap();
        let cos = normal.dot(&to_light);
        for c in 0..3 {
            let expected = 0.5 * irradiance[c] * cos * rho_s[c] * case.value;
            let apart = (found[c] - expected).abs() / expected.max(1e-200);
            assert!(apart <= 1e-8, "case {i}, {}: {} here, {expected} there", case.model, found[c]);
        }
        // A mixture, as the fit predicts it.
        let other = Material { rho_d: [0.2, 0.3, 0.4], rho_s: [0.1, 0.2, 0.1], beta: 0.3 };
        let materials = [Material { rho_d: [0.6, 0.5, 0.4], ..lobe_alone }, other, matt([0.1, 0.0, 0.9])];
        let stage = Stage::new(triangles(&[facing(&normal)]), lobe, &materials, [0.25, 0.5, 0.125, 0.0], light);
        let sample = Sample {
            light: 0,
            angles: Angles::new(&normal, &to_light, &view),
            irradiance: irradiance.map(|l| l * cos),
            radiance: [0.0; 3],
            variance: [0.0; 3],
        };
        let expected = predict(lobe, &materials, &[0.25, 0.5, 0.125], &sample);
        let found = stage.scene().radiance(&ray).unwrap();
        for c in 0..3 {
            let apart = (found[c] / expected[c] - 1.0).abs();
            assert!(apart <= 1e-9, "case {i}, {}: {} here, the fit says {}", case.model, found[c], expected[c]);
        }
        models.insert(case.model.clone());
    }
    assert_eq!(models.len(), MODELS.len());
}
