//! How bright the lamp was at every station, relative to the first, as far as the reference patch tells.

use crate::numerics::radiometry::drift::PatchMean;
use crate::numerics::radiometry::lean::{Lean, Seen, lean};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// The patch tells when its own normal leaves no larger error in a brightness relative to the first, and the readings scatter by no more.
const TOLD: f64 = 0.002;
const SCATTER: f64 = 0.005;
/// Before the first station that tells, and after the last, the smooth drift is followed for so much of the time between them, and no
/// farther.
const BEYOND: f64 = 0.5;
/// A lamp is warned of when it changes by this much from one station to the next that tells, and in all.
const STEP: f64 = 0.02;
const TOTAL: f64 = 0.05;

/// What the patch showed at a station: the field `patch` of `station.developed`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PatchReading {
    /// Its mean radiance, red green blue.
    pub radiance: [f64; 3],
    /// Relative standard errors of that.
    pub sigma: [f64; 3],
    /// The radiance that a perfectly white one would have under the planned light, by Lambert's law and inverse square.
    pub expected: [f64; 3],
    /// Cosines of the lamp's direction with two directions in the patch, over its cosine with the stated normal.
    pub aside: [f64; 2],
}

impl PatchReading {
    fn mean(&self) -> PatchMean {
        PatchMean { radiance: self.radiance, relative_variance: self.sigma.map(|sigma| sigma * sigma) }
    }
}

/// What the patch said of the lamp, in a session's snapshot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LampDrift {
    /// Stations at which the patch tells.
    pub stations: usize,
    /// Brightness at the last of them, red green blue, relative to the first.
    pub brightness: [f64; 3],
    /// The largest change since the first, of any channel, relative.
    pub change: f64,
    /// The largest change from one of them to the next.
    pub step: f64,
}

/// Readings of a session, by station; with each, how often the lamp had been lit anew.
#[derive(Clone, Debug, Default)]
pub struct Drift {
    readings: BTreeMap<usize, (PatchReading, usize)>,
}

/// The time of a station, as the readings' own, but no farther beyond them than the drift is followed.
fn clock(seen: &BTreeMap<usize, Seen>) -> impl Fn(usize) -> f64 + use<> {
    let first = seen.first_key_value().map_or(0.0, |(_, s)| s.time);
    let (last, station_time) =
        seen.last_key_value().map_or((0.0, 0.0), |(station, s)| (s.time, s.time / (*station).max(1) as f64));
    let reach = BEYOND * (last - first);
    move |station| (station_time * station as f64).clamp(first - reach, last + reach)
}

/// The larger change of two.
fn larger<T>(a: (T, f64), b: (T, f64)) -> (T, f64) {
    if b.1.abs() > a.1.abs() { b } else { a }
}

/// The channel that changed most from `before` to `after`, relative.
fn change(before: &[f64; 3], after: &[f64; 3]) -> f64 {
    let changes = std::array::from_fn::<f64, 3, _>(|c| after[c] / before[c] - 1.0);
    changes.into_iter().fold(0.0, |most, one| larger(((), most), ((), one)).1)
}

impl Drift {
    /// A station was developed, perhaps again, shot after the lamp had been lit anew so often; no reading: the patch did not tell.
    pub fn take(&mut self, station: usize, reading: Option<PatchReading>, lighting: usize) {
        match reading {
            Some(reading) => self.readings.insert(station, (reading, lighting)),
            None => self.readings.remove(&station),
        };
    }

    /// Readings over what the stated normal says, relative to the first; where that is no lamp's, the patch is covered.
    fn seen(&self) -> BTreeMap<usize, Seen> {
        let Some((first, _)) = self.readings.values().next() else { return BTreeMap::new() };
        let white = first.mean().drift(first.expected);
        let last = self.readings.keys().next_back().copied().unwrap_or_default().max(1);
        let one = |(station, (reading, lighting)): (&usize, &(PatchReading, usize))| {
            let unchanged = std::array::from_fn(|c| reading.expected[c] * white[c]);
            let mean = reading.mean();
            let time = *station as f64 / last as f64;
            let (brightness, lighting, aside) = (mean.drift(unchanged), *lighting, reading.aside);
            mean.check(unchanged).is_ok().then_some((*station, Seen { time, lighting, brightness, aside }))
        };
        self.readings.iter().filter_map(one).collect()
    }

