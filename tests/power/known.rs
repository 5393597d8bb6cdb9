//! What an outside observer was told, and what must therefore be found on any disk afterwards.

use super::processing::{DATASET, RESULT, radiance, result};
use crate::support::jpeg::{self, Exif};
use crate::support::{LEVEL, SIZE, World};
use rig_config::{Rig, Shutter};
use rigd::devices::camera::Shot;
use rigd::session::verify::verify;
use rigd::store::{journal, manifest};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Acknowledged so far.
#[derive(Default)]
pub struct Known {
    pub id: Option<String>,
    /// Number of the last record that was acknowledged.
    pub last_seq: u64,
    /// Frames as the engine told of them, by file.
    pub frames: BTreeMap<String, Value>,
    /// Hashes of files that were held against the camera's own.
    proved: BTreeSet<String>,
}

/// What a journal says.
#[derive(Default)]
pub struct Told {
    /// The frames that count, by station and exposure.
    pub frames: BTreeMap<(u64, u64), Value>,
    /// Brackets that were called complete with some exposures: station, then bracket and their number.
    enough: BTreeMap<u64, (Value, usize)>,
    developed: BTreeSet<u64>,
    /// Number of the last fit.
    fit: Option<u64>,
    pub completed: bool,
}

impl Told {
    pub fn of(records: &[Value]) -> Self {
        let mut told = Self::default();
        for record in records {
            match record["type"].as_str().unwrap() {
                "frame.committed" => {
                    let (station, exposure) = cell(record);
                    told.developed.retain(|&developed| station > 0 && developed != station);
                    told.frames.retain(|at, old| at.0 != station || old["bracket"] == record["bracket"]);
                    told.frames.insert((station, exposure), record.clone());
                }
                "exposures.enough" => {
                    let exposures = record["exposures"].as_array().unwrap().len();
                    let station = record["station"].as_u64().unwrap();
                    told.enough.insert(station, (record["bracket"].clone(), exposures));
                }
                "station.developed" => drop(told.developed.insert(record["station"].as_u64().unwrap())),
                "fit.finished" if record["error"].is_null() => told.fit = record["iterations"].as_u64(),
                "session.state" => told.completed = record["state"] == "completed",
                _ => {}
            }
        }
        told
    }

    /// Stations whose brackets are whole.
    pub fn whole(&self, rig: &Rig) -> BTreeSet<usize> {
        let whole = |station: &usize| {
            let frames: Vec<_> = self.frames.iter().filter(|(cell, _)| cell.0 == *station as u64).collect();
            let enough = self
                .enough
                .get(&(*station as u64))
                .filter(|(bracket, _)| frames.iter().all(|(_, frame)| frame["bracket"] == *bracket));
            frames.len() == enough.map_or(rig.plan.exposures.len(), |(_, exposures)| *exposures)
        };
        (0..rig.plan.stations_deg.len()).filter(whole).collect()
    }

    /// Stations that the worker is given when the session is taken up: those that are not developed, after the first for its response.
    pub fn waiting(&self, rig: &Rig) -> usize {
        let whole = self.whole(rig);
        let undeveloped = whole.iter().filter(|&&station| !self.developed.contains(&(station as u64))).count();
        let anything_left = undeveloped > 0 || whole.len() < rig.plan.stations_deg.len();
        undeveloped + usize::from(anything_left && whole.contains(&0) && self.developed.contains(&0))
    }
}

fn cell(frame: &Value) -> (u64, u64) {
    (frame["station"].as_u64().unwrap(), frame["exposure"].as_u64().unwrap())
}

/// Says what is not as it must be.
fn hold(true_now: bool, what: impl FnOnce() -> String) -> Result<(), String> {
    if true_now { Ok(()) } else { Err(what()) }
}

impl Known {
    /// Holds the session on an image of the disk against what was acknowledged; `live` is the session's directory when the power went.
    pub fn check(&mut self, image: &Path, live: &Path, rig: &Rig, world: &World) -> Result<Told, String> {
        manifest::read(image).map_err(|e| e.to_string())?;
        let told = self.check_journal(image, live)?;
        for (file, frame) in &self.frames {
            let bytes = fs::read(image.join("frames").join(file)).map_err(|e| format!("acknowledged {file}: {e}"))?;
            hold(frame["blake3"] == blake3::hash(&bytes).to_hex().as_str(), || format!("{file} is torn"))?;
        }
        for frame in told.frames.values() {
            self.check_truth(frame, rig, world)?;
        }
        let unsound = |fault: &&String| !fault.ends_with("the journal does not know it");
        let faults = verify(image).map_err(|e| e.to_string())?.faults;
        hold(faults.iter().find(unsound).is_none(), || faults.join("; "))?;
        check_derived(image, &told)?;
        Ok(told)
    }

