//! Which parameters the data determine, and why not.

use super::inputs::FEW_PLACES;
use super::report::{Identified, MaterialReport, Parameter, shares};
use crate::numerics::brdf::Material;
use crate::numerics::fit::kernel::PER_MATERIAL;
use crate::numerics::fit::observations::{HIGHLIGHT_HALF_ANGLE, Observations};
use crate::numerics::fit::solver::Task;
use crate::numerics::fit::uncertainty::Uncertainty;
use crate::numerics::fit::unknowns::Colour;
use crate::numerics::fit::{BETA_RANGE, Mixture};

/// A standard error above this part of the value makes a parameter weak, above the value itself unidentified.
const WEAK_ERROR: f64 = 0.25;

/// A weight above this part of the material's [`FEW_POINTS`]-th largest counts as presence.
const PRESENT: f64 = 0.05;

/// The largest weight stands alone when it exceeds the [`FEW_POINTS`]-th largest by this factor.
const ALONE: f64 = 5.0;

/// Samples near the half vector below which a lobe is narrower than the points lie apart.
const LEAST_NEAR: usize = 60;

/// Reduced chi^2 above which the model does not describe the data: standard errors no longer hold.
pub const MISFIT: f64 = 2.0;

/// Cosine between two diffuse colours above which they have the same hue (2 degrees).
const SAME_HUE: f64 = 0.9994;

/// Difference of ln(beta) below which two lobes are the same.
const SAME_LOBE: f64 = 0.1;

/// Points below which nothing tells a model that fits from one that is right.
pub const FEW_POINTS: usize = 20;

/// What is known of a fit beside its parameters.
#[derive(Clone, Copy, Debug)]
pub struct Evidence {
    /// Points fitted to.
    pub points: usize,
    /// Materials fitted.
    pub materials: usize,
    /// Places in which the lights stand.
    pub places: usize,
    /// False when the solver was still gaining.
    pub converged: bool,
    /// True when one material fewer serves as well.
    pub superfluous: bool,
    /// Chi^2 over degrees of freedom.
    pub reduced_chi2: f64,
    /// True when several materials were found with weights kept non-negative: that biases them by more than their standard
    /// errors.
    pub bounded: bool,
}

/// A reason to trust a parameter less.
type Doubt = (Identified, String);

/// The materials of a mixture with standard errors, flags and reasons.
pub fn describe(
    task: &Task,
    mixture: &Mixture,
    uncertainty: &Uncertainty,
    observations: &Observations,
    evidence: &Evidence,
) -> Vec<MaterialReport> {
    let share = shares(mixture);
    let general = general_doubt(evidence);
    let seen = Seen::of(observations, evidence.places);
    (0..mixture.materials.len())
        .map(|m| {
            let material = &mixture.materials[m];
            let twin = twin_of(task, &mixture.materials, m);
            let lobe = lobe_doubt(mixture, m, observations, &seen);
            let parameter = |k: usize, value: f64| {
                let index = m * PER_MATERIAL + k;
                // The unknown is ln(beta): its error is relative.
                let scale = if k == 6 { 1.0 } else { value };
                let mut found = plain(scale, uncertainty.alpha[index], uncertainty.loose[index]);
                found.value = value;
                if k < 3 && uncertainty.alpha[index].is_none() && is_gauge(material, k) {
                    found.identified = Identified::Identified;
                    found.reason = Some("it fixes the gauge: what a weight of 1 means".to_owned());
                }
                let of_lobe = if k < 3 { &None } else { &lobe };
                for doubt in [&general, &twin, of_lobe].into_iter().flatten() {
                    lower(&mut found, doubt);
                }
                found
            };
            let rho_d = (0..3).map(|c| parameter(c, material.rho_d[c])).collect();
            if task.colour == Colour::None || !task.lobe.has_lobe() {
                return MaterialReport { share: share[m], rho_d, rho_s: Vec::new(), beta: None };
            }
            let mut rho_s: Vec<Parameter> = (0..3).map(|c| parameter(3 + c, material.rho_s[c])).collect();
            if let Some(doubt) = beta_edge(material) {
                rho_s.iter_mut().for_each(|albedo| lower(albedo, &doubt));
            }
            let mut beta = parameter(6, material.beta);
            beta.standard_error = uncertainty.alpha[m * PER_MATERIAL + 6].map(|sigma| sigma * material.beta);
            if let Some(doubt) = beta_doubt(material, uncertainty.alpha[m * PER_MATERIAL + 6]) {
                lower(&mut beta, &doubt);
            }
            MaterialReport { share: share[m], rho_d, rho_s, beta: Some(beta) }
        })
        .collect()
}

