//! Do the pictures themselves say what their EXIF says? Every frame is compared with the others of its bracket, which show the same
//! object under the same lamp for other times. A check that cannot be made, as of a bracket's first frame, is left out.

mod watch;

use super::calibration::plan::frontality;
use super::crop;
use super::lamp::patch;
use super::plan::{Station, third_stop};
use crate::devices::camera::Shot;
use crate::numerics::image::Image;
use crate::numerics::quality::{Doubt, Look, PatchLevel, Transfers, brighter, compare, expected_error};
use crate::pipeline::decode::decode_into;
use rig_config::Rig;
use std::collections::{BTreeMap, HashMap};
use watch::Watch;

/// Frames of the bracket that a new one is compared with: those of the nearest times.
const COMPARED: usize = 3;
/// Single rows or columns may stand out this much more than in the rest of the bracket: factor and levels.
const STRIPES: (f32, f32) = (3.0, 0.75);
/// Every earlier station showed at least `LIT` levels above the background at this exposure and this one shows none: no lamp. A lamp
/// behind the object is given so many third stops more.
const LIT: f32 = 40.0;
const UNLIT: f32 = 4.0;
const BEHIND: i64 = 9;
/// A lamp behind the object that lights less than this share of what is seen of a ball leaves the brightest hundredth of the picture dark.
const RIM: f64 = 0.05;
/// A lamp that changes by less than this within a bracket, or by less than four standard errors, is steady.
const STEADY: f64 = 0.006;

/// Why a frame does not serve.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// By itself.
    Damaged(String),
    /// It and the frames before it in the bracket cannot all be right.
    Contradicts(String),
    /// It is black where the lamp should show.
    Black(String),
}

impl Verdict {
    /// What was expected and what was seen, in words.
    pub fn reason(&self) -> &str {
        let (Self::Damaged(reason) | Self::Contradicts(reason) | Self::Black(reason)) = self;
        reason
    }
}

/// A lamp whose brightness changed within a bracket.
#[derive(Clone, Debug, PartialEq)]
pub struct Drift {
    /// The surest of the frames that differ from what the bracket's frames before it and earlier brackets say: its exposure.
    pub exposure: usize,
    /// By how much it is brighter, relative.
    pub change: f64,
    /// Standard error of that.
    pub sigma: f64,
}

/// What a lamp lights of the object's side that the camera sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lighting {
    /// Half of it or more.
    Front,
    /// Less, from behind the object.
    Behind,
    /// Its rim at most: such a frame may be black with the lamp on.
    Rim,
}

impl Lighting {
    /// With the lamp on the arm at this angle, by the rig file's geometry. Of a ball the share `(1 + cos) / 2` is lit.
    pub fn of(rig: &Rig, angle_deg: f64) -> Self {
        match frontality(rig, angle_deg) {
            cosine if cosine >= 0.0 => Self::Front,
            cosine if 0.5 * (1.0 + cosine) >= RIM => Self::Behind,
            _ => Self::Rim,
        }
    }
}

/// A frame that counts.
struct Seen {
    exposure: usize,
    label: String,
    true_s: f64,
    look: Look,
    /// The reference patch, where it is looked at.
    patch: Option<PatchLevel>,
}

/// What the frames of a session say of each other.
pub struct Witness {
    part: [usize; 4],
    /// What its earlier frames show: station and exposure by the hash of their pixels.
    pixels: HashMap<u64, (usize, usize)>,
    learned: Transfers,
    bracket: Vec<Seen>,
    drift: Option<Drift>,
    watch: Watch,
    /// Least contrast by third stop of the exposure, of stations that light the camera's side of the object.
    contrast: BTreeMap<i64, f32>,
    memory: Image<[u8; 3]>,
}

impl Witness {
    /// Nothing is seen yet; looks at this part of the frames: left, top, columns, rows.
    pub fn new(part: [usize; 4]) -> Self {
        Self {
            part,
            pixels: HashMap::new(),
            learned: Transfers::default(),
            bracket: Vec::new(),
            drift: None,
            watch: Watch::default(),
            contrast: BTreeMap::new(),
            memory: Image::filled(0, 0, [0; 3]),
        }
    }

    /// The frames that follow are of a new bracket.
    pub fn begin(&mut self) {
        self.bracket.clear();
        self.drift = None;
        self.watch.part = None;
    }

    /// In the bracket that was begun the reference patch is lit: these are its pixels (left, top, columns, rows).
    pub fn watch_patch(&mut self, part: [usize; 4]) {
        self.watch.part = Some(part);
    }

