//! What observations can carry: samples that no fit can use are refused, and what they cannot determine is not fitted.

use super::fit::FitError;
use crate::numerics::brdf::lambert::Lambert;
use crate::numerics::fit::observations::{MAX_LIGHTS, Observations, Sample};
use crate::numerics::fit::selection::{Wishes, carried};
use crate::numerics::fit::twins::{places, twins};
use crate::numerics::fit::unknowns::Colour;
use rayon::prelude::*;

/// Places of lights below which no light tests what the others say.
pub const FEW_PLACES: usize = 3;

/// Refuses observations without samples, and the first sample that no fit can use.
///
/// # Errors
/// Which sample, what is wrong with it, and what to do.
pub fn check(observations: &Observations) -> Result<(), FitError> {
    check_lights(observations.lights)?;
    if observations.samples() == 0 {
        return Err(FitError::Input("there is no sample to fit: add lit points".to_owned()));
    }
    let faulty = |point: usize| observations.of(point).find_map(|s| Some((point, s, fault(&s, observations.lights)?)));
    let Some((point, sample, fault)) = (0..observations.points()).into_par_iter().find_map_first(faulty) else {
        return Ok(());
    };
    Err(FitError::Input(format!(
        "pixel {} under light {}: {fault}; it has radiance {:?}, variance {:?}, irradiance {:?}, cosines {} and {}: leave the sample out or change its unit",
        observations.pixel[point],
        sample.light,
        sample.radiance,
        sample.variance,
        sample.irradiance,
        sample.angles.cos_i,
        sample.angles.cos_r,
    )))
}

/// What is wrong with a sample under one of so many lights, if anything is.
fn fault(sample: &Sample, lights: usize) -> Option<&'static str> {
    sample.fault().or((sample.light >= lights).then_some("there is no such light"))
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
            "lights {lights} stand in the same place, or cannot be told apart on this object: they are left out together and count as one"
        ));
    }
    if places(observations) < FEW_PLACES {
        warnings.push(format!(
            "lights in fewer than {FEW_PLACES} places: the materials rest on the model being exact, nothing tests it"
        ));
    }
    warnings
}

/// What a reader must know of left-out lights that stand where a fitted one does; `all` are the observations with them.
pub fn left_out_twins(all: &Observations, left_out: &[usize]) -> Option<String> {
    let seen = |(a, b): &(usize, usize)| left_out.contains(a) != left_out.contains(b);
    let pairs: Vec<String> = twins(all).iter().filter(|pair| seen(pair)).map(|(a, b)| format!("{a} and {b}")).collect();
    (!pairs.is_empty()).then(|| {
        format!(
            "of lights {} one is left out and one fitted in the same place: its error proves nothing; leave out both",
            pairs.join(", ")
        )
    })
}
