//! Observations that cannot be fitted, or not as asked, are refused or reduced with the reason; never a panic, never NaN.
#![allow(clippy::unwrap_used, missing_docs)]

use rigd::numerics::brdf::{Material, ward::Ward};
use rigd::numerics::fit::observations::{Observations, Sample};
use rigd::numerics::fit::predict;
use rigd::numerics::geometry::{Angles, Vec3};
use rigd::pipeline::fit::{FitError, FitOptions};
use rigd::pipeline::judged::{Judged, fit_observations};
use std::ops::ControlFlow;

/// Points of a ball of one material under lights at these azimuths, degrees; every light sees every point.
fn ball(points: usize, azimuths: &[f64]) -> Observations {
    let material = Material { rho_d: [0.5, 0.4, 0.3], rho_s: [0.05; 3], beta: 0.2 };
    let mut all = Observations::new(azimuths.len());
    for point in 0..points {
        let turn = 0.7 * point as f64;
        let normal = Vec3::new(0.3 * turn.sin(), 0.3 * turn.cos(), -1.0).normalize();
        let sample = |(light, azimuth): (usize, &f64)| {
            let direction = Vec3::new(azimuth.to_radians().sin(), 0.0, -azimuth.to_radians().cos());
            let angles = Angles::new(&normal, &direction, &-Vec3::z());
            let irradiance = [3.0 * angles.cos_i; 3];
            let mut sample = Sample { light, angles, irradiance, radiance: [0.0; 3], variance: [0.0; 3] };
            sample.radiance = predict(&Ward, &[material], &[1.0], &sample);
            sample
        };
        all.push(point, &azimuths.iter().enumerate().map(sample).collect::<Vec<Sample>>());
    }
    all
}

const ARC: [f64; 5] = [-40.0, -20.0, 0.0, 20.0, 40.0];

fn fit(observations: &Observations, materials: Option<usize>) -> Result<Judged, FitError> {
    let options = FitOptions { materials, ..FitOptions::default() };
    fit_observations(observations, &options, &mut |_| ControlFlow::Continue(()))
}

fn finite(judged: &Judged) -> bool {
    let mixture = &judged.solution.mixture;
    let of = |m: &Material| m.rho_d.iter().chain(&m.rho_s).chain([&m.beta]).all(|v| v.is_finite());
    mixture.materials.iter().all(of) && mixture.gamma.iter().all(|g| g.is_finite() && *g >= 0.0)
}

fn warned(judged: &Judged, words: &str) {
    assert!(finite(judged));
    assert!(judged.warnings.iter().any(|w| w.contains(words)), "{words}: {:?}", judged.warnings);
}

#[test]
fn a_sample_that_no_fit_can_use_is_refused_by_pixel_and_light() {
    type Change = fn(&mut Sample);
    let changes: [Change; 7] = [
        |s| s.radiance[1] = f64::NAN,
        |s| s.radiance[0] = 0.0,
        |s| s.radiance[2] = f64::INFINITY,
        |s| s.radiance[0] = 1e-30,
        |s| s.irradiance = [0.0; 3],
        |s| s.variance[0] = f64::NAN,
        |s| s.angles.cos_i = -0.2,
    ];
    for (index, change) in changes.iter().enumerate() {
        let bad = ball(20, &ARC).changed(1, |point, mut sample| {
            if point == 7 && sample.light == 3 {
                change(&mut sample);
            }
            Some(sample)
        });
        let refusal = fit(&bad.0, None).err().unwrap().to_string();
        assert!(refusal.contains("pixel 7 under light 3"), "{index}: {refusal}");
    }
}

#[test]
fn no_sample_at_all_is_refused() {
    for empty in [Observations::new(0), Observations::new(5)] {
        assert!(fit(&empty, None).err().unwrap().to_string().contains("no sample"));
    }
}

#[test]
fn materials_that_the_points_cannot_carry_are_fewer_with_a_warning() {
    let judged = fit(&ball(3, &ARC), Some(4)).unwrap();
    assert_eq!(judged.task.materials, 3);
    warned(&judged, "cannot carry the 4 materials");
    let judged = fit(&ball(3, &ARC[..1]), Some(4)).unwrap();
    assert_eq!(judged.task.materials, 1);
    warned(&judged, "cannot carry the 4 materials");
}

#[test]
fn one_pixel_under_one_light_gives_a_colour_and_no_lobe() {
    let judged = fit(&ball(1, &ARC[..1]), None).unwrap();
    assert_eq!(judged.task.lobe.name(), "lambert");
    warned(&judged, "cannot carry a lobe");
    warned(&judged, "fewer than three lights");
}

#[test]
fn lights_in_one_place_and_lights_that_see_nothing_are_named() {
    let judged = fit(&ball(20, &[-40.0, 20.0, -40.0, 0.0]), Some(1)).unwrap();
    warned(&judged, "lights 0 and 2 stand in the same place");
    let (behind, _) = ball(20, &ARC).filtered(1, |light| light != 4);
    warned(&fit(&behind, Some(1)).unwrap(), "no sample under light 4");
}

#[test]
fn equal_radiances_give_finite_parameters() {
    let (flat, _) = ball(20, &ARC).changed(1, |_, s| Some(Sample { radiance: [0.3; 3], ..s }));
    assert!(finite(&fit(&flat, None).unwrap()));
}