    /// Judges a frame.
    ///
    /// # Errors
    /// Why it does not serve.
    pub fn judge(&mut self, bytes: &[u8], shot: &Shot, lighting: Lighting) -> Result<Look, Verdict> {
        let look = self.look(bytes).map_err(Verdict::Damaged)?;
        if let Some(rows) = look.grey_rows {
            let reason = format!(
                "its lowest {rows} rows are one grey, a picture was expected: the transfer broke off; check the cable"
            );
            return Err(Verdict::Damaged(reason));
        }
        if let Some((station, exposure)) = look.hash.and_then(|hash| self.pixels.get(&hash)) {
            let reason = format!(
                "it has the pixels of station {station}, exposure {exposure}, a new picture was expected: switch the camera off and on"
            );
            return Err(Verdict::Damaged(reason));
        }
        self.against_stations(&look, shot, lighting).map_err(Verdict::Black)?;
        self.against_bracket(&look, shot)?;
        self.against_stripes(&look).map_err(Verdict::Contradicts)?;
        Ok(look)
    }

    /// What a frame that does not count shows of the lamp.
    ///
    /// # Errors
    /// Why it shows nothing.
    pub fn look(&mut self, bytes: &[u8]) -> Result<Look, String> {
        decode_into(bytes, &mut self.memory).map_err(|e| format!("it is {e}"))?;
        Ok(Look::new(&self.memory, self.part))
    }

    /// A frame that does not count shows that the lamp is on: later ones must show as much.
    pub fn lit(&mut self, shot: &Shot, look: &Look, lighting: Lighting) {
        if lighting == Lighting::Front {
            let contrast = look.bright - look.background;
            let least = self.contrast.entry(third_stop(shot.shutter.true_s)).or_insert(contrast);
            *least = least.min(contrast);
        }
    }

    /// Takes the frame that was judged last, and committed, into account. Of one that is kept of a broken bracket the patch is not looked at.
    pub fn accept(&mut self, shot: &Shot, look: Look, lighting: Lighting) {
        let true_s = shot.shutter.true_s;
        self.pixels.extend(look.hash.map(|hash| (hash, (shot.station, shot.exposure))));
        self.lit(shot, &look, lighting);
        if let Some((change, sigma)) = self.brighter(&look, true_s)
            && change.abs() > STEADY.max(4.0 * sigma)
            && self.drift.as_ref().is_none_or(|known| known.sigma > sigma)
        {
            self.drift = Some(Drift { exposure: shot.exposure, change: change.exp_m1(), sigma });
        }
        let patch = self.watch.see(&self.memory);
        self.bracket.push(Seen { exposure: shot.exposure, label: shot.shutter.label.clone(), true_s, look, patch });
    }

    /// What its frames show.
    pub fn bracket(&self) -> Vec<&Look> {
        self.bracket.iter().map(|seen| &seen.look).collect()
    }

    /// The bracket is whole: it is learned from, and what its lamp did is told.
    pub fn finish(&mut self) -> Option<Drift> {
        let bracket: Vec<_> = self.bracket.iter().map(|seen| (third_stop(seen.true_s), &seen.look)).collect();
        self.learned.learn(&bracket);
        self.drift.take()
    }

    /// What the reference patch tells of the whole bracket: what the lamp did, and why it is not what it was.
    pub fn patch(&mut self) -> (Option<Drift>, Option<String>) {
        self.watch.tell(&self.bracket)
    }

    /// While a bracket shows nothing, it can only be held against what other stations showed: in this time, or, if the lamp stands behind
    /// the object, in an eighth of it; where it lights but the rim, by nothing.
    fn against_stations(&self, look: &Look, shot: &Shot, lighting: Lighting) -> Result<(), String> {
        let seen = look.bright - look.background;
        if seen > UNLIT || self.bracket.iter().any(|frame| frame.look.shows()) {
            return Ok(());
        }
        let longest = match lighting {
            Lighting::Front => third_stop(shot.shutter.true_s),
            Lighting::Behind => third_stop(shot.shutter.true_s) - BEHIND,
            Lighting::Rim => return Ok(()),
        };
        let least = self.contrast.range(..=longest).map(|(_, least)| *least).reduce(f32::max);
        let Some(least) = least.filter(|&least| least >= LIT) else { return Ok(()) };
        Err(format!(
            "it is black: its brightest parts are {seen:.0} levels above the background, at every station before they were {least:.0} at \
             least: the lamp is out, or the shutter stayed closed"
        ))
    }

    fn against_bracket(&self, look: &Look, shot: &Shot) -> Result<(), Verdict> {
        let true_s = shot.shutter.true_s;
        for other in self.nearest(true_s) {
            let (this, that) = (third_stop(true_s), third_stop(other.true_s));
            if this == that {
                continue;
            }
            let ratio = true_s / other.true_s;
            let forth = compare(&other.look, look, ratio, self.learned.get(that, this));
            // A black first frame predicts nothing, but is predicted by the next.
            let back = || compare(look, &other.look, 1.0 / ratio, self.learned.get(this, that));
            if let Some(doubt) = forth.iter().flat_map(|c| &c.doubts).next() {
                let reason = words(doubt, "it", &format!("the {} s frame before it", other.label));
                return Err(match doubt {
                    Doubt::Black { .. } => Verdict::Black(reason),
                    _ => Verdict::Contradicts(reason),
                });
            }
            if let Some(doubt) = back().iter().flat_map(|c| &c.doubts).next() {
                let reason = words(doubt, &format!("the {} s frame before it", other.label), "it");
                return Err(Verdict::Contradicts(reason));
            }
        }
        Ok(())
    }

