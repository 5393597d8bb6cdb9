//! Session reports: they say what the files say, no text of a file gets out of its place, the same session gives the same bytes, and what is
//! damaged or lacking is named. The PDF is read by other programs in tests/report/check.py.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod daemon;
mod reported;

use daemon::{Daemon, program, shipped};
use reported::{HOSTILE, ID, LIGHTS, Written, write, write_result};
use rigd::document::{Block, Document, Picture, Table, html, pdf};
use rigd::session::report::{ReportError, of_result, of_session};
use serde_json::json;
use std::path::Path;
use std::process::{Command, Output};

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

fn of(written: &Written) -> (tempfile::TempDir, Document) {
    let data = folder();
    let directory = write(data.path(), written);
    let document = of_session(&directory).unwrap();
    (data, document)
}

fn table<'a>(document: &'a Document, caption: &str) -> &'a Table {
    let tables =
        document.blocks.iter().filter_map(|block| if let Block::Table(table) = block { Some(table) } else { None });
    tables.into_iter().find(|table| table.caption.starts_with(caption)).unwrap_or_else(|| panic!("no table {caption}"))
}

/// The cell beside the row's name.
fn cell<'a>(document: &'a Document, caption: &str, row: &str, column: usize) -> &'a str {
    let found = table(document, caption).rows.iter().find(|cells| cells[0].starts_with(row));
    &found.unwrap_or_else(|| panic!("no row {row} in {caption}"))[column]
}

fn says(document: &Document, words: &str) -> bool {
    document.blocks.iter().any(|block| match block {
        Block::Paragraph(text) | Block::Warning(text) | Block::Section(text) => text.contains(words),
        _ => false,
    })
}

#[test]
fn it_says_what_the_files_say() {
    let (data, document) = of(&Written::default());
    let errors = "Errors: mean";
    assert_eq!(cell(&document, errors, "all samples", 1), "1.23 %");
    assert_eq!(cell(&document, errors, "highlights", 1), "2.34 %");
    assert_eq!(cell(&document, errors, "left-out lights", 1), "4.56 %");
    assert_eq!(cell(&document, errors, "their highlights", 1), "none: they have no highlight");
    for (light, (error, used)) in
        [("1.11 %", "fitted"), ("4.56 %", "left out, predicted"), ("1.35 %", "fitted")].iter().enumerate()
    {
        let name = light.to_string();
        assert_eq!(cell(&document, "Error of each light", &name, 4), *error);
        assert_eq!(cell(&document, "Error of each light", &name, 2), *used);
        assert_eq!(cell(&document, "Error of each light", &name, 3), (1000 + light).to_string());
    }
    assert_eq!(cell(&document, "Material 1: 62.5 %", "diffuse blue", 1), "0.41235 \u{b1} 0.00032");
    assert_eq!(cell(&document, "Material 1", "specular green", 2), "weakly");
    // What the data do not determine is shown nowhere as a value.
    assert_eq!(cell(&document, "Material 2", "roughness", 1), "not determined");
    assert!(!html::write(&document).contains("0.98765"));
    assert_eq!(cell(&document, "Shutter times", "1/8", 3), "1.00 %");
    assert_eq!(cell(&document, "Shutter times", "1/8", 4), "0.21 %");
    assert_eq!(cell(&document, "The session", "Frames that count", 1), "24 of 24 planned");
    assert!(cell(&document, "Refused frames", "2026-11-30 20:30:11 UTC", 1).starts_with("station 3, exposure 0"));
    assert_eq!(cell(&document, "Faults", "2026-11-30 20:30:12 UTC", 1), "arm: fault");
    assert!(says(&document, "changed by -3.00 % at most since the first"));
    assert!(says(&document, "a warning of the fit"));
    assert!(says(&document, "test frames, the last three within 0.12 %"));
    let journal = std::fs::read_to_string(data.path().join("sessions").join(ID).join("journal.jsonl")).unwrap();
    let last = blake3::hash(journal.lines().last().unwrap().as_bytes()).to_hex().to_string();
    assert_eq!(cell(&document, "Hashes", "journal.jsonl", 1), last);
    let hash = |name: &str| {
        blake3::hash(&std::fs::read(data.path().join("sessions").join(ID).join(name)).unwrap()).to_hex().to_string()
    };
    for name in ["manifest.json", "result/report.json", "result/weights.exr"] {
        assert_eq!(cell(&document, "Hashes", name, 1), hash(name));
    }
    assert_eq!(cell(&document, "Hashes", "result/preview.png", 1), "the file is not there");
}