/// A parameter judged by its standard error alone.
fn plain(value: f64, standard_error: Option<f64>, loose: f64) -> Parameter {
    let (identified, reason) = match standard_error {
        _ if loose > 0.5 => {
            (Identified::Unidentified, Some("the data do not tell it from other parameters".to_owned()))
        }
        None => (Identified::Weak, Some("it stands at the edge of its permitted range".to_owned())),
        Some(error) if error > value.abs() => {
            (Identified::Unidentified, Some("its standard error exceeds its value".to_owned()))
        }
        Some(error) if error > WEAK_ERROR * value.abs() => {
            (Identified::Weak, Some(format!("its standard error is {:.0} % of its value", 100.0 * error / value.abs())))
        }
        Some(_) => (Identified::Identified, None),
    };
    Parameter { value, standard_error, identified, reason }
}

fn is_gauge(material: &Material, channel: usize) -> bool {
    material.rho_d.iter().all(|&other| material.rho_d[channel] >= other)
}

fn rank(identified: Identified) -> usize {
    match identified {
        Identified::Identified => 0,
        Identified::Weak => 1,
        Identified::Unidentified => 2,
    }
}

/// Lowers the flag of a parameter, never raises it.
fn lower(parameter: &mut Parameter, (identified, reason): &Doubt) {
    if rank(*identified) > rank(parameter.identified) {
        parameter.identified = *identified;
        parameter.reason = Some(reason.clone());
    }
}

/// What makes every parameter doubtful.
fn general_doubt(evidence: &Evidence) -> Option<Doubt> {
    if evidence.points < FEW_POINTS {
        let reason = format!("fitted to fewer than {FEW_POINTS} points: any model fits so few");
        return Some((Identified::Unidentified, reason));
    }
    if evidence.superfluous {
        let reason = "the data do not need this many materials: the split is not determined";
        return Some((Identified::Unidentified, reason.to_owned()));
    }
    if evidence.places < 2 && evidence.materials > 1 {
        return Some((Identified::Unidentified, "one light does not tell materials from weights".to_owned()));
    }
    if evidence.places < FEW_PLACES {
        let reason = format!("lights in fewer than {FEW_PLACES} places: it rests on the model being exact");
        return Some((Identified::Weak, reason));
    }
    if !evidence.converged {
        return Some((Identified::Weak, "the solver was still gaining at its iteration limit".to_owned()));
    }
    if evidence.bounded {
        let reason = "found with weights kept non-negative: it may be off by some percent, several standard errors";
        return Some((Identified::Weak, reason.to_owned()));
    }
    let times = evidence.reduced_chi2.sqrt();
    (evidence.reduced_chi2 > MISFIT).then(|| {
        (Identified::Weak, format!("residuals are {times:.1} times the noise: the model does not describe the data"))
    })
}

/// What a roughness at the edge of its range makes of the whole lobe.
fn beta_edge(material: &Material) -> Option<Doubt> {
    let within = BETA_RANGE[0] * 1.0001..BETA_RANGE[1] * 0.9999;
    (!within.contains(&material.beta)).then(|| {
        let reason = format!("beta stands at the edge of its range, {} to {}", BETA_RANGE[0], BETA_RANGE[1]);
        (Identified::Unidentified, reason)
    })
}

fn beta_doubt(material: &Material, error: Option<f64>) -> Option<Doubt> {
    if material.rho_s.iter().all(|&s| s <= 0.0) {
        return Some((Identified::Unidentified, "the material has no specular part".to_owned()));
    }
    if let Some(doubt) = beta_edge(material) {
        return Some(doubt);
    }
    let error = error.filter(|sigma| *sigma > WEAK_ERROR)?;
    Some((Identified::Weak, format!("the standard error of ln(beta) is {error:.2}")))
}

