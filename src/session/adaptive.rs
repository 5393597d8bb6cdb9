//! No more than the scene needs: what an adaptive session may leave out, what it decided, and what that saved and cost.

use super::plan::PlannedExposure;
pub use crate::pipeline::report::{LightsReached, Saved};
use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// Stations that are shot before a fit says for the first time whether they suffice, and how many more before it is asked again.
pub const FIRST_JUDGED: usize = 7;
const BATCH: usize = 2;

/// What a session may leave out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Adaptive {
    /// Exposures that would add no information, from the second station on.
    pub exposures: bool,
    /// Light stations, once those before them meet these targets; the stations are then shot in an order that is always well spread. None
    /// is left out without targets.
    #[serde(deserialize_with = "object", skip_serializing_if = "Option::is_none")]
    pub lights: Option<LightTargets>,
}

impl Default for Adaptive {
    fn default() -> Self {
        Self { exposures: true, lights: None }
    }
}

/// When light stations suffice.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LightTargets {
    /// Mean relative error on lights that the fit left out: at most this.
    #[schema(exclusive_minimum = 0, maximum = 1)]
    pub left_out_error: f64,
    /// Standard error of every parameter of the materials, relative to its value: at most this.
    #[schema(exclusive_minimum = 0, maximum = 1)]
    pub parameter_error: f64,
}

/// An object or null and nothing else: a list would be taken for the values of its keys in their order.
pub(super) fn object<'de, T: DeserializeOwned, D: Deserializer<'de>>(from: D) -> Result<Option<T>, D::Error> {
    let value = Value::deserialize(from)?;
    if !(value.is_object() || value.is_null()) {
        return Err(D::Error::custom("an object is needed, or null"));
    }
    Option::deserialize(value).map_err(D::Error::custom)
}

impl Adaptive {
    /// Targets that none can be.
    pub fn check(&self, reasons: &mut Vec<String>) {
        let Some(LightTargets { left_out_error, parameter_error }) = self.lights else { return };
        for (key, target) in [("left_out_error", left_out_error), ("parameter_error", parameter_error)] {
            if !(target > 0.0 && target <= 1.0) {
                reasons.push(format!("adaptive.lights.{key}: {target}: write more than 0 and at most 1"));
            }
        }
    }

    /// True when a fit is to say, before this station is shot, whether those before it suffice.
    pub fn judges_before(&self, station: usize) -> bool {
        self.lights.is_some() && station >= FIRST_JUDGED && (station - FIRST_JUDGED).is_multiple_of(BATCH)
    }
}

/// The angles (degrees) in an order in which those up to any of them are well spread: the first, then always the one farthest from all
/// before it.
pub fn spread(angles_deg: &[f64]) -> Vec<f64> {
    let mut left = angles_deg.to_vec();
    let mut order: Vec<f64> = left.drain(..left.len().min(1)).collect();
    while !left.is_empty() {
        let gap = |angle: &f64| order.iter().map(|other| (other - angle).abs()).fold(f64::INFINITY, f64::min);
        let farthest = (1..left.len()).fold(0, |best, i| if gap(&left[i]) > gap(&left[best]) { i } else { best });
        order.push(left.remove(farthest));
    }
    order
}

/// What a fit said of the stations shot so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Weighed {
    /// Mean relative error on left-out lights; none where no light can be left out.
    pub left_out_error: Option<f64>,
    /// The same on their highlights.
    pub left_out_highlight_error: Option<f64>,
    /// Largest relative standard error of a parameter; none where the data do not determine one.
    pub parameter_error: Option<f64>,
}

impl Weighed {
    /// True when the targets are met.
    pub fn meets(&self, targets: &LightTargets) -> bool {
        let within = |error: Option<f64>, target: f64| error.is_some_and(|error| error <= target);
        within(self.left_out_error, targets.left_out_error) && within(self.parameter_error, targets.parameter_error)
    }
}

/// A bracket that was called complete with some of its exposures: the fields of its `exposures.enough` record.
#[derive(Clone, Debug, Deserialize)]
struct Metered {
    station: usize,
    bracket: usize,
    exposures: Vec<usize>,
    sigma: f64,
    sigma_whole: f64,
}

/// Stations that were judged by a fit: the fields of a `lights.judged` record.
#[derive(Clone, Debug, Deserialize)]
struct JudgedLights {
    stations: usize,
    enough: bool,
    #[serde(flatten)]
    weighed: Weighed,
}

/// The decisions of a session, as its journal tells them.
#[derive(Clone, Debug, Default)]
pub struct Decisions {
    metered: BTreeMap<usize, Metered>,
    lights: Option<JudgedLights>,
}

impl Decisions {
    /// Takes a record of a decision into account.
    pub fn apply(&mut self, record: &Value) {
        match record["type"].as_str() {
            Some("exposures.enough") => {
                if let Ok(metered) = Metered::deserialize(record) {
                    self.metered.insert(metered.station, metered);
                }
            }
            Some("lights.judged") => self.lights = JudgedLights::deserialize(record).ok(),
            _ => {}
        }
    }

    /// A frame of this bracket was committed: what was decided of an earlier one of the station holds no more.
    pub fn begin(&mut self, station: usize, bracket: usize) {
        self.metered.retain(|&at, metered| at != station || metered.bracket == bracket);
    }

