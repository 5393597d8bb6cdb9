//! What observations can carry: samples that no fit can use are refused, and what they cannot determine is not fitted.

use super::fit::FitError;
use crate::numerics::brdf::lambert::Lambert;
use crate::numerics::fit::observations::{MAX_LIGHTS, Observations, Sample};
use crate::numerics::fit::selection::{Wishes, carried};
use crate::numerics::fit::unknowns::Colour;
use rayon::prelude::*;

/// Points at which lights are compared.
const COMPARED: usize = 50;

/// Angles of two lights that agree to this cosine or squared tangent, at every point, are those of one place.
const SAME: f64 = 1e-6;

/// Refuses observations without samples, and the first sample that no fit can use.
///
/// # Errors
/// Which sample, what is wrong with it, and what to do.
pub fn check(observations: &Observations) -> Result<(), FitError> {
    check_lights(observations.lights)?;
    if observations.samples() == 0 {
        return Err(FitError::Input("there is no sample to fit: add lit points".to_owned()));
    }
    let unusable = |point: usize| {
        let sample = observations.of(point).find(|s| !s.usable() || s.light >= observations.lights)?;
        Some((point, sample))
    };
    let Some((point, sample)) = (0..observations.points()).into_par_iter().find_map_first(unusable) else {
        return Ok(());
    };
    Err(FitError::Input(format!(
        "pixel {} under light {}: no fit can use radiance {:?}, variance {:?}, irradiance {:?}, cosines {} and {} (light {} of {}): radiance and irradiance must be from 1e-15 to 1e15 and within 1e12 of each other, variances finite, cosines positive; leave the sample out or change its unit",
        observations.pixel[point],
        sample.light,
        sample.radiance,
        sample.variance,
        sample.irradiance,
        sample.angles.cos_i,
        sample.angles.cos_r,
        sample.light + 1,
        observations.lights
    )))
}

/// `wishes` without what `observations` cannot carry, and what was taken off.
pub fn reduced(observations: &Observations, wishes: Wishes) -> (Wishes, Vec<String>) {
    let (mut wishes, mut warnings) = (wishes, Vec::new());
    let size = format!("{} points with {} samples", observations.points(), observations.samples());
    let fits = |wishes: &Wishes| {
        let colour = wishes.colour.unwrap_or(Colour::Coloured);
        carried(observations, wishes.materials.unwrap_or(1), colour, wishes.gains == Some(true))
    };
    if let Some(asked) = wishes.materials {
        let mut materials = asked;
        while materials > 1 && !fits(&Wishes { materials: Some(materials), ..wishes }) {
            materials -= 1;
        }
        if materials < asked {
            wishes.materials = Some(materials);
            warnings.push(format!("{size} cannot carry the {asked} materials asked for: {materials} fitted"));
        }
    }
    if !fits(&wishes) && wishes.gains == Some(true) {
        wishes.gains = Some(false);
        warnings.push(format!("{size} cannot carry a gain for each light: none fitted"));
    }
    while !fits(&wishes) && wishes.colour != Some(Colour::None) {
        let (colour, what) = match wishes.colour {
            Some(Colour::Achromatic) => (Colour::None, "a lobe: none"),
            _ => (Colour::Achromatic, "a coloured lobe: an achromatic one"),
        };
        wishes.colour = Some(colour);
        warnings.push(format!("{size} cannot carry {what} fitted"));
    }
    if wishes.colour == Some(Colour::None) && wishes.lobe.is_none() {
        wishes.lobe = Some(&Lambert);
    }
    (wishes, warnings)
}

/// Refuses more lights than observations can tell apart.
///
/// # Errors
/// How many there are, and what to do.
pub fn check_lights(lights: usize) -> Result<(), FitError> {
    if lights > MAX_LIGHTS {
        return Err(FitError::Input(format!("{lights} lights: a fit takes at most {MAX_LIGHTS}; split the dataset")));
    }
    Ok(())
}

/// The lights under which there is no sample, in words; none if every light has one.
pub fn dark_lights(observations: &Observations) -> Option<String> {
    let used = observations.lights_in_use();
    let dark: Vec<String> =
        (0..observations.lights).filter(|light| !used.contains(light)).map(|light| light.to_string()).collect();
    let list = dark.join(", ");
    (!dark.is_empty()).then(|| format!("no sample under light {list}: it stands behind the object or was not usable"))
}

/// What a reader must know of the lights: those that stand in one place, and how few they are.
pub fn lights(observations: &Observations) -> Vec<String> {
    let mut warnings = Vec::new();
    let twins = twins(observations);
    if !twins.is_empty() {
        let lights = twins.iter().map(|(a, b)| format!("{a} and {b}")).collect::<Vec<String>>().join(", ");
        warnings.push(format!(
            "lights {lights} stand in the same place: leaving one of them out proves nothing, and they count as one"
        ));
    }
    // Each light that repeats an earlier one stands once in the list.
    if observations.lights_in_use().len().saturating_sub(twins.len()) < 3 {
        warnings.push("fewer than three lights: the materials are not determined".to_owned());
    }
    warnings
}

/// Pairs of lights with the same angles at all of some points that both light; of three in one place, each with the first.
fn twins(observations: &Observations) -> Vec<(usize, usize)> {
    let points: Vec<Vec<Sample>> = {
        let some = observations.subset(COMPARED);
        (0..some.points()).map(|point| some.of(point).collect()).collect()
    };
    let same = |a: usize, b: usize| {
        let mut shared = points.iter().filter_map(|samples| {
            let of = |light| samples.iter().find(|s: &&Sample| s.light == light);
            Some((of(a)?.angles, of(b)?.angles))
        });
        let close = |x: f64, y: f64| (x - y).abs() <= SAME * x.abs().max(1.0);
        let mut any = false;
        let all = shared.all(|(x, y)| {
            any = true;
            close(x.cos_i, y.cos_i) && close(x.tan2_half, y.tan2_half) && close(x.cos_iv, y.cos_iv)
        });
        any && all
    };
    let twin_of = |b: usize| (0..b).find(|&a| same(a, b)).map(|a| (a, b));
    (0..observations.lights).filter_map(twin_of).collect()
}
