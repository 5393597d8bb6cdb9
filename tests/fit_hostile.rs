//! Observations that cannot be fitted, or not as asked, are refused or reduced with the reason; never a panic, never NaN.
#![allow(clippy::unwrap_used, missing_docs)]

use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, Normal};
use rigd::numerics::brdf::{Material, ward::Ward};
use rigd::numerics::fit::observations::{Observations, Sample};
use rigd::numerics::fit::predict;
use rigd::numerics::fit::unknowns::Colour;
use rigd::numerics::geometry::{Angles, Projection, Vec3};
use rigd::pipeline::fit::{FitError, FitOptions};
use rigd::pipeline::judged::{Judged, fit_observations};
use rigd::pipeline::report::{Identified, MaterialReport};
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
    warned(&judged, "lights in fewer than 3 places");
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

fn flags(judged: &Judged) -> Vec<Identified> {
    let of = |m: &MaterialReport| -> Vec<Identified> {
        m.rho_d.iter().chain(&m.rho_s).chain(&m.beta).map(|parameter| parameter.identified).collect()
    };
    judged.materials.iter().flat_map(of).collect()
}

/// Three lights in one place are one light: nothing is identified.
#[test]
fn lights_in_one_place_tell_no_more_than_one() {
    let judged = fit(&ball(60, &[20.0; 3]), Some(1)).unwrap();
    warned(&judged, "lights in fewer than 3 places");
    assert!(flags(&judged).iter().all(|flag| *flag != Identified::Identified), "{:?}", judged.materials);
    let lobe = judged.materials[0].rho_s.iter().chain(&judged.materials[0].beta);
    assert!(lobe.into_iter().all(|parameter| parameter.identified == Identified::Unidentified));
}

/// Too few lights to leave one out: then BIC says that a second material is a ghost.
#[test]
fn a_ghost_is_named_where_no_light_can_be_left_out() {
    let mut rng = StdRng::seed_from_u64(3);
    let noise = Normal::new(1.0, 0.01).unwrap();
    let mut noisy = |s: Sample| Sample { radiance: s.radiance.map(|i| i * noise.sample(&mut rng)), ..s };
    let (observations, _) = ball(80, &ARC[1..4]).changed(1, |_, s| Some(noisy(s)));
    let judged = fit(&observations, Some(2)).unwrap();
    warned(&judged, "one of the materials is a ghost");
    assert!(flags(&judged).iter().all(|flag| *flag == Identified::Unidentified), "{:?}", judged.materials);
}

/// Without noise every further freedom still lowers the error, from nothing to less: none is needed.
#[test]
fn exact_data_are_not_over_modelled() {
    let judged = fit(&ball(300, &ARC), None).unwrap();
    assert_eq!((judged.task.materials, judged.task.lobe.name()), (1, "ward"));
    let dull = ball(300, &ARC).changed(1, |_, s| Some(Sample { radiance: s.irradiance.map(|e| 0.1 * e), ..s }));
    let judged = fit(&dull.0, None).unwrap();
    assert_eq!((judged.task.materials, judged.task.colour), (1, Colour::None));
}

/// One pixel a thousand times too bright sets the scale of the weights: it is named, and hides no lobe.
#[test]
fn a_hot_pixel_is_named() {
    let hot = |point: usize, s: Sample| {
        let factor = if point == 5 { 1000.0 } else { 1.0 };
        Sample { radiance: s.radiance.map(|i| factor * i), ..s }
    };
    let (observations, _) = ball(300, &ARC).changed(1, |point, s| Some(hot(point, s)));
    let judged = fit(&observations, Some(1)).unwrap();
    warned(&judged, "its scale rests on pixel 5 alone");
    let beta = judged.materials[0].beta.as_ref().unwrap();
    assert!(beta.reason.as_ref().is_none_or(|reason| !reason.contains("too few samples")), "{beta:?}");
}

/// The same picture in all three channels tells no more than in one: errors are larger than those of three pictures by the
/// root of three.
#[test]
fn channels_that_repeat_one_another_count_once() {
    let mut rng = StdRng::seed_from_u64(7);
    let noise = Normal::new(1.0, 0.02).unwrap();
    let clean = ball(400, &ARC).changed(1, |_, s| Some(Sample { radiance: [s.radiance[0]; 3], ..s })).0;
    let mut noisy = |grey: bool| {
        let mut of = |s: Sample| {
            let factors: [f64; 3] = std::array::from_fn(|_| noise.sample(&mut rng));
            let factor = |c: usize| if grey { factors[0] } else { factors[c] };
            Sample { radiance: std::array::from_fn(|c| s.radiance[c] * factor(c)), ..s }
        };
        clean.changed(1, |_, s| Some(of(s))).0
    };
    let (grey, coloured) = (noisy(true), noisy(false));
    assert_eq!((grey.channels(), coloured.channels()), (1, 3));
    let options = FitOptions {
        materials: Some(1),
        model: "ward".to_owned(),
        lobe: "achromatic".to_owned(),
        ..FitOptions::default()
    };
    let sigma = |observations: &Observations| {
        let judged = fit_observations(observations, &options, &mut |_| ControlFlow::Continue(())).unwrap();
        judged.materials[0].beta.as_ref().unwrap().standard_error.unwrap()
    };
    let ratio = sigma(&grey) / sigma(&coloured);
    assert!((ratio / 3_f64.sqrt() - 1.0).abs() < 0.15, "{ratio}");
}

/// Coefficients that fold the image have no inverse; those of a lens do.
#[test]
fn a_distortion_without_inverse_is_seen() {
    let camera = |k1: f64, k2: f64| Projection::Pinhole {
        focal_px: [400.0; 2],
        principal_px: [100.0, 80.0],
        distortion: [k1, k2, 0.001, -0.002, 0.0],
    };
    assert_eq!(camera(-0.2, 0.05).lost_pixel(200, 160), None);
    for k1 in [1e4, -3e3, 1e300, f64::NAN] {
        assert!(camera(k1, 0.0).lost_pixel(200, 160).is_some(), "{k1}");
    }
}

/// The errors of refined normals are not those of a relit result, which knows the given ones only.
#[test]
fn refined_normals_are_said_to_be_lost() {
    let options = FitOptions { materials: Some(1), solver: "normals".to_owned(), ..FitOptions::default() };
    let mut observations = ball(60, &ARC);
    observations.set_azimuths(|point, sample| (point + 3 * sample.light) as f64);
    let judged = fit_observations(&observations, &options, &mut |_| ControlFlow::Continue(())).unwrap();
    warned(&judged, "errors are about refined normals");
}
