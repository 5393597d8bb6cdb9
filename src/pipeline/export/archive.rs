//! A whole session as a research object: RO-Crate 1.2 metadata, and the tag files of the BagIt bag (RFC 8493) around it.

use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Name of the format.
pub const NAME: &str = "crate";
/// What it is.
pub const ABOUT: &str = "the whole session as RO-Crate 1.2 in a BagIt bag";

/// The description of a crate, at the root of its files.
pub const METADATA: &str = "ro-crate-metadata.json";
/// Folder of a bag that holds the files.
pub const DATA: &str = "data";

/// A file of the session.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Payload {
    /// Path inside the session, parts separated by `/`.
    pub path: String,
    /// Its size.
    pub bytes: u64,
    /// SHA-256, hexadecimal.
    pub sha256: String,
}

/// What is told of a session.
#[derive(Clone, Debug)]
pub struct Facts<'a> {
    /// Its id, a UUID.
    pub id: &'a str,
    /// Name of the sampled object.
    pub name: &'a str,
    /// When it began and when it ended, RFC 3339.
    pub started: &'a str,
    /// See `started`.
    pub ended: &'a str,
    /// How it ended, in a word.
    pub state: String,
    /// Program that shot it, and program that fitted it, with versions.
    pub software: &'a str,
    /// See `software`.
    pub fitted_by: &'a str,
    /// True where arm or camera is simulated.
    pub simulated: bool,
    /// Firmware of the arm.
    pub arm: Option<&'a str>,
    /// Model of the camera.
    pub camera: Option<&'a str>,
    /// The calibration it uses, in words.
    pub calibration: Option<String>,
    /// Model of the fitted material, number of materials.
    pub model: &'a str,
    /// See `model`.
    pub materials: usize,
}

/// What a folder or a file of a session is; the rest needs no words.
const MEANINGS: [(&str, &str); 9] = [
    ("frames/", "Frames as the camera wrote them: station and exposure, counted from 0"),
    (
        "radiance/",
        "Linear radiance of each light position, merged from its bracket, with variance and validity (OpenEXR)",
    ),
    ("result/", "The fitted material: BRDF parameters, material weight maps, report"),
    ("dataset.toml", "Camera, object and lights: makes the session a dataset that can be fitted again"),
    ("manifest.json", "Plan, rig file, software and devices of the session"),
    (
        "journal.jsonl",
        "What happened, one JSON object a line, chained by hashes; names each frame with its blake3 hash",
    ),
    ("calibration.json", "Copy of the calibration that the session uses: camera, response, lights"),
    ("result/material.json", "BRDF parameters with standard errors, model, gauge, provenance"),
    ("result/weights.exr", "Material weight map, one channel a material"),
];

fn meaning(path: &str) -> Option<&'static str> {
    MEANINGS.iter().find(|(name, _)| *name == path).map(|(_, meaning)| *meaning)
}

/// Media type by the ending of a name.
fn media_type(path: &str) -> &'static str {
    match path.rsplit_once('.').map_or("", |(_, ending)| ending).to_lowercase().as_str() {
        "jpg" | "jpeg" => "image/jpeg",
        "cr2" => "image/x-canon-cr2",
        "exr" => "image/x-exr",
        "png" => "image/png",
        "json" => "application/json",
        "jsonl" => "application/jsonl",
        "toml" => "application/toml",
        _ => "application/octet-stream",
    }
}

/// A path as URI reference (RFC 3986): all but letters, digits and `-._~/` as percent codes.
fn reference(path: &str) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~/".contains(&byte);
    path.bytes().map(|b| if plain(b) { char::from(b).to_string() } else { format!("%{b:02X}") }).collect()
}

fn id(of: &str) -> Value {
    json!({ "@id": of })
}

/// Every folder with what lies directly in it, as references; the root is the empty name.
fn folders(files: &[Payload]) -> BTreeMap<String, Vec<Value>> {
    let mut folders: BTreeMap<String, Vec<Value>> = BTreeMap::from([(String::new(), Vec::new())]);
    for file in files {
        let mut inside = file.path.clone();
        loop {
            let cut = inside.trim_end_matches('/').rfind('/').map_or(0, |at| at + 1);
            let folder = inside[..cut].to_owned();
            let known = folders.contains_key(&folder);
            folders.entry(folder.clone()).or_default().push(id(&reference(&inside)));
            if known {
                break;
            }
            inside = folder;
        }
    }
    folders
}

/// `ro-crate-metadata.json` for these files.
pub fn metadata(facts: &Facts<'_>, files: &[Payload]) -> String {
    let mut folders = folders(files);
    let parts = folders.remove("").unwrap_or_default();
    let mut graph = vec![
        json!({
            "@id": METADATA,
            "@type": "CreativeWork",
            "about": id("./"),
            "conformsTo": id("https://w3id.org/ro/crate/1.2"),
        }),
        root(facts, parts),
    ];
    graph.extend(folders.into_iter().map(|(folder, parts)| {
        let mut entity = json!({"@id": reference(&folder), "@type": "Dataset", "name": folder, "hasPart": parts});
        if let Some(meaning) = meaning(&folder) {
            entity["description"] = json!(meaning);
        }
        entity
    }));
    graph.extend(files.iter().map(file));
    graph.extend(context(facts, files));
    let told = json!({"@context": "https://w3id.org/ro/crate/1.2/context", "@graph": graph});
    format!("{told:#}\n")
}