    fn against_stripes(&self, look: &Look) -> Result<(), String> {
        for (axis, name) in ["rows", "columns"].iter().enumerate() {
            let most = self.bracket.iter().map(|seen| seen.look.stripes[axis]).reduce(f32::max);
            let Some(most) = most.map(|most| STRIPES.0 * most + STRIPES.1) else { continue };
            let seen = look.stripes[axis];
            if seen > most {
                return Err(format!(
                    "its single {name} stand out by {seen:.1} levels, {most:.1} at most are expected from the rest of the bracket: stripes"
                ));
            }
        }
        Ok(())
    }

    /// By how much the frame is brighter than what was learned says, natural logarithm and standard error.
    fn brighter(&self, look: &Look, true_s: f64) -> Option<(f64, f64)> {
        let compared = |seen: &Seen| {
            let learned = self.learned.get(third_stop(seen.true_s), third_stop(true_s))?;
            compare(&seen.look, look, true_s / seen.true_s, Some(learned))?.brighter
        };
        self.nearest(true_s).filter_map(compared).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn nearest(&self, true_s: f64) -> impl Iterator<Item = &Seen> {
        let far = |seen: &&Seen| (seen.true_s / true_s).ln().abs();
        let mut order: Vec<&Seen> = self.bracket.iter().collect();
        order.sort_by(|a, b| far(a).total_cmp(&far(b)).then(b.exposure.cmp(&a.exposure)));
        order.into_iter().take(COMPARED)
    }
}

/// True if the frame, shot again, would tell whether the light is the same.
pub fn can_tell(look: &Look) -> bool {
    4.0 * expected_error(look) <= STEADY
}

/// Whether a frame shows what an earlier one of its exposure shows, under the same light: by how much it is brighter, relative, and the
/// standard error of that.
///
/// # Errors
/// What differs, or that too little is seen to tell.
pub fn agree(earlier: &Look, again: &Look) -> Result<(f64, f64), String> {
    let compared = compare(earlier, again, 1.0, None);
    if let Some(doubt) = compared.iter().flat_map(|c| &c.doubts).next() {
        return Err(words(doubt, "it", "the frame before the interruption"));
    }
    let Some((change, sigma)) = brighter(earlier, again).filter(|(_, sigma)| 4.0 * sigma <= STEADY) else {
        return Err("too little of it is well exposed to tell".into());
    };
    if change.abs() > STEADY {
        return Err(format!(
            "the lamp changed by {:+.1} %, at most {:.1} % were expected",
            100.0 * change,
            100.0 * STEADY
        ));
    }
    Ok((change.exp_m1(), sigma))
}

/// What is looked at: the object, where a session knows where it stands (`calibrated`: only roughly); all of the frame where not.
pub fn part(rig: &Rig, calibrated: bool) -> [usize; 4] {
    crop::of_session(rig, calibrated)
        .map_or([0, 0, rig.camera.width, rig.camera.height], |c| [c.x, c.y, c.width, c.height])
}

/// The pixels of the reference patch that are looked at in the frames of a station: left, top, columns, rows; none where the lamp does not
/// light it well enough, or without a patch.
pub fn patch_part(rig: &Rig, station: &Station) -> Option<[usize; 4]> {
    patch::lit(rig, station).map(|c| [c.x, c.y, c.width, c.height])
}

/// What is wrong with `this` frame, which `other` predicts.
fn words(doubt: &Doubt, this: &str, other: &str) -> String {
    match doubt {
        Doubt::SamePicture => format!(
            "{this} shows the picture of {other} again, another exposure was expected: switch the camera off and on"
        ),
        Doubt::Exposure { expected, seen } => format!(
            "{this} is exposed {seen:.3} times as much as {other}, {expected:.3} times was expected: the shutter, or the lamp, was not as \
             planned"
        ),
        Doubt::Black { expected, seen } => format!(
            "the brightest parts of {this} have level {seen:.0}, {expected:.0} was expected from {other}: the lamp is out, or the shutter \
             stayed closed"
        ),
        Doubt::Background { expected, seen } => format!(
            "the background of {this} has level {seen:.0}, {expected:.0} was expected from {other}: another light was on"
        ),
        Doubt::Deviates { expected, seen } => format!(
            "{:.1} % of {this} do not show what {other} shows, at most {:.1} % were expected: something moved, shook, or disturbed the picture",
            100.0 * seen,
            100.0 * expected
        ),
        Doubt::Blurred { expected, seen } => format!(
            "the edges of {this} are {seen:.2} times as steep as {other} says, {expected:.2} was expected: something shook"
        ),
    }
}