    /// The chain is whole; every acknowledged record is there; nothing is there that the daemon did not write.
    fn check_journal(&self, image: &Path, live: &Path) -> Result<Told, String> {
        let read = journal::read(&image.join(journal::FILE)).map_err(|e| e.to_string())?;
        hold(read.head.fault.is_none(), || format!("the journal's chain is broken: {:?}", read.head.fault))?;
        let records = read.records.len() as u64;
        hold(records >= self.last_seq, || format!("{} records acknowledged, {records} found", self.last_seq))?;
        let text = |directory: &Path| fs::read(directory.join(journal::FILE)).unwrap();
        let (now, before) = (text(image), text(live));
        let length = read.length as usize;
        hold(before.get(..length) == Some(&now[..length]), || "the journal says what nobody wrote".into())?;
        Ok(Told::of(&read.records))
    }

    /// The frame is the one that the camera took for this cell of the plan, with the lamp on and the arm where the plan says.
    fn check_truth(&mut self, frame: &Value, rig: &Rig, world: &World) -> Result<(), String> {
        if !self.proved.insert(frame["blake3"].as_str().unwrap().to_owned()) {
            return Ok(());
        }
        let (station, exposure) = cell(frame);
        let (station, exposure) = (station as usize, exposure as usize);
        let name = frame["camera_file"].as_str().unwrap();
        let count: usize = name.strip_prefix("IMG_").and_then(|n| n.strip_suffix(".JPG")).unwrap().parse().unwrap();
        let angle_deg = rig.plan.stations_deg[station];
        let shutter = Shutter::from_label(&rig.plan.exposures[exposure].label).unwrap();
        let (label, true_s) = (shutter.label.clone(), shutter.true_s);
        let shot = Shot { station, exposure, shutter, f_number: rig.camera.f_number, iso: rig.camera.iso };
        let exif = Exif::of(&shot, count);
        let taken = blake3::hash(&jpeg::encode(SIZE, Some(&exif))).to_hex();
        hold(
            world.shots.get(count) == Some(&(station, exposure, LEVEL, angle_deg))
                && frame["blake3"] == taken.as_str()
                && frame["shutter"] == *label
                && frame["true_s"] == true_s
                && frame["angle_deg"] == angle_deg,
            || format!("wrong metadata: {frame}, the camera's shot was {:?}", world.shots.get(count)),
        )
    }

    /// Every cell of the plan has one frame that counts, and the frames of a station are of one bracket.
    pub fn check_whole(&self, told: &Told, rig: &Rig) -> Result<(), String> {
        let whole = told.whole(rig).len() == rig.plan.stations_deg.len();
        hold(told.completed && whole, || format!("completed without all frames: {:?}", told.frames.keys()))?;
        let brackets: BTreeSet<_> = told.frames.values().map(|f| (cell(f).0, f["bracket"].as_u64())).collect();
        hold(brackets.len() == rig.plan.stations_deg.len(), || format!("mixed brackets: {brackets:?}"))
    }
}

/// What the journal calls developed or fitted is on disk, whole.
fn check_derived(image: &Path, told: &Told) -> Result<(), String> {
    let same = |path: &Path, text: &str| {
        let found = fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
        hold(found == text.as_bytes(), || format!("{} is torn", path.display()))
    };
    for &station in &told.developed {
        let frames = told.frames.iter().filter(|(at, _)| at.0 == station);
        let text = radiance(frames.map(|(_, frame)| frame["blake3"].as_str().unwrap()));
        same(&image.join(format!("radiance/{station:02}.exr")), &text)?;
    }
    let Some(fit) = told.fit else { return Ok(()) };
    same(&image.join("dataset.toml"), DATASET)?;
    // A newer result may have got its name before the journal could say so; what is there is of one fit.
    let report = image.join("result").join(RESULT[1]);
    let found: Value = serde_json::from_slice(&fs::read(&report).map_err(|e| format!("{}: {e}", report.display()))?)
        .map_err(|e| format!("{} is torn: {e}", report.display()))?;
    let number = found["iterations"].as_u64().unwrap_or(0);
    hold(number >= fit, || format!("the result is of fit {number}, the journal tells of {fit}"))?;
    RESULT.into_iter().try_for_each(|name| same(&image.join("result").join(name), &result(name, number)))
}
