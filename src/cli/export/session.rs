//! `rigd export --format crate`: the whole session in which a result lies.

use super::{Args, at_path, folder_with};
use crate::cli::error::{bad_input, print_line};
use crate::pipeline::export::archive::{ABOUT, Facts, NAME, information, metadata};
use crate::pipeline::export::{LOSS, README, Words, readme_of};
use crate::session::SOFTWARE;
use crate::session::handle::SessionSnapshot;
use crate::session::verify::{look, verify};
use crate::store::bag::{Bag, Listed, list};
use crate::store::files::shown;
use crate::store::manifest::{self, Manifest};
use crate::store::result::{self, StoredMaterial};
use serde::Serialize;
use serde_json::json;
use std::path::{Component, Path, PathBuf};

/// Folders and files of a session without which a crate is not the session.
const PARTS: [&str; 6] = ["frames", "radiance", "result", "journal.jsonl", "manifest.json", "dataset.toml"];

/// What `--json` prints.
#[derive(Serialize)]
struct Summary {
    format: &'static str,
    out: String,
    files: usize,
    bytes: u64,
    left_out: Vec<String>,
}

/// Runs the command: what lies in the session is held against its journal first, because a bag says that its files are sound.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let session = folder_with(&args.result, manifest::FILE, "--format crate is made of a whole session")?;
    let (manifest, snapshot) = sound(&session)?;
    let stored = result::read_material(&args.result).map_err(bad_input)?;
    let out = outside(&args.out, &session)?;
    let Listed { files, left_out } = list(&session).map_err(bad_input)?;
    // The journal knows them as files; one that is left out would be missed by nobody.
    if let Some(what) = left_out.iter().find(|what| is_missed(what)) {
        return Err(bad_input(format!("{}: {what}: put what it stands for there itself", shown(&session))));
    }
    let mut bag = Bag::new(&out).map_err(at_path).map_err(bad_input)?;
    for file in &files {
        bag.copy(&session, file).map_err(at_path).map_err(anyhow::Error::msg)?;
    }
    let facts = facts(&manifest, &snapshot, &stored);
    let described = metadata(&facts, bag.payload());
    let bytes = described.len() as u64 + bag.payload().iter().map(|file| file.bytes).sum::<u64>();
    let words = words(&left_out);
    let loss = json!({"format": NAME, "same_numbers": true, "left_out": left_out, "loses": words.loses});
    let readme = readme_of(&format!("A session, exported by {SOFTWARE}: {ABOUT}\n"), &words);
    let tags = [(LOSS, format!("{loss:#}\n")), (README, readme)];
    let tags: Vec<(&str, &str)> = tags.iter().map(|(name, text)| (*name, text.as_str())).collect();
    bag.finish(&described, |payload| information(&facts, payload), &tags)
        .map_err(at_path)
        .map_err(anyhow::Error::msg)?;
    // The description is one of them.
    let count = files.len() + 1;
    if args.json {
        let summary = Summary { format: NAME, out: shown(&args.out), files: count, bytes, left_out };
        return Ok(print_line(serde_json::to_string_pretty(&summary)?)?);
    }
    let left = left_out.iter().map(|what| format!("left out {what}\n")).collect::<String>();
    Ok(print_line(format!(
        "{ABOUT}\nNothing is lost: the files are copied as they are.\n{left}{count} files, {bytes} bytes in {}",
        shown(&args.out)
    ))?)
}

/// Whether what is left out (`name: why`) is a part of the session, or a picture of it that is no unfinished file.
fn is_missed(what: &str) -> bool {
    let name = what.split(": ").next().unwrap_or(what);
    let picture = ["frames/", "radiance/"].iter().find_map(|folder| name.strip_prefix(folder));
    PARTS.contains(&name) || picture.is_some_and(|picture| !picture.starts_with('.'))
}

/// The session, if it has ended and all its frames are what was committed.
fn sound(session: &Path) -> anyhow::Result<(Manifest, SessionSnapshot)> {
    let refuse = |reason: String| bad_input(format!("{}: {reason}", shown(session)));
    let manifest = manifest::read(session).map_err(bad_input)?;
    if manifest.version.is_some() {
        return Err(refuse(
            "this is a calibration: give the result of a session; it holds a copy of its calibration".to_owned(),
        ));
    }
    let snapshot = look(session).map_err(bad_input)?;
    if !snapshot.state.is_final() {
        return Err(refuse(format!("the session is {}: wait until it has ended", snapshot.state)));
    }
    let verified = verify(session).map_err(bad_input)?;
    if let Some(first) = verified.faults.first() {
        let count = verified.faults.len();
        return Err(refuse(format!(
            "{count} of its files are not what was committed ({first}): see `rigd verify`; a crate must not certify them"
        )));
    }
    Ok((manifest, snapshot))
}

/// The directory of the bag; it must not lie in the session that it holds.
fn outside(out: &Path, session: &Path) -> anyhow::Result<PathBuf> {
    let absolute = std::path::absolute(out).map_err(|e| bad_input(format!("{}: {e}", shown(out))))?;
    let there = absolute.ancestors().find_map(|folder| Some((folder, folder.canonicalize().ok()?)));
    let new = there.as_ref().and_then(|(folder, _)| absolute.strip_prefix(folder).ok());
    if new.is_some_and(|new| new.components().any(|part| part == Component::ParentDir)) {
        return Err(bad_input(format!("{}: `..` leads out of a folder that is not there: correct --out", shown(out))));
    }
    if there.is_some_and(|(_, folder)| folder.starts_with(session)) {
        return Err(bad_input(format!("{}: this lies in the session itself: give another --out", shown(out))));
    }
    Ok(absolute)
}

fn facts<'a>(manifest: &'a Manifest, snapshot: &'a SessionSnapshot, stored: &'a StoredMaterial) -> Facts<'a> {
    Facts {
        id: &manifest.id,
        name: &manifest.name,
        started: &manifest.started,
        ended: snapshot.ended.as_deref().unwrap_or(&manifest.started),
        state: snapshot.state.to_string(),
        software: &manifest.software,
        fitted_by: &stored.material.provenance.software,
        simulated: manifest.simulated,
        arm: manifest.arm.as_deref(),
        camera: manifest.camera.as_deref(),
        calibration: stored.material.provenance.calibration.clone(),
        model: &stored.material.model,
        materials: stored.material.materials.len(),
    }
}

fn words(left_out: &[String]) -> Words {
    let mut loses = vec!["Nothing: the files are copied as they are.".to_owned()];
    loses.extend(left_out.iter().map(|what| format!("Left out: {what}.")));
    Words {
        carries: vec![
            "data/: every file of the session: frames, journal, manifest, calibration, radiance, dataset, result; ro-crate-metadata.json says what each is, and what was shot and fitted with which devices and programs.".to_owned(),
            "manifest-sha256.txt, tagmanifest-sha256.txt: hashes of all files.".to_owned(),
        ],
        loses,
        open: vec![
            "bagit.py --validate FOLDER (pip install bagit) checks every file; any RO-Crate reader opens data/.".to_owned(),
            "rigd fit data --out DIR fits the material again.".to_owned(),
        ],
    }
}
