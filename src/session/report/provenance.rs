//! Hashes of what the report was made of, and how to verify them.

use super::ReportError;
use super::sources::{Fitted, Session};
use crate::document::{Block, Table};
use crate::store::files::{check_regular, shown};
use crate::store::{result, verified};
use std::fs::File;
use std::path::Path;

pub fn of_session(session: &Session) -> Result<Vec<Block>, ReportError> {
    let mut table = Table::new("Hashes (blake3)", ["What", "Hash"]);
    let head = session.journal.head.hash.clone().unwrap_or_default();
    table.row([format!("journal.jsonl, its last record ({})", session.journal.head.records), head]);
    let config = blake3::hash(session.manifest.rig_file.as_bytes()).to_hex().to_string();
    table.row(["rig file, as it stands in manifest.json".into(), config]);
    for name in ["manifest.json", "calibration.json", "dataset.toml"] {
        table.row([name.into(), hash(&session.directory.join(name))?]);
    }
    for name in result::FILES {
        table.row([format!("result/{name}"), hash(&session.directory.join("result").join(name))?]);
    }
    let id = &session.manifest.id;
    let mut blocks = vec![
        Block::Section("Provenance".into()),
        Block::text(
            "Every line of the journal holds the hash of the line before, and every frame's hash stands in its line: the last record's hash stands for all that \
             was recorded. This report was made of the files with the hashes below and nothing else; made again of the same files, it is the same, byte for byte.",
        ),
        Block::Table(table),
        Block::Heading("How to verify".into()),
        Block::List(vec![
            format!("`rigd verify DATA/sessions/{id}` reads every frame and walks the journal; exit status 0: all is what was committed."),
            "`tail -n 1 journal.jsonl | tr -d '\\n' | b3sum` gives the hash of the last record, `b3sum FILE` that of a file, \
             `jq -j .rig_file manifest.json | b3sum` that of the rig file."
                .into(),
            format!("`rigd report DATA/{id} --out DIR` makes this report again."),
        ]),
    ];
    blocks.push(Block::text(verified_words(session)));
    blocks.extend(session.fitted.as_ref().map(of_material));
    Ok(blocks)
}

fn verified_words(session: &Session) -> String {
    match verified::holds(&session.directory) {
        Ok(true) => {
            "`rigd verify` found every frame sound, and nothing was journalled since (verified.json says when).".into()
        }
        Ok(false) => "`rigd verify` has not found it sound as it stands: verify it before you rely on it.".into(),
        Err(error) => format!("What `rigd verify` found cannot be read: {error}."),
    }
}

pub fn of_result(fitted: &Fitted) -> Result<Vec<Block>, ReportError> {
    let mut table = Table::new("Hashes (blake3)", ["What", "Hash"]);
    for name in result::FILES {
        table.row([name.into(), hash(&fitted.directory.join(name))?]);
    }
    Ok(vec![
        Block::Section("Provenance".into()),
        Block::Table(table),
        Block::text(
            "`b3sum FILE` gives the hash of a file. The dataset is not part of the result, so its hash is not known here.",
        ),
        of_material(fitted),
    ])
}

/// What the material says of itself.
fn of_material(fitted: &Fitted) -> Block {
    let provenance = &fitted.material.provenance;
    let calibration = provenance.calibration.as_deref().unwrap_or("none named");
    let images: Vec<&str> = provenance.images.iter().map(String::as_str).collect();
    Block::text(format!(
        "material.json: fitted by {}, calibration: {calibration}, images: {}.",
        provenance.software,
        images.join(", ")
    ))
}

fn hash(path: &Path) -> Result<String, ReportError> {
    if !path.exists() {
        return Ok("the file is not there".into());
    }
    let damaged = |reason: String| ReportError::Damaged { path: shown(path), reason };
    check_regular(path, "file").map_err(damaged)?;
    let mut hasher = blake3::Hasher::new();
    File::open(path).and_then(|file| hasher.update_reader(file).map(|_| ())).map_err(|e| damaged(e.to_string()))?;
    Ok(hasher.finalize().to_hex().to_string())
}
