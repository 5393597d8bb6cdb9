//! Light intensities from a grey card, against its radiance in closed form.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod balls;

use balls::{STAGE, calibrate};
use rigd::numerics::calibration::lights::card::Card;
use rigd::numerics::calibration::lights::plane::Plane;
use rigd::numerics::geometry::Vec3;
use rigd::numerics::image::{Image, RadianceImage};
use rigd::pipeline::calibration::lights::{CardFrame, LightsCalibration, calibrate_intensity};
use rigd::study::lights::forward::Rig;

/// Five lights that face a card, known exactly.
fn known_lights(rig: &Rig) -> LightsCalibration {
    let mut found = calibrate(&[], 3).unwrap();
    let light = found.lights[0].clone();
    found.lights = (0..5)
        .map(|lamp| {
            let mut light = light.clone();
            light.position_mm = rig.lamps[lamp].into();
            light.covariance_mm2 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            light
        })
        .collect();
    found
}

const BULB: [f64; 3] = [4.0e5, 3.6e5, 3.0e5];

/// The card's plane, its corners in the image, and its radiance under a lamp: Lambert with 18 %.
fn card_frame(rig: &Rig, lamp: usize, shade: impl Fn(f64, f64) -> f64) -> (Plane, [[f64; 2]; 4], RadianceImage) {
    let (center, across) = (Vec3::new(5.0, -10.0, 2000.0), Vec3::new(0.9, 0.0, 0.435_889_894_354_067_4));
    let down = Vec3::y();
    let normal = -across.cross(&down);
    let at = |u: f64, v: f64| center + across * (60.0 * u) + down * (40.0 * v);
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(u, v)| rig.projection.project(&at(u, v)));
    let mut radiance = Image::filled(rig.size.0, rig.size.1, [0.0_f32; 3]);
    for y in 0..rig.size.1 {
        for x in 0..rig.size.0 {
            let ray = rig.projection.ray(x as f64 + 0.5, y as f64 + 0.5).direction;
            let point = ray * (normal.dot(&center) / normal.dot(&ray));
            let (u, v) = ((point - center).dot(&across) / 60.0, (point - center).dot(&down) / 40.0);
            if u.abs() < 1.0 && v.abs() < 1.0 {
                let to_lamp = rig.lamps[lamp] - point;
                let d = to_lamp.norm();
                let factor = 0.18 / std::f64::consts::PI * normal.dot(&to_lamp) / d.powi(3) * shade(u, v);
                radiance.pixels[y * rig.size.0 + x] = BULB.map(|b| (b * factor) as f32);
            }
        }
    }
    let valid = Image::filled(rig.size.0, rig.size.1, true);
    (Plane { point: center, normal }, corners, RadianceImage { radiance, variance: None, valid })
}

fn intensities(tilt: f64, shade: impl Fn(usize, f64, f64) -> f64 + Copy) -> LightsCalibration {
    let rig = &STAGE.rig;
    let (mut plane, corners_px, _) = card_frame(rig, 0, |_, _| 1.0);
    let turn = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::y_axis(), tilt.to_radians());
    plane.normal = turn * plane.normal;
    let card = Card { plane, corners_px, reflectance: 0.18, reflectance_sigma: 0.02 };
    let frames: Vec<CardFrame> = (0..5).map(|light| CardFrame { light, file: format!("c{light}") }).collect();
    let load = |name: &str| {
        let lamp: usize = name[1..].parse().unwrap();
        Ok(card_frame(rig, lamp, |u, v| shade(lamp, u, v)).2)
    };
    calibrate_intensity(&known_lights(rig), &rig.projection, &card, &frames, &load).unwrap()
}

#[test]
fn intensities_come_back_with_the_cards_uncertainty() {
    let found = intensities(0.0, |_, _, _| 1.0);
    // The card turns its left side towards the camera: it faces the lights at negative angles least or most.
    let measured: Vec<_> = found.lights.iter().filter_map(|l| l.intensity.zip(l.intensity_sigma)).collect();
    assert!(measured.len() >= 3, "{:?}", found.lights);
    for (value, sigma) in measured {
        for c in 0..3 {
            assert!((value[c] / BULB[c] - 1.0).abs() < 1e-3, "{value:?}");
            assert!((0.02..0.05).contains(&(sigma[c] / value[c])), "{sigma:?}");
        }
    }
    for light in found.lights.iter().filter(|l| l.intensity.is_none()) {
        assert!(light.warnings[0].contains("turn the card"), "{:?}", light.warnings);
    }
    assert!((found.bulb_intensity.unwrap()[0] / BULB[0] - 1.0).abs() < 1e-3);
    assert!(found.lights.iter().all(|l| l.intensity.is_none() || l.warnings.is_empty()), "{:?}", found.lights);
}

#[test]
fn a_shadow_and_a_tilt_of_the_card_are_named() {
    let whole = intensities(0.0, |lamp, _, _| if lamp == 2 { 0.8 } else { 1.0 });
    let named: Vec<bool> = whole.lights.iter().map(|l| l.warnings.iter().any(|w| w.contains("shadow"))).collect();
    assert_eq!(named, [false, false, true, false, false], "{:?}", whole.lights);

    let part = intensities(0.0, |lamp, u, _| if lamp == 2 && u > 0.4 { 0.5 } else { 1.0 });
    assert!(part.lights[2].warnings.iter().any(|w| w.contains("c2") && w.contains("darker")));

    let tilted = intensities(5.0, |_, _, _| 1.0);
    assert!(
        tilted.warnings.iter().any(|w| w.contains("tilted by 5.") || w.contains("tilted by 4.")),
        "{:?} {:?}",
        tilted.warnings,
        tilted.lights
    );
}