/// The object is shown near the top where the result has its picture; a map and its scale are one block.
#[test]
fn it_shows_the_object_and_keeps_maps_with_their_scales() {
    let (data, without) = of(&Written::default());
    assert!(says(&without, "preview.png is missing"));
    let directory = data.path().join("sessions").join(ID);
    let preview = directory.join("result").join("preview.png");
    image::RgbImage::from_fn(30, 20, |x, y| image::Rgb([x as u8, y as u8, 7])).save(&preview).unwrap();
    let document = of_session(&directory).unwrap();
    let pictures = |blocks: &[Block]| -> Vec<Picture> {
        blocks
            .iter()
            .filter_map(|b| if let Block::Picture(picture) = b { Some(picture.clone()) } else { None })
            .collect()
    };
    let warnings =
        document.blocks.iter().position(|b| *b == Block::Section("Warnings, and what to do".into())).unwrap();
    let [shown] = &pictures(&document.blocks[..warnings])[..] else { panic!("one picture before the warnings") };
    assert_eq!((shown.size, shown.scale.is_none()), ([30, 20], true));
    let pixels = image::load_from_memory(&shown.png).unwrap().into_rgb8();
    assert_eq!(pixels.get_pixel(29, 19).0, [29, 19, 7]);
    let maps = pictures(&document.blocks[warnings..]);
    assert!(maps.len() == 3 && maps.iter().all(|map| map.scale.is_some()));
    std::fs::write(&preview, b"\x89PNG\r\n\x1a\n").unwrap();
    let refusal = of_session(&directory).unwrap_err().to_string();
    assert!(refusal.contains("preview.png") && refusal.contains("fit again"), "{refusal}");
}

/// Places in the drawings are the values of the files: lights at their errors, time at stations.
#[test]
fn its_drawings_hold_the_values() {
    use rigd::document::drawing::Shape;
    let (_data, document) = of(&Written::default());
    let drawings = document
        .blocks
        .iter()
        .filter_map(|block| if let Block::Drawing(drawing) = block { Some(drawing) } else { None });
    let by_light = drawings.clone().find(|drawing| drawing.caption.starts_with("Error of each light")).unwrap();
    let discs: Vec<(f64, bool)> = by_light
        .shapes
        .iter()
        .filter_map(|s| if let Shape::Disc { at, hollow, .. } = s { Some((at[1], *hollow)) } else { None })
        .collect();
    // Fitted lights, the key's disc, the left-out light: in the order of the series, keys last.
    let [first, third, left_out, ..] = discs[..] else { panic!("{discs:?}") };
    assert_eq!((first.1, third.1, left_out.1), (false, false, true));
    let part = (first.0 - third.0) / (first.0 - left_out.0);
    let want = (LIGHTS[2] - LIGHTS[0]) / (LIGHTS[1] - LIGHTS[0]);
    assert!((part - want).abs() < 1e-9, "{part} {want}");
    let by_station =
        drawings.clone().find(|drawing| drawing.caption.starts_with("Time from the arm's arrival")).unwrap();
    let bars: Vec<f64> = by_station
        .shapes
        .iter()
        .filter_map(|s| if let Shape::Area { points, .. } = s { Some(points[1][1]) } else { None })
        .collect();
    assert_eq!(bars.len(), reported::stations().len());
    assert!(bars.iter().all(|top| (top - bars[0]).abs() < 1e-9), "every bracket takes 40 s: {bars:?}");
}

#[test]
fn no_text_of_a_file_gets_out_of_its_place() {
    let hostile = Written { name: HOSTILE.into(), reason: HOSTILE.into(), ..Written::default() };
    let (_data, document) = of(&hostile);
    let page = html::write(&document);
    assert!(page.matches("&lt;script&gt;alert(&#39;1&#39;)&lt;/script&gt;").count() > 10, "the names are not shown");
    for forbidden in
        ["<script", "<img src=x", "onerror=alert(2)>", "\u{202e}", "\u{0}", "\u{1b}", "http://", "https://"]
    {
        assert!(!page.contains(forbidden), "{forbidden:?} is in the page");
    }
    let printed = pdf::write(&document);
    assert!(printed.starts_with(b"%PDF-") && printed.ends_with(b"%%EOF"));
}

#[test]
fn the_same_session_gives_the_same_bytes_wherever_it_lies() {
    let (_one, first) = of(&Written::default());
    let (_two, second) = of(&Written::default());
    assert_eq!(html::write(&first), html::write(&second));
    assert_eq!(pdf::write(&first), pdf::write(&second));
}

#[test]
fn what_a_session_lacks_is_said() {
    let failed = json!({"type": "fit.finished", "error": "no valid samples"});
    let (_data, document) = of(&Written { fitted: false, records: vec![failed], ..Written::default() });
    assert!(says(&document, "No material was fitted: no valid samples. What to do"));
    assert!(says(&document, "This session used no calibration"));
    assert!(says(&document, "no time budget"));
    assert!(says(&document, "`rigd verify` has not found it sound"));
    assert_eq!(
        cell(&document, "The rig", "Lens", 1),
        "not known: the first frame is not there, or is not what was committed"
    );
    let out = folder();
    write_result(out.path(), &Written::default());
    let bare = of_result(out.path()).unwrap();
    assert!(says(&bare, "does not say how that was captured"));
    assert!(!says(&bare, "The lamp") && !says(&bare, "What was captured"));
    assert_eq!(cell(&bare, "Errors: mean", "all samples", 1), "1.23 %");
}

