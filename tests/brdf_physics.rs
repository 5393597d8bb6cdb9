//! What every lobe must obey: its own slope, reciprocity, finite values, and energy, by quadrature over the hemisphere.

#![allow(clippy::unwrap_used, missing_docs)]

use rand::{RngExt, SeedableRng, rngs::StdRng};
use rigd::numerics::brdf::{Lobe, MODELS, by_name};
use rigd::numerics::geometry::{Angles, Vec3};
use std::f64::consts::{FRAC_PI_2, PI};

fn lobe(name: &str) -> &'static dyn Lobe {
    by_name(name).unwrap()
}

/// A direction above the surface (normal +z), polar angle up to 85 degrees.
fn direction(random: &mut StdRng) -> Vec3 {
    let (cos, azimuth) = (random.random_range(0.087_f64..1.0), random.random_range(0.0..2.0 * PI));
    let sin = (1.0 - cos * cos).sqrt();
    Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos)
}

#[test]
fn slopes_are_those_of_the_values() {
    let mut random = StdRng::seed_from_u64(1);
    for model in MODELS {
        let mut seen = 0;
        for _ in 0..300 {
            let angles = Angles::new(&Vec3::z(), &direction(&mut random), &direction(&mut random));
            let beta = random.random_range(0.1..0.9);
            let value = |log_step: f64| model.value_and_slope(&angles, beta * log_step.exp()).0;
            let (here, slope) = model.value_and_slope(&angles, beta);
            // Further out the exponential bends too much within a step for a difference to follow.
            if here < 1e-9 {
                continue;
            }
            let difference = (value(1e-5) - value(-1e-5)) / 2e-5;
            assert!((slope - difference).abs() <= 1e-6 * here.max(difference.abs()), "{}: {angles:?}", model.name());
            seen += 1;
        }
        assert!(seen > 100 || !model.has_lobe(), "{}: only {seen} values tell anything", model.name());
    }
}

#[test]
fn light_and_view_may_be_exchanged() {
    let mut random = StdRng::seed_from_u64(2);
    for model in MODELS {
        for _ in 0..300 {
            let (light, view) = (direction(&mut random), direction(&mut random));
            let there = model.value_and_slope(&Angles::new(&Vec3::z(), &light, &view), 0.3).0;
            let back = model.value_and_slope(&Angles::new(&Vec3::z(), &view, &light), 0.3).0;
            assert!((there - back).abs() <= 1e-12 * there.abs(), "{}: {there} and {back}", model.name());
        }
    }
}

#[test]
fn every_value_is_finite_and_not_negative() {
    let cosines = [f64::MIN_POSITIVE, 1e-100, 1e-9, 1e-4, 0.3, 1.0];
    let tangents = [0.0, f64::MIN_POSITIVE, 1e-12, 1.0, 1e9, 1e300, f64::INFINITY];
    for model in MODELS {
        for cos_i in cosines {
            for cos_r in cosines {
                for tan2_half in tangents {
                    for cos_iv in [-1.0, 0.0, 1.0 + 1e-15] {
                        let angles = Angles { cos_i, cos_r, tan2_half, cos_iv };
                        for beta in [0.005, 0.1, 0.95] {
                            let (value, slope) = model.value_and_slope(&angles, beta);
                            let sound = value.is_finite() && value >= 0.0 && slope.is_finite();
                            assert!(sound, "{} at {angles:?}, {beta}: {value}, {slope}", model.name());
                        }
                        let fixed = model.fixed(&angles);
                        // Samples may be stored in single precision.
                        assert!((fixed.scale as f32).is_finite() && (fixed.exponent as f32).is_finite());
                    }
                }
            }
        }
    }
}

/// Part of the light that a lobe of rho_s = 1 reflects into all directions, seen from `view_degrees`; the lobe is divided
/// by `gain`. Midpoint rule over polar angle and half the azimuth: the scene is symmetric.
fn albedo(model: &dyn Lobe, beta: f64, view_degrees: f64, gain: fn(&Angles) -> f64) -> f64 {
    const STEPS: usize = 400;
    let view_angle = view_degrees.to_radians();
    let view = Vec3::new(view_angle.sin(), 0.0, view_angle.cos());
    let (polar_step, azimuth_step) = (FRAC_PI_2 / STEPS as f64, PI / STEPS as f64);
    let mut sum = 0.0;
    for i in 0..STEPS {
        let (sin, cos) = ((i as f64 + 0.5) * polar_step).sin_cos();
        for j in 0..STEPS {
            let azimuth = (j as f64 + 0.5) * azimuth_step;
            let light = Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos);
            let angles = Angles::new(&Vec3::z(), &light, &view);
            sum += model.value_and_slope(&angles, beta).0 / gain(&angles) * cos * sin;
        }
    }
    2.0 * sum * polar_step * azimuth_step
}

fn no_gain(_: &Angles) -> f64 {
    1.0
}

/// Schlick's reflectance with F0 = 0.04 over that at normal incidence.
fn fresnel_gain(angles: &Angles) -> f64 {
    (0.04 + 0.96 * (1.0 - ((1.0 + angles.cos_iv) / 2.0).sqrt()).powi(5)) / 0.04
}

#[test]
fn wards_albedo_is_the_published_one() {
    // Albedo over rho_s at 0, 30, 60 and 75 degrees, computed independently of this program.
    for (beta, expected) in
        [(0.1, [0.971, 0.842, 0.489, 0.259]), (0.2, [0.895, 0.777, 0.459, 0.269]), (0.3, [0.794, 0.691, 0.422, 0.280])]
    {
        for (degrees, expected) in [0.0, 30.0, 60.0, 75.0].into_iter().zip(expected) {
            let found = albedo(lobe("ward"), beta, degrees, no_gain);
            assert!((found - expected).abs() < 1e-3, "beta {beta}, {degrees} degrees: {found}, not {expected}");
        }
    }
}

#[test]
fn no_bounded_model_sends_out_more_than_comes_in() {
    for (name, gain) in [
        ("torrance-sparrow", no_gain as fn(&Angles) -> f64),
        ("cook-torrance", fresnel_gain),
        ("ward-duer", no_gain),
        ("lafortune", no_gain),
        ("ggx", fresnel_gain),
    ] {
        for beta in [0.1, 0.2, 0.4, 0.8] {
            for degrees in [0.0, 30.0, 60.0, 75.0, 85.0] {
                let found = albedo(lobe(name), beta, degrees, gain);
                assert!((0.0..1.005).contains(&found), "{name}, beta {beta}, {degrees} degrees: {found}");
            }
        }
    }
}

#[test]
fn specular_albedo_is_the_albedo_at_normal_incidence_of_a_smooth_surface() {
    for model in MODELS.iter().filter(|model| model.has_lobe()) {
        let found = albedo(*model, 0.06, 0.0, no_gain);
        assert!((0.97..1.005).contains(&found), "{}: {found}", model.name());
    }
}

#[test]
fn unmasked_lobes_grow_at_grazing_view() {
    assert!(albedo(lobe("blinn-phong"), 0.3, 85.0, no_gain) > 1.2);
    assert!(albedo(lobe("ward"), 0.3, 89.95, no_gain) > 1.0);
}
