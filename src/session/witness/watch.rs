//! The reference patch in the frames of a bracket. It is matt and always evenly lit, so it tells of the lamp what an object in bad light
//! does not. Frames whose object matches the bracket also tell when the patch in them is not what it was.

use super::{Drift, STEADY, Seen};
use crate::numerics::image::Image;
use crate::numerics::quality::{Look, PatchLevel, patch_change};
use crate::session::plan::third_stop;
use std::collections::BTreeMap;

/// A change within a bracket is one from so many standard errors on: the surest of all moments is looked for.
const SURE: f64 = 4.5;
/// An object that is accepted changes by 6 % at most: a patch that changes by more than this, natural logarithm, is covered or moved.
const DOUBTED: f64 = 0.1;
/// A patch is no longer all of what is looked at when this share is not as bright as the rest.
const UNEVEN: f64 = 0.1;
/// What to do about it.
const REMEDY: &str = "something covers or shadows it, or it moved: see that nothing stands between it and lamp or camera, and that it stands where \
                      reference_patch of the rig file says";

/// A change from one frame to another, natural logarithm of exposure and standard error, by their places in the bracket.
type Changes = BTreeMap<(usize, usize), (f64, f64)>;

/// What is known of the patch.
#[derive(Default)]
pub(super) struct Watch {
    /// Its pixels in the bracket in hand: left, top, columns, rows; none where it is not lit, or there is none.
    pub part: Option<[usize; 4]>,
    /// What it showed in earlier brackets, by third stop. The first is believed.
    known: Vec<BTreeMap<i64, PatchLevel>>,
}

impl Watch {
    /// What a frame shows of it.
    pub fn see(&self, picture: &Image<[u8; 3]>) -> Option<PatchLevel> {
        self.part.map(|part| PatchLevel::of(&Look::new(picture, part)))
    }

    /// What the patch tells of a whole bracket: what the lamp did, and why it is not what it was.
    pub fn tell(&mut self, bracket: &[Seen]) -> (Option<Drift>, Option<String>) {
        let changes = self.changes(bracket);
        if let Some(why) = uneven(bracket).or_else(|| changed(bracket, &changes)) {
            return (None, Some(format!("the reference patch is not what it was: {why}; {REMEDY}")));
        }
        let drift = drift(bracket, &changes);
        let levels: BTreeMap<i64, PatchLevel> = bracket.iter().filter_map(|s| Some((stop(s), s.patch?))).collect();
        if drift.is_none() && !levels.is_empty() {
            self.known.push(levels);
        }
        (drift, None)
    }

    /// Each pair of frames against the earlier bracket in which the patch was most alike.
    fn changes(&self, bracket: &[Seen]) -> Changes {
        let mut changes = Changes::new();
        for (i, first) in bracket.iter().enumerate() {
            for (j, second) in bracket.iter().enumerate().skip(i + 1) {
                let (Some(a), Some(b)) = (first.patch, second.patch) else { continue };
                let before =
                    self.known.iter().filter_map(|known| Some([*known.get(&stop(first))?, *known.get(&stop(second))?]));
                let alike = before.min_by(|x, y| x[0].apart(&a).total_cmp(&y[0].apart(&a)));
                let change = alike.and_then(|before| patch_change([&first.look, &second.look], before, [a, b]));
                changes.extend(change.map(|change| ((i, j), change)));
            }
        }
        changes
    }
}

fn stop(seen: &Seen) -> i64 {
    third_stop(seen.true_s)
}

fn uneven(bracket: &[Seen]) -> Option<String> {
    let share = |seen: &Seen| seen.patch.and_then(|patch| patch.uneven).filter(|&share| share > UNEVEN);
    let (label, share) = bracket.iter().find_map(|seen| Some((&seen.label, share(seen)?)))?;
    Some(format!("{:.0} % of it are not as bright as the rest ({label} s)", 100.0 * share))
}

fn changed(bracket: &[Seen], changes: &Changes) -> Option<String> {
    let (&(i, j), (off, _)) = changes.iter().find(|(_, (off, sigma))| off.abs() > DOUBTED + SURE * sigma)?;
    let (first, second) = (&bracket.get(i)?.label, &bracket.get(j)?.label);
    Some(format!("from {first} to {second} s it changed by {:+.0} %, and the object did not", 100.0 * off.exp_m1()))
}

/// The moment at which the lamp most surely changed: before this frame, or not at all.
fn drift(bracket: &[Seen], changes: &Changes) -> Option<Drift> {
    let at = |(k, seen): (usize, &Seen)| {
        let (off, sigma) = step(changes, k)?;
        (off.abs() > STEADY.max(SURE * sigma)).then(|| Drift { exposure: seen.exposure, change: off.exp_m1(), sigma })
    };
    let surer = |a: &Drift, b: &Drift| (a.change / a.sigma).abs().total_cmp(&(b.change / b.sigma).abs());
    bracket.iter().enumerate().skip(1).filter_map(at).max_by(surer)
}

/// By how much the frames from place `k` on are brighter than those before it.
fn step(changes: &Changes, k: usize) -> Option<(f64, f64)> {
    let across: Vec<_> = changes.iter().filter(|((i, j), _)| *i < k && *j >= k).collect();
    let weights: f64 = across.iter().map(|(_, (_, sigma))| sigma.powi(-2)).sum();
    let mean = across.iter().map(|(_, (off, sigma))| off * sigma.powi(-2)).sum::<f64>() / weights;
    // As many errors as there are frames, not pairs.
    let frames = |place: fn(&(usize, usize)) -> usize| {
        let mut places: Vec<usize> = across.iter().map(|(pair, _)| place(pair)).collect();
        places.sort_unstable();
        places.dedup();
        places.len() as f64
    };
    let shared = 0.5 * (1.0 / frames(|pair| pair.0) + 1.0 / frames(|pair| pair.1));
    (!across.is_empty()).then(|| (mean, (shared * across.len() as f64 / weights).sqrt()))
}