fn root(facts: &Facts<'_>, parts: Vec<Value>) -> Value {
    let by = if facts.simulated { "simulated rig" } else { "rig" };
    let made = format!(
        "Light positions and exposures of one object on a {by}, linear radiance, and the material fitted to it ({} materials, BRDF model {}). The session ended {}.",
        facts.materials, facts.model, facts.state
    );
    json!({
        "@id": "./",
        "@type": "Dataset",
        "name": format!("Material capture of {}", facts.name),
        "description": made,
        "datePublished": facts.ended,
        "identifier": format!("urn:uuid:{}", facts.id),
        "license": id("#licence"),
        "hasPart": parts,
        "mentions": [id("#capture"), id("#fit")],
    })
}

fn file(file: &Payload) -> Value {
    let mut entity = json!({
        "@id": reference(&file.path),
        "@type": "File",
        "name": file.path,
        "encodingFormat": media_type(&file.path),
        "contentSize": file.bytes.to_string(),
        "sha256": file.sha256,
    });
    if let Some(meaning) = meaning(&file.path) {
        entity["description"] = json!(meaning);
    }
    entity
}

/// Devices, programs, and what they did.
fn context(facts: &Facts<'_>, files: &[Payload]) -> Vec<Value> {
    let there = |names: &[&str]| -> Vec<Value> {
        let is_there = |name: &&&str| {
            files.iter().any(|file| file.path == **name || name.ends_with('/') && file.path.starts_with(**name))
        };
        names.iter().filter(is_there).map(|name| id(name)).collect()
    };
    let program = |name: &str, software: &str| {
        let (program, version) = software.split_once(' ').unwrap_or((software, ""));
        json!({"@id": name, "@type": "SoftwareApplication", "name": program, "softwareVersion": version})
    };
    let device = |name: &str, kind: &str, model: Option<&str>| json!({"@id": name, "@type": "IndividualProduct", "name": kind, "model": model.unwrap_or("not known")});
    let object = facts.calibration.as_ref().map(|_| id("calibration.json"));
    let mut all = vec![
        json!({
            "@id": "#licence",
            "@type": "CreativeWork",
            "name": "No licence is stated",
            "description": "The session does not say under which licence its files may be used: ask who shot it.",
        }),
        device("#camera", "camera", facts.camera),
        device("#arm", "lamp on a motorised arm", facts.arm),
        program("#shot-by", facts.software),
        program("#fitted-by", facts.fitted_by),
        json!({
            "@id": "#capture",
            "@type": "CreateAction",
            "name": format!("Capture of {}", facts.name),
            "startTime": facts.started,
            "endTime": facts.ended,
            "instrument": [id("#camera"), id("#arm"), id("#shot-by")],
            "result": there(&["frames/", "radiance/", "dataset.toml", "manifest.json", "journal.jsonl"]),
        }),
        json!({
            "@id": "#fit",
            "@type": "CreateAction",
            "name": "Fit of the material",
            "instrument": id("#fitted-by"),
            "object": there(&["dataset.toml", "radiance/"]),
            "result": there(&["result/"]),
        }),
    ];
    if let (Some(object), Some(words)) =
        (object.filter(|_| !there(&["calibration.json"]).is_empty()), &facts.calibration)
    {
        all[5]["object"] = object;
        all[5]["description"] = json!(words);
    }
    all
}

/// `bagit.txt`.
pub const DECLARATION: &str = "BagIt-Version: 1.0\nTag-File-Character-Encoding: UTF-8\n";

/// `bag-info.txt`. It has no date of the bag: the same session makes the same bag.
pub fn information(facts: &Facts<'_>, files: &[Payload]) -> String {
    let bytes: u64 = files.iter().map(|file| file.bytes).sum();
    let line = |text: &str| text.split_whitespace().collect::<Vec<&str>>().join(" ");
    format!(
        "Bag-Software-Agent: {}\nExternal-Description: {}\nExternal-Identifier: urn:uuid:{}\nPayload-Oxum: {bytes}.{}\n",
        line(facts.software),
        line(&format!("Material capture of {}, {} to {}", facts.name, facts.started, facts.ended)),
        line(facts.id),
        files.len()
    )
}

/// A manifest of hashes; CR, LF and % in a path as percent codes (RFC 8493, 2.1.3).
pub fn manifest<'a>(lines: impl Iterator<Item = (&'a str, String)>) -> String {
    let line = |(hash, path): (&str, String)| {
        let path = path.replace('%', "%25").replace('\n', "%0A").replace('\r', "%0D");
        format!("{hash}  {path}\n")
    };
    lines.map(line).collect()
}