/// Another material that cannot be told from this one.
fn twin_of(task: &Task, materials: &[Material], m: usize) -> Option<Doubt> {
    let cosine = |a: &Material, b: &Material| {
        let dot = |x: &[f64; 3], y: &[f64; 3]| (0..3).map(|c| x[c] * y[c]).sum::<f64>();
        dot(&a.rho_d, &b.rho_d) / (dot(&a.rho_d, &a.rho_d) * dot(&b.rho_d, &b.rho_d)).sqrt().max(f64::MIN_POSITIVE)
    };
    let lobes = task.colour != Colour::None && task.lobe.has_lobe();
    let others = materials.iter().enumerate().filter(|(other, _)| *other != m);
    let mut doubt = None;
    for (other, material) in others {
        let name = other + 1;
        if cosine(material, &materials[m]) > SAME_HUE {
            let reason =
                format!("it has the same hue as material {name}: only products of weight and albedo are determined");
            return Some((Identified::Unidentified, reason));
        }
        if lobes && (material.beta / materials[m].beta).ln().abs() < SAME_LOBE {
            let reason =
                format!("it has the same roughness as material {name}: any mixture of the two explains the data");
            doubt = Some((Identified::Unidentified, reason));
        }
    }
    doubt
}

/// The [`FEW_POINTS`]-th largest weight of a material, or the smallest where it has fewer: single points may be wrong.
fn common_peak(mixture: &Mixture, m: usize) -> f64 {
    let mut weights: Vec<f64> = (0..mixture.gamma.len() / mixture.materials.len().max(1))
        .map(|point| mixture.weights_of(point)[m])
        .filter(|&weight| weight > 0.0)
        .collect();
    let nth = FEW_POINTS.min(weights.len()).saturating_sub(1);
    if weights.is_empty() {
        return 0.0;
    }
    *weights.select_nth_unstable_by(nth, |a, b| b.total_cmp(a)).1
}

/// A warning for every material whose scale rests on a single point.
pub fn lone_peaks(mixture: &Mixture, observations: &Observations) -> Vec<String> {
    let lone = |m: usize| {
        let weight = |point: usize| mixture.weights_of(point)[m];
        let at = (0..observations.points()).max_by(|&a, &b| weight(a).total_cmp(&weight(b)))?;
        let times = weight(at) / common_peak(mixture, m);
        (times.is_finite() && times > ALONE).then(|| {
            let (name, pixel) = (m + 1, observations.pixel[at]);
            format!(
                "material {name}: its scale rests on pixel {pixel} alone, whose weight is {times:.0} times that of the rest: mask that pixel if it is hot or not of the object"
            )
        })
    };
    (0..mixture.materials.len()).filter_map(lone).collect()
}

/// What was seen of lobes at all.
struct Seen {
    places: usize,
    highlights: usize,
}

impl Seen {
    fn of(observations: &Observations, places: usize) -> Self {
        let highlights = observations.all().filter(|s| s.angles.half_angle() < HIGHLIGHT_HALF_ANGLE).count();
        Self { places, highlights }
    }
}

/// What keeps the lobe of material `m` from being determined.
fn lobe_doubt(mixture: &Mixture, m: usize, observations: &Observations, seen: &Seen) -> Option<Doubt> {
    let reach = 2.0 * mixture.materials[m].beta;
    let present = PRESENT * common_peak(mixture, m);
    let near = (0..observations.points())
        .filter(|&point| mixture.weights_of(point)[m] > present)
        .flat_map(|point| observations.of(point))
        .filter(|sample| sample.angles.tan2_half.sqrt() < reach)
        .count();
    if seen.places < 2 {
        let reason = "one light does not tell a lobe from the weights";
        return Some((Identified::Unidentified, reason.to_owned()));
    }
    if near == 0 {
        return Some((Identified::Unidentified, "no sample within 2 beta of the half vector".to_owned()));
    }
    if near < LEAST_NEAR {
        let reason = format!("too few samples within 2 beta of the half vector to tell the lobe: {near}");
        return Some((Identified::Weak, reason));
    }
    let (highlights, lost) = (seen.highlights, observations.unusable_highlight);
    if highlights == 0 && lost > 0 {
        return Some((Identified::Unidentified, "every highlight sample is clipped or unusable".to_owned()));
    }
    if lost * 5 > highlights + lost {
        let percent = 100 * lost / (highlights + lost);
        let reason =
            format!("{percent} % of the highlight samples are clipped or unusable: the lobe's peak was not seen");
        return Some((Identified::Unidentified, reason));
    }
    if lost * 50 > highlights + lost {
        let percent = 100.0 * lost as f64 / (highlights + lost) as f64;
        return Some((Identified::Weak, format!("{percent:.0} % of the highlight samples are clipped or unusable")));
    }
    None
}