    /// The exposures that make the station's bracket complete, where not all of the plan's do.
    pub fn exposures(&self, station: usize) -> Option<&[usize]> {
        self.metered.get(&station).map(|metered| &metered.exposures[..])
    }

    /// Stations that suffice, of so many in the plan.
    pub fn stations(&self, planned: usize) -> usize {
        self.lights.as_ref().filter(|judged| judged.enough).map_or(planned, |judged| judged.stations.min(planned))
    }

    /// True when this exposure of the plan was left out.
    pub fn left_out(&self, planned: usize, station: usize, exposure: usize) -> bool {
        station >= self.stations(planned) || self.exposures(station).is_some_and(|shot| !shot.contains(&exposure))
    }

    /// What they add up to in a plan of so many stations with these exposures each.
    pub fn saved(&self, planned: usize, exposures: &[PlannedExposure]) -> Saved {
        let cells = (0..planned).flat_map(|station| (0..exposures.len()).map(move |exposure| (station, exposure)));
        let left_out: Vec<usize> =
            cells.filter(|&(s, e)| self.left_out(planned, s, e)).map(|(_, exposure)| exposure).collect();
        let mean = |of: fn(&Metered) -> f64| {
            let count = self.metered.len();
            (count > 0).then(|| self.metered.values().map(of).sum::<f64>() / count as f64)
        };
        Saved {
            exposures: left_out.len(),
            stations: planned - self.stations(planned),
            shutter_s: left_out.iter().filter_map(|&e| exposures.get(e)).map(|exposure| exposure.true_s).sum(),
            sigma: mean(|metered| metered.sigma),
            sigma_whole: mean(|metered| metered.sigma_whole),
            lights: self.lights.as_ref().map(|judged| LightsReached {
                stations: judged.stations,
                left_out_error: judged.weighed.left_out_error,
                parameter_error: judged.weighed.parameter_error,
                enough: judged.enough,
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use serde_json::json;

    #[test]
    fn angles_are_well_spread_at_every_length() {
        let angles: Vec<f64> = (0..21).map(|i| -55.0 + 9.75 * f64::from(i)).collect();
        let order = spread(&angles);
        assert_eq!(order[..3], [-55.0, 140.0, 42.5]);
        let mut sorted = order.clone();
        sorted.sort_by(f64::total_cmp);
        assert_eq!(sorted, angles);
        for count in 2..=21 {
            let mut part = order[..count].to_vec();
            part.sort_by(f64::total_cmp);
            let widest = part.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
            // No even set of so many has gaps of less than half of that.
            assert!(widest <= 2.0 * 195.0 / (count - 1) as f64 + 9.75, "{count}: {widest}");
        }
        assert_eq!((spread(&[]).len(), spread(&[3.0])), (0, vec![3.0]));
    }

    #[test]
    fn decisions_hold_for_their_bracket_and_add_up() {
        let exposures: Vec<PlannedExposure> =
            [0.25, 1.0, 4.0].map(|true_s| PlannedExposure { label: true_s.to_string(), true_s }).to_vec();
        let mut decisions = Decisions::default();
        assert_eq!(decisions.saved(4, &exposures), Saved::default());
        let enough = |station: usize, bracket: usize, shot: &[usize], sigma: f64| json!({"type": "exposures.enough", "station": station, "bracket": bracket, "exposures": shot, "sigma": sigma, "sigma_whole": 0.01});
        decisions.apply(&enough(1, 2, &[0, 1], 0.01));
        decisions.apply(&enough(2, 3, &[1], 0.03));
        assert_eq!((decisions.exposures(0), decisions.exposures(2)), (None, Some(&[1][..])));
        let saved = decisions.saved(4, &exposures);
        assert_eq!((saved.exposures, saved.stations, saved.shutter_s), (3, 0, 8.25));
        assert!((saved.sigma.unwrap() - 0.02).abs() < 1e-12 && saved.sigma_whole == Some(0.01));
        decisions.begin(2, 3);
        assert!(decisions.exposures(2).is_some());
        decisions.begin(2, 4);
        assert_eq!(decisions.exposures(2), None);

        let judged = |stations: usize, enough: bool| json!({"type": "lights.judged", "stations": stations, "left_out_error": 0.03, "parameter_error": null, "enough": enough});
        decisions.apply(&judged(2, false));
        assert_eq!(decisions.stations(4), 4);
        decisions.apply(&judged(3, true));
        let saved = decisions.saved(4, &exposures);
        assert_eq!((decisions.stations(4), saved.stations, saved.exposures, saved.shutter_s), (3, 1, 4, 9.25));
        assert_eq!(saved.lights.unwrap().left_out_error, Some(0.03));
    }

    #[test]
    fn what_was_not_determined_meets_no_target() {
        let targets = LightTargets { left_out_error: 0.05, parameter_error: 0.1 };
        let met = Weighed { left_out_error: Some(0.05), left_out_highlight_error: None, parameter_error: Some(0.1) };
        assert!(met.meets(&targets));
        for not in [
            Weighed { left_out_error: None, ..met },
            Weighed { parameter_error: None, ..met },
            Weighed { left_out_error: Some(0.0501), ..met },
            Weighed { parameter_error: Some(0.101), ..met },
        ] {
            assert!(!not.meets(&targets), "{not:?}");
        }
    }
}
