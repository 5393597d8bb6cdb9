//! Flags: parameters that a scene does not determine must not be called identified, sound ones must be.

use super::measure::{asked, determined};
use crate::numerics::fit::observations::Observations;
use crate::pipeline::judged::fit_observations;
use crate::pipeline::report::{Identified, MaterialReport, Parameter};
use crate::study::scene::{Clipping, Scene};
use rayon::prelude::*;
use std::ops::ControlFlow;

const POINTS: usize = 1500;

/// A scene is sound where the Cramer-Rao bound of every parameter is below this part of it: some textures hold too little of
/// the vein to tell its albedos, and a flag that says so is right.
const SOUND_BOUND: f64 = 0.1;

/// Half angle, radians, below which the regime without highlights has no sample.
const HIDDEN: f64 = 0.6;

/// What the flags said.
pub struct Counts {
    /// Cases in which an undetermined parameter was called identified.
    pub missed: f64,
    /// Of so many.
    pub unsound: f64,
    /// Sound cases in which a parameter was not called identified.
    pub alarms: f64,
    /// Of so many.
    pub sound: f64,
    /// Per regime: name, missed, cases.
    pub regimes: Vec<(&'static str, f64, f64)>,
}

/// What a regime leaves undetermined.
#[derive(Clone, Copy)]
enum Open {
    /// Albedos of the lobe: any mixture of the materials explains the diffuse part.
    Specular,
    /// Albedos of the lobe and its roughness.
    Lobe,
    /// Everything: one of the materials is a ghost.
    All,
}

/// A way to make a scene undetermined.
type Regime = (&'static str, Open, fn(&mut Scene));

const REGIMES: [Regime; 7] = [
    ("grey", Open::Specular, grey),
    ("same hue", Open::Specular, |s| s.materials[1].rho_d = s.materials[0].rho_d.map(|albedo| 0.15 * albedo)),
    ("equal beta", Open::Specular, |s| s.materials[1].beta = s.materials[0].beta),
    ("one material fitted with two", Open::All, |s| s.materials.truncate(1)),
    ("highlights clipped and dropped", Open::Lobe, |s| {
        s.clipping = Some(Clipping { at_medians: 1.5, kept: false });
    }),
    ("no highlight seen", Open::Lobe, |_| {}),
    ("needle below the pixel", Open::Lobe, |s| {
        s.materials[0].beta = 0.012;
        s.materials[1].beta = 0.015;
    }),
];

fn grey(scene: &mut Scene) {
    for material in &mut scene.materials {
        material.rho_d = [material.rho_d.iter().sum::<f64>() / 3.0; 3];
        material.rho_s = [material.rho_s.iter().sum::<f64>() / 3.0; 3];
    }
}

/// Judges `cases` undetermined and as many sound cases.
pub fn flags(cases: u64) -> Counts {
    let unsound: Vec<bool> = (0..cases).into_par_iter().map(|case| misses(case as usize)).collect();
    // Some cases are not sound.
    let tried: Vec<Option<bool>> = (0..cases + cases / 4).into_par_iter().map(alarm).collect();
    let sound: Vec<bool> = tried.into_iter().flatten().take(cases as usize).collect();
    let alarms = sound.iter().filter(|alarm| **alarm).count();
    let of = |regime: usize| unsound.iter().skip(regime).step_by(REGIMES.len());
    let regimes = REGIMES
        .iter()
        .enumerate()
        .map(|(at, regime)| (regime.0, of(at).filter(|missed| **missed).count() as f64, of(at).count() as f64));
    let missed = unsound.iter().filter(|missed| **missed).count();
    let regimes = regimes.collect();
    Counts { missed: missed as f64, unsound: cases as f64, alarms: alarms as f64, sound: sound.len() as f64, regimes }
}

fn misses(case: usize) -> bool {
    let (name, open, change) = REGIMES[case % REGIMES.len()];
    let mut scene = Scene { points: POINTS, ..Scene::marble() };
    change(&mut scene);
    let mut observations = scene.generate(case as u64).observations;
    if name == "no highlight seen" {
        observations = observations.changed(2, |_, s| (s.angles.half_angle() > HIDDEN).then_some(s)).0;
    }
    let trusted = |p: &Parameter| p.identified == Identified::Identified && p.standard_error.is_some();
    judged(&observations).iter().any(|material| {
        let lobe = material.rho_s.iter().any(trusted);
        match open {
            Open::Specular => lobe,
            Open::Lobe => lobe || material.beta.iter().any(trusted),
            Open::All => lobe || material.beta.iter().chain(&material.rho_d).any(trusted),
        }
    })
}

/// Whether a parameter of this case is doubted; none where the case is not sound.
fn alarm(case: u64) -> Option<bool> {
    let mut scene = if case.is_multiple_of(2) { Scene::marble() } else { Scene::wood() };
    scene.points = POINTS;
    let factor = 0.9 + 0.05 * (case % 5) as f64;
    scene.materials.iter_mut().for_each(|material| material.beta *= factor);
    if !determined(&scene, case, SOUND_BOUND) {
        return None;
    }
    let parameters = judged(&scene.generate(case).observations);
    let alarm = parameters.is_empty()
        || parameters.iter().any(|material| {
            material
                .rho_d
                .iter()
                .chain(&material.rho_s)
                .chain(&material.beta)
                .any(|p| p.identified != Identified::Identified)
        });
    Some(alarm)
}

fn judged(observations: &Observations) -> Vec<MaterialReport> {
    let found = fit_observations(observations, &asked(2), &mut |_| ControlFlow::Continue(()));
    found.map_or(Vec::new(), |found| found.materials)
}