#[test]
fn what_is_damaged_is_refused_by_name() {
    let spoil = |name: &str, change: &dyn Fn(&[u8]) -> Vec<u8>| {
        let data = folder();
        let directory = write(data.path(), &Written::default());
        let path = directory.join(name);
        std::fs::write(&path, change(&std::fs::read(&path).unwrap())).unwrap();
        of_session(&directory).unwrap_err()
    };
    let half = |bytes: &[u8]| bytes[..bytes.len() / 2].to_vec();
    let changed =
        |bytes: &[u8]| String::from_utf8_lossy(bytes).replacen("\"frames\":4", "\"frames\":5", 1).into_bytes();
    let foreign = |bytes: &[u8]| String::from_utf8_lossy(bytes).replace("0.0625", "-1.0").into_bytes();
    for (name, error, typed) in [
        ("manifest.json", spoil("manifest.json", &half), "store"),
        ("journal.jsonl", spoil("journal.jsonl", &changed), "damaged"),
        ("journal.jsonl", spoil("journal.jsonl", &|_| Vec::new()), "damaged"),
        ("report.json", spoil("result/report.json", &half), "damaged"),
        ("material.json", spoil("result/material.json", &foreign), "result"),
        ("weights.exr", spoil("result/weights.exr", &half), "result"),
        ("residual.exr", spoil("result/residual.exr", &half), "damaged"),
    ] {
        let found = match &error {
            ReportError::Store(_) => "store",
            ReportError::Result(_) => "result",
            ReportError::Damaged { .. } => "damaged",
            ReportError::Nothing { .. } => "nothing",
        };
        assert_eq!(found, typed, "{error}");
        assert!(error.to_string().contains(name), "{error}");
    }
    assert!(matches!(of_result(folder().path()), Err(ReportError::Nothing { .. })));
}

fn rigd(arguments: &[&Path]) -> Output {
    Command::new(program()).arg("report").args(arguments).output().unwrap()
}

#[test]
fn the_command_writes_both_files_and_never_over_an_input() {
    let data = folder();
    let directory = write(data.path(), &Written::default());
    let (out, named) = (data.path().join("out"), data.path().join(ID));
    let done = rigd(&[&named, Path::new("--out"), &out]);
    assert!(done.status.success(), "{done:?}");
    let document = of_session(&directory).unwrap();
    assert_eq!(std::fs::read_to_string(out.join("report.html")).unwrap(), html::write(&document));
    assert_eq!(std::fs::read(out.join("report.pdf")).unwrap(), pdf::write(&document));
    std::os::unix::fs::symlink(directory.join("journal.jsonl"), directory.join("report.html")).unwrap();
    let before = std::fs::read(directory.join("journal.jsonl")).unwrap();
    let over = rigd(&[&directory, Path::new("--out"), &directory]);
    assert_eq!(over.status.code(), Some(2), "{over:?}");
    assert!(String::from_utf8_lossy(&over.stderr).contains("written over"), "{over:?}");
    assert_eq!(std::fs::read(directory.join("journal.jsonl")).unwrap(), before);
    let nothing = rigd(&[&data.path().join("elsewhere")]);
    assert_eq!(nothing.status.code(), Some(2), "{nothing:?}");
    assert!(String::from_utf8_lossy(&nothing.stderr).contains("DATA/ID"), "{nothing:?}");
}

#[test]
fn the_daemon_makes_the_same() {
    let folder = folder();
    let data = folder.path().join("data");
    let directory = write(&data, &Written { name: HOSTILE.into(), ..Written::default() });
    let daemon = Daemon::start_with(folder, shipped(), &data);
    let page = daemon.get(&format!("/v1/sessions/{ID}/report"));
    let document = of_session(&directory).unwrap();
    assert_eq!((page.status, page.header("content-type")), (200, Some("text/html; charset=utf-8")));
    assert!(page.header("content-security-policy").unwrap().starts_with("default-src 'none'"));
    assert_eq!(page.text, html::write(&document));
    let printed = daemon.get(&format!("/v1/sessions/{ID}/report.pdf"));
    assert_eq!((printed.status, printed.header("content-type")), (200, Some("application/pdf")));
    assert_eq!(printed.text, String::from_utf8_lossy(&pdf::write(&document)));
    assert_eq!(daemon.get("/v1/sessions/01a208e9-cbda-76fb-b465-63318274b666/report").status, 404);
    std::fs::write(directory.join("result/report.json"), "{").unwrap();
    let damaged = daemon.get(&format!("/v1/sessions/{ID}/report"));
    assert_eq!(damaged.status, 409);
    assert!(damaged.json()["detail"].as_str().unwrap().contains("report.json"), "{}", damaged.text);
}
