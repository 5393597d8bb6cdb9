//! Which parameters the data determine, and why not (METHOD 8).

use super::report::{Identified, MaterialReport, Parameter, shares};
use crate::numerics::brdf::{Lobe, Material};
use crate::numerics::fit::observations::{HIGHLIGHT_HALF_ANGLE, Observations};
use crate::numerics::fit::uncertainty::Uncertainty;
use crate::numerics::fit::{BETA_RANGE, Mixture};

/// A standard error above this part of the value makes a parameter weak, above the value itself unidentified.
const WEAK_ERROR: f64 = 0.25;

/// A weight above this counts as presence of a material.
const PRESENT: f64 = 0.05;

/// What keeps a material's lobe from being determined.
enum LobeTrouble {
    None,
    Weak(String),
    Unidentified(String),
}

/// The materials of a mixture with standard errors, flags and reasons.
pub fn describe(
    lobe: &dyn Lobe,
    mixture: &Mixture,
    uncertainty: &Uncertainty,
    observations: &Observations,
) -> Vec<MaterialReport> {
    let per_material = if lobe.has_lobe() { 7 } else { 3 };
    let share = shares(mixture);
    (0..mixture.materials.len())
        .map(|m| {
            let material = &mixture.materials[m];
            let sigma = |i: usize| uncertainty.alpha[m * per_material + i];
            let twin = twin_of(lobe, &mixture.materials, m);
            let plain = |value: f64, sigma: Option<f64>| parameter(value, sigma, twin.clone());
            let rho_d = (0..3).map(|c| plain(material.rho_d[c], sigma(c))).collect();
            if !lobe.has_lobe() {
                return MaterialReport { share: share[m], rho_d, rho_s: Vec::new(), beta: None };
            }
            let trouble = lobe_trouble(mixture, m, observations);
            let rho_s = (0..3).map(|c| with_trouble(plain(material.rho_s[c], sigma(3 + c)), &trouble)).collect();
            // The unknown is ln(beta): its error is relative.
            let beta = plain(material.beta, sigma(6).map(|s| s * material.beta));
            let beta = with_trouble(beta_flags(beta, material), &trouble);
            MaterialReport { share: share[m], rho_d, rho_s, beta: Some(beta) }
        })
        .collect()
}

fn parameter(value: f64, standard_error: Option<f64>, twin: Option<String>) -> Parameter {
    let (identified, reason) = match (standard_error, twin) {
        (_, Some(reason)) => (Identified::Unidentified, Some(reason)),
        (None, None) => (Identified::Weak, Some("it stands at the edge of its permitted range".to_owned())),
        (Some(error), None) if error > value.abs() => {
            (Identified::Unidentified, Some("its standard error exceeds its value".to_owned()))
        }
        (Some(error), None) if error > WEAK_ERROR * value.abs() => {
            (Identified::Weak, Some(format!("its standard error is {:.0} % of its value", 100.0 * error / value.abs())))
        }
        (Some(_), None) => (Identified::Identified, None),
    };
    Parameter { value, standard_error, identified, reason }
}

fn with_trouble(mut parameter: Parameter, trouble: &LobeTrouble) -> Parameter {
    let (identified, reason) = match trouble {
        LobeTrouble::None => return parameter,
        LobeTrouble::Weak(reason) => (Identified::Weak, reason),
        LobeTrouble::Unidentified(reason) => (Identified::Unidentified, reason),
    };
    if parameter.identified != Identified::Unidentified {
        parameter.identified = identified;
        parameter.reason = Some(reason.clone());
    }
    parameter
}

fn beta_flags(mut beta: Parameter, material: &Material) -> Parameter {
    if material.rho_s.iter().all(|&s| s <= 0.0) {
        beta.identified = Identified::Unidentified;
        beta.reason = Some("the material has no specular part".to_owned());
    } else if material.beta <= BETA_RANGE[0] * 1.0001 || material.beta >= BETA_RANGE[1] * 0.9999 {
        beta.identified = Identified::Weak;
        beta.reason = Some(format!("it stands at the edge of its range, {} to {}", BETA_RANGE[0], BETA_RANGE[1]));
    }
    beta
}

/// Another material with the same hue and lobe: the two cannot be told apart.
fn twin_of(lobe: &dyn Lobe, materials: &[Material], m: usize) -> Option<String> {
    let unit = |rgb: [f64; 3]| {
        let norm = rgb.iter().map(|v| v * v).sum::<f64>().sqrt();
        rgb.map(|v| v / norm.max(f64::MIN_POSITIVE))
    };
    let same = |a: &Material, b: &Material| {
        let cosine: f64 = (0..3).map(|c| unit(a.rho_d)[c] * unit(b.rho_d)[c]).sum();
        let same_lobe = !lobe.has_lobe() || (a.beta / b.beta).ln().abs() < 0.05;
        cosine > 0.9998 && same_lobe
    };
    materials
        .iter()
        .enumerate()
        .find(|(other, material)| *other != m && same(material, &materials[m]))
        .map(|(other, _)| format!("it has the same hue and lobe as material {}", other + 1))
}

fn lobe_trouble(mixture: &Mixture, m: usize, observations: &Observations) -> LobeTrouble {
    let reach = 2.0 * mixture.materials[m].beta;
    let near = (0..observations.points())
        .filter(|&point| mixture.weights_of(point)[m] > PRESENT)
        .flat_map(|point| observations.of(point))
        .filter(|sample| sample.angles.tan2_half.sqrt() < reach)
        .count();
    if near == 0 {
        return LobeTrouble::Unidentified("no sample within 2 beta of the half vector".to_owned());
    }
    let highlights = observations.all().filter(|s| s.angles.half_angle() < HIGHLIGHT_HALF_ANGLE).count();
    let lost = observations.unusable_highlight;
    if highlights == 0 && lost > 0 {
        return LobeTrouble::Unidentified("every highlight sample is clipped or unusable".to_owned());
    }
    if lost * 5 > highlights + lost {
        let percent = 100 * lost / (highlights + lost);
        return LobeTrouble::Weak(format!("{percent} % of the highlight samples are clipped or unusable"));
    }
    LobeTrouble::None
}