    /// How the patch leans, if the readings tell it from the lamp's drift; otherwise why they do not.
    fn lean(seen: &BTreeMap<usize, Seen>) -> Result<Lean, String> {
        let all: Vec<Seen> = seen.values().copied().collect();
        match lean(&all) {
            None => Err(format!("it tells at {} stations only", all.len())),
            Some(Lean { scatter, .. }) if scatter > SCATTER => {
                Err(format!("its readings scatter by {:.2} % about any smooth drift", 100.0 * scatter))
            }
            Some(Lean { error, .. }) if error > TOLD => Err(format!(
                "its stated normal may be wrong, which these stations in this order do not tell from a drift ({:.2} %): leave stations_deg \
                 out of the request, or shoot every third one on the way out, the next ones on the way back, the rest on the way out again",
                100.0 * error
            )),
            Some(lean) => Ok(lean),
        }
    }

    /// Brightness at the stations that tell, relative to the first of them.
    fn relative(&self) -> Option<BTreeMap<usize, [f64; 3]>> {
        Self::told(&self.seen()).map(|(told, _)| told)
    }

    /// The same, with the smooth drift about which it is.
    fn told(seen: &BTreeMap<usize, Seen>) -> Option<(BTreeMap<usize, [f64; 3]>, Lean)> {
        let lean = Self::lean(seen).ok()?;
        let first = lean.factor(seen.values().next()?.aside);
        let told = |(station, s): (&usize, &Seen)| (*station, s.brightness.map(|b| b * first / lean.factor(s.aside)));
        Some((seen.iter().map(told).collect(), lean))
    }

    /// Why a patch that was read does not tell what the lamp did; none where it does, or where there is none.
    pub fn untold(&self) -> Option<String> {
        let why = Self::lean(&self.seen()).err().filter(|_| !self.readings.is_empty())?;
        Some(format!("the reference patch does not tell how bright the lamp was, which is taken to be steady: {why}"))
    }

    /// Brightness at each of the first `stations` stations, relative to what the smooth drift has at the very first. Between two that tell it is taken to change evenly, station by station; before
    /// the first and after the last it follows the smooth drift for a while. Steady where the patch does not tell.
    pub fn of_stations(&self, stations: usize) -> Vec<[f64; 3]> {
        let seen = self.seen();
        let Some((told, lean)) = Self::told(&seen) else { return vec![[1.0; 3]; stations] };
        let time = clock(&seen);
        let at = |station: usize| {
            let (before, after) = (told.range(..=station).next_back(), told.range(station..).next());
            match (before, after) {
                (Some((i, a)), Some((j, b))) if j > i => {
                    let part = (station - i) as f64 / (j - i) as f64;
                    std::array::from_fn(|c| a[c] + part * (b[c] - a[c]))
                }
                (Some((end, last)), _) | (_, Some((end, last))) => {
                    let drift = lean.drift(time(*end), time(station));
                    std::array::from_fn(|c| last[c] * drift[c])
                }
                (None, None) => [1.0; 3],
            }
        };
        // What is read at one station is off by more than what all readings say of it.
        let scale = seen.values().next().map_or(1.0, |s| lean.factor(s.aside));
        let first = lean.smooth(time(0)).map(|brightness| brightness * scale);
        (0..stations).map(at).map(|now| std::array::from_fn(|c| now[c] / first[c])).collect()
    }

    /// In numbers; none while the patch does not tell.
    pub fn summary(&self) -> Option<LampDrift> {
        let told = self.relative()?;
        let brightness = *told.values().next_back()?;
        let (stations, change, step) = (told.len(), total(&told).1, step(&told).1);
        Some(LampDrift { stations, brightness, change, step })
    }

    /// What to know before trusting the result.
    pub fn warnings(&self) -> Vec<String> {
        let Some(told) = self.relative() else { return Vec::new() };
        let ((from, to), stepped) = step(&told);
        let (station, changed) = total(&told);
        let mut warnings = Vec::new();
        if stepped.abs() > STEP {
            warnings.push(format!(
                "by the reference patch the lamp changed by {:+.1} % between stations {from} and {to}: see to its supply and its socket, \
                 and that nothing stands before the patch or moved it",
                100.0 * stepped
            ));
        }
        if changed.abs() > TOTAL {
            warnings.push(format!(
                "by the reference patch the lamp changed by {:+.1} % until station {station}: it was taken into account, but see to its \
                 supply, and let it warm up longer (lamp.soak_s)",
                100.0 * changed
            ));
        }
        warnings
    }
}

/// The station that differs most from the first, and by how much.
fn total(told: &BTreeMap<usize, [f64; 3]>) -> (usize, f64) {
    told.iter().map(|(station, now)| (*station, change(&[1.0; 3], now))).fold((0, 0.0), larger)
}

/// The neighbours that differ most, and by how much.
fn step(told: &BTreeMap<usize, [f64; 3]>) -> ((usize, usize), f64) {
    let pairs = told.iter().zip(told.iter().skip(1));
    pairs.map(|((i, a), (j, b))| ((*i, *j), change(a, b))).fold(((0, 0), 0.0), larger)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Angles off the patch's normal of a plan that goes out, back and out again, degrees.
    const ANGLES: [f64; 9] = [-55.0, -13.75, 27.5, 41.25, 0.0, -41.25, -27.5, 13.75, 55.0];

    /// A patch of 40 % under a lamp of this brightness.
    fn reading(angle: f64, brightness: [f64; 3]) -> PatchReading {
        let aside = [angle.to_radians().tan(), 0.0];
        let expected = [3.0 * angle.to_radians().cos(); 3];
        let radiance = std::array::from_fn(|c| 0.4 * brightness[c] * expected[c]);
        PatchReading { radiance, sigma: [1e-3; 3], expected, aside }
    }

    fn of(brightness: impl Fn(usize) -> [f64; 3]) -> Drift {
        let mut drift = Drift::default();
        ANGLES.iter().enumerate().for_each(|(i, &angle)| drift.take(i, Some(reading(angle, brightness(i))), 0));
        drift
    }

    fn near(found: [f64; 3], wanted: [f64; 3]) -> bool {
        found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-3)
    }

    #[test]
    fn brightness_is_relative_to_the_first_and_goes_on_evenly_where_the_patch_does_not_tell() {
        let loss = |i: usize| [1.0 - 0.005 * i as f64, 1.0, 2.0 + 0.01 * i as f64];
        let mut drift = of(loss);
        drift.take(3, None, 0);
        drift.take(8, None, 0);
        let found = drift.of_stations(40);
        let wanted = |i: usize| [1.0 - 0.005 * i as f64, 1.0, 1.0 + 0.005 * i as f64];
        assert!((0..8).all(|i| near(found[i], wanted(i))), "{found:?}");
        // It tells until station 7: three and a half stations beyond, the drift is followed no farther.
        assert!((8..11).all(|i| near(found[i], wanted(i))), "{found:?}");
        assert!(near(found[11], [1.0 - 0.005 * 10.5, 1.0, 1.0 + 0.005 * 10.5]) && found[11] == found[39], "{found:?}");
        let summary = drift.summary();
        assert!(summary.is_some_and(|s| s.stations == 7 && (s.change.abs() - 0.035).abs() < 1e-3), "{summary:?}");
        // A station shot again, and one at which somebody stood before the patch.
        drift.take(8, Some(reading(ANGLES[8], loss(8))), 0);
        drift.take(5, Some(reading(ANGLES[5], [0.3, 0.3, 0.6])), 0);
        assert!(near(drift.of_stations(9)[8], wanted(8)) && near(drift.of_stations(9)[5], wanted(5)));
    }

    #[test]
    fn a_first_station_that_does_not_tell_is_what_all_are_relative_to() {
        let loss = |i: usize| [1.0 - 0.005 * i as f64; 3];
        let mut drift = of(loss);
        drift.take(0, None, 0);
        let found = drift.of_stations(9);
        assert!((0..9).all(|i| near(found[i], loss(i))), "{found:?}");
    }

    #[test]
    fn a_patch_that_cannot_tell_changes_nothing_and_says_why() {
        assert_eq!(Drift::default().untold(), None);
        let mut one_way = Drift::default();
        let mut angles = ANGLES;
        angles.sort_by(f64::total_cmp);
        for (i, angle) in angles.into_iter().enumerate() {
            one_way.take(i, Some(reading(angle, [1.0 - 0.006 * i as f64; 3])), 0);
        }
        let flicker = of(|i| [1.0 + if i % 2 == 0 { 0.0 } else { 0.015 }; 3]);
        for (drift, why) in [(one_way, "on the way back"), (flicker, "scatter")] {
            assert!(drift.of_stations(9).iter().all(|b| *b == [1.0; 3]) && drift.summary().is_none());
            assert!(drift.untold().is_some_and(|said| said.contains(why)), "{:?}", drift.untold());
        }
    }

    #[test]
    fn steps_and_sums_are_warned_of() {
        let slow = of(|i| [1.0, 1.0 - 0.005 * i as f64, 1.0]);
        assert!(slow.warnings().is_empty() && slow.untold().is_none());
        let sum = of(|i| [1.0, 1.0 - 0.01 * i as f64, 1.0]).warnings();
        assert!(sum.len() == 1 && sum[0].contains("-8.0 % until station 8"), "{sum:?}");
        let mut relit = of(|i| [if i < 4 { 1.0 } else { 1.03 }; 3]);
        (4..9).for_each(|i| relit.take(i, Some(reading(ANGLES[i], [1.03; 3])), 1));
        let step = relit.warnings();
        assert!(step.len() == 1 && step[0].contains("+3.0 % between stations 3 and 4"), "{step:?}");
    }
}
