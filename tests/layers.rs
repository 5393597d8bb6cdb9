//! Enforces the import rules of ARCHITECTURE.md on the text of every file under src/.
//!
//! Unit tests inside a file (`#[cfg(test)] mod tests`, by convention its last item) are free to import what they need.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::collections::HashSet;
use std::fs;
use std::path::Path;

/// What one top-level module may import of the others, and which outside names it must not.
struct Rule {
    module: &'static str,
    /// Prefixes of paths inside the crate; its own module is always allowed.
    may: &'static [&'static str],
    /// Exceptions from `may`.
    but_not: &'static [&'static str],
    /// Prefixes of paths outside the crate.
    never: &'static [&'static str],
}

const AXUM: &[&str] = &["axum", "hyper", "hyper_util", "tokio_rustls", "utoipa_axum", "tower_http"];
const OUTSIDE_WORLD: &[&str] =
    &["std::env", "std::fs", "std::io", "std::net", "std::os", "std::path", "std::process", "std::time"];
/// The only packages that numerics may use; thiserror only words its errors.
const NUMERIC_PACKAGES: &[&str] = &["nalgebra", "rayon", "thiserror"];

const RULES: &[Rule] = &[
    Rule { module: "numerics", may: &[], but_not: &[], never: OUTSIDE_WORLD },
    Rule {
        module: "pipeline",
        may: &["numerics"],
        but_not: &[],
        never: &["tokio", "tokio_stream", "tokio_util", "std::fs", "std::net", "std::path"],
    },
    Rule { module: "document", may: &[], but_not: &[], never: OUTSIDE_WORLD },
    Rule { module: "devices", may: &[], but_not: &[], never: &[] },
    Rule { module: "store", may: &["pipeline", "numerics"], but_not: &[], never: &[] },
    // The simulated world may share forward models with the fit, never its inverse steps.
    Rule {
        module: "sim",
        may: &["devices", "numerics"],
        but_not: &["numerics::fit", "numerics::radiometry::merge"],
        never: &[],
    },
    Rule { module: "study", may: &["sim", "store", "pipeline", "numerics"], but_not: &[], never: &[] },
    Rule {
        module: "session",
        may: &["document", "devices", "store", "pipeline", "numerics"],
        but_not: &[],
        never: &[],
    },
    Rule { module: "notify", may: &["session::handle", "session::state"], but_not: &[], never: &["tokio"] },
    Rule {
        module: "http",
        may: &["session::handle", "session::plan", "session::state", "notify::Count"],
        but_not: &[],
        never: &["nalgebra", "rayon", "serialport"],
    },
];
/// The composition root imports what it likes.
const ROOT: &[&str] = &["cli", "main", "lib"];

#[test]
fn every_module_imports_only_what_its_layer_allows() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let packages = dependencies(&fs::read_to_string(root.join("Cargo.toml")).unwrap());
    assert!(packages.contains("axum") && packages.contains("tokio"), "the dependencies were not read: {packages:?}");
    let mut files = Vec::new();
    collect(&root.join("src"), &mut files);
    assert!(files.len() > 30, "only {} files found", files.len());
    let mut found = Vec::new();
    for file in files {
        let name = file.strip_prefix(root.join("src")).unwrap().to_str().unwrap().to_owned();
        found.extend(violations(&name, &fs::read_to_string(&file).unwrap(), &packages));
    }
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

fn collect(directory: &Path, files: &mut Vec<std::path::PathBuf>) {
    for entry in fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

/// Names in `[dependencies]` as code spells them.
fn dependencies(manifest: &str) -> HashSet<String> {
    let section = manifest.split("\n[dependencies]\n").nth(1).unwrap().split("\n[").next().unwrap();
    section.lines().filter_map(|line| line.split_once(" = ")).map(|(name, _)| name.replace('-', "_")).collect()
}

/// Every broken rule in one file; `name` is its path below src/.
fn violations(name: &str, source: &str, packages: &HashSet<String>) -> Vec<String> {
    let module: Vec<&str> = name.trim_end_matches(".rs").split('/').filter(|part| *part != "mod").collect();
    let top = module[0];
    let rule = RULES.iter().find(|rule| rule.module == top);
    if rule.is_none() && !ROOT.contains(&top) {
        return vec![format!("src/{name}: no layer is set for `{top}`: add it to tests/layers.rs")];
    }
    let scan = Scan::of(&without_tests(source));
    let mut found = HashSet::new();
    for path in &scan.paths {
        let wrong = match inside(path, &module) {
            Some(path) => rule.is_some_and(|rule| !may_import(rule, &path)),
            None if scan.bound.contains(&path[0]) => false,
            None => !may_use(rule, top, path, packages),
        };
        if wrong {
            found.insert(format!("src/{name}: {top} must not import {}", path.join("::")));
        }
    }
    let mut found: Vec<String> = found.into_iter().collect();
    found.sort();
    found
}

/// The path from the crate's root, if it is one of this crate's.
fn inside(path: &[String], module: &[&str]) -> Option<Vec<String>> {
    let supers = path.iter().take_while(|part| *part == "super").count();
    let (base, skip) = match path[0].as_str() {
        "crate" | "rigd" => (0, 1),
        "self" => (module.len(), 1),
        "super" => (module.len().saturating_sub(supers), supers),
        _ => return None,
    };
    Some(module[..base].iter().map(|part| (*part).to_owned()).chain(path[skip..].iter().cloned()).collect())
}

fn may_import(rule: &Rule, path: &[String]) -> bool {
    is_under(path, rule.module) || is_under_any(path, rule.may) && !is_under_any(path, rule.but_not)
}

fn may_use(rule: Option<&Rule>, top: &str, path: &[String], packages: &HashSet<String>) -> bool {
    let axum_here = top == "http" || ROOT.contains(&top);
    let foreign_to_numerics = packages.contains(&path[0]) && !NUMERIC_PACKAGES.contains(&path[0].as_str());
    !(is_under_any(path, AXUM) && !axum_here
        || is_under_any(path, &["exr", "rusqlite"]) && top != "store"
        || top == "numerics" && foreign_to_numerics
        || rule.is_some_and(|rule| is_under_any(path, rule.never)))
}

fn is_under_any(path: &[String], prefixes: &[&str]) -> bool {
    prefixes.iter().any(|prefix| is_under(path, prefix))
}

fn is_under(path: &[String], prefix: &str) -> bool {
    let mut parts = path.iter();
    prefix.split("::").all(|part| parts.next().is_some_and(|own| own == part))
}

/// The text before the file's own unit tests.
fn without_tests(source: &str) -> String {
    let mut lines: Vec<&str> = Vec::new();
    let mut rest = source.lines().peekable();
    while let Some(line) = rest.next() {
        if line == "#[cfg(test)]"
            && rest.peek().is_some_and(|next| next.trim_start_matches("pub(crate) ").starts_with("mod tests {"))
        {
            break;
        }
        lines.push(line);
    }
    lines.join("\n")
}

/// The paths a text names, and the names its `use` and `mod` items bind.
#[derive(Default)]
struct Scan {
    paths: Vec<Vec<String>>,
    bound: HashSet<String>,
}

impl Scan {
    fn of(source: &str) -> Self {
        let tokens = tokens(source);
        let mut scan = Self::default();
        let mut at = 0;
        while at < tokens.len() {
            let in_use = at > 0 && tokens[at - 1] == "use";
            let starts = is_name(&tokens[at]) && tokens.get(at + 1).is_some_and(|next| next == "::") || in_use;
            if at > 0 && tokens[at - 1] == "mod" {
                scan.bound.insert(tokens[at].clone());
            }
            if starts {
                // `use<'a>` in a type is followed by no path: go on in any case.
                at = scan.tree(&tokens, at, &mut Vec::new(), in_use).max(at + 1);
            } else {
                at += 1;
            }
        }
        scan
    }

    /// Reads `a::b::{c, d as e, f::*}` from `at`; returns the place behind it.
    fn tree(&mut self, tokens: &[String], mut at: usize, prefix: &mut Vec<String>, in_use: bool) -> usize {
        let depth = prefix.len();
        while let Some(token) = tokens.get(at) {
            match token.as_str() {
                "::" => {}
                "{" => {
                    at += 1;
                    while tokens.get(at).is_some_and(|token| token != "}") {
                        at = self.tree(tokens, at, prefix, in_use) + 1;
                        if tokens.get(at - 1).is_some_and(|token| token == "}") {
                            at -= 1;
                        }
                    }
                    prefix.truncate(depth);
                    return at + 1;
                }
                name if is_name(name) => prefix.push(name.to_owned()),
                _ => break,
            }
            at += 1;
            let goes_on = tokens.get(at).is_some_and(|next| next == "::") || tokens[at - 1] == "::";
            if !goes_on {
                break;
            }
        }
        let own = prefix[..].last().cloned();
        let renamed = tokens.get(at).is_some_and(|token| token == "as");
        let name = if renamed { tokens.get(at + 1).cloned() } else { own };
        if in_use && prefix.first().is_some_and(|first| ["crate", "self", "super", "rigd"].contains(&first.as_str())) {
            self.bound.extend(name);
        }
        if !prefix.is_empty() {
            self.paths.push(prefix.clone());
        }
        prefix.truncate(depth);
        at + if renamed { 2 } else { 0 }
    }
}

fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphabetic() || c == '_') && !KEYWORDS.contains(&token)
}

/// Words that may stand before a path beginning with `::` and are no part of it.
const KEYWORDS: &[&str] = &["as", "dyn", "else", "for", "impl", "in", "match", "mut", "return", "use", "where"];

/// Names, `::`, and single other characters; comments, strings and characters are left out.
fn tokens(source: &str) -> Vec<String> {
    let text: Vec<char> = source.chars().collect();
    let (mut tokens, mut at) = (Vec::new(), 0);
    while at < text.len() {
        let rest = &text[at..];
        match rest {
            ['/', '/', ..] => at += rest.iter().position(|c| *c == '\n').unwrap_or(rest.len()),
            ['/', '*', ..] => {
                at += 2 + rest.windows(2).skip(2).position(|w| w == ['*', '/']).map_or(rest.len(), |n| n + 2)
            }
            ['r', '"', ..] | ['r', '#', '"' | '#', ..] => at += raw_string(rest),
            ['"', ..] => at += string(rest),
            ['\'', '\\', _, ..] => at += 3 + rest.iter().skip(3).position(|c| *c == '\'').unwrap_or(0) + 1,
            ['\'', _, '\'', ..] => at += 3,
            [':', ':', ..] => {
                tokens.push("::".to_owned());
                at += 2;
            }
            [c, ..] if c.is_alphanumeric() || *c == '_' => {
                let len = rest.iter().position(|c| !c.is_alphanumeric() && *c != '_').unwrap_or(rest.len());
                tokens.push(rest[..len].iter().collect());
                at += len;
            }
            [c, ..] => {
                if !c.is_whitespace() {
                    tokens.push(c.to_string());
                }
                at += 1;
            }
            [] => break,
        }
    }
    tokens
}

fn string(text: &[char]) -> usize {
    let mut at = 1;
    while at < text.len() && text[at] != '"' {
        at += if text[at] == '\\' { 2 } else { 1 };
    }
    at + 1
}

fn raw_string(text: &[char]) -> usize {
    let hashes = text[1..].iter().take_while(|c| **c == '#').count();
    let end: Vec<char> = std::iter::once('"').chain(std::iter::repeat_n('#', hashes)).collect();
    let body = 2 + hashes;
    text[body..].windows(end.len()).position(|w| w == end).map_or(text.len(), |n| body + n + end.len())
}

mod checker {
    use super::*;

    fn check(name: &str, source: &str) -> Vec<String> {
        let packages = ["axum", "exr", "nalgebra", "rayon", "serde", "tokio"].map(str::to_owned).into();
        violations(name, source, &packages)
    }

    #[test]
    fn planted_violations_are_found() {
        for (name, source) in [
            ("numerics/fit/mod.rs", "use serde::Serialize;"),
            ("numerics/image.rs", "fn f() { let _ = std::fs::read(\"x\"); }"),
            ("numerics/image.rs", "use std::{collections::HashMap, time::Instant};"),
            ("numerics/image.rs", "use crate::pipeline::decode;"),
            ("pipeline/fit.rs", "use std::path::Path;"),
            ("pipeline/fit.rs", "fn f(p: &std::path::Path) {}"),
            ("pipeline/fit.rs", "use ::tokio::sync::mpsc;"),
            ("pipeline/mod.rs", "use super::store::exr;"),
            ("devices/rigproto/mod.rs", "use super::super::store::frames;"),
            ("devices/arm.rs", "use crate::{devices::Cancel, pipeline::decode};"),
            ("store/frames.rs", "use crate::devices::camera::RawFrame;"),
            ("session/engine.rs", "let arm = crate::sim::arm::SimulatedArm::spawn(config);"),
            ("session/engine.rs", "use rigd::http;"),
            ("http/routes.rs", "use crate::{session::{handle::EngineHandle, engine::Engine}};"),
            ("http/routes.rs", "use crate::numerics as n;"),
            ("store/frames.rs", "#[axum::debug_handler]\nfn f() {}"),
            ("cli/merge.rs", "use exr::prelude::*;"),
            ("cli/history.rs", "use rusqlite::Connection;"),
            ("sim/world.rs", "use crate::numerics::fit::weights;"),
            ("sim/world.rs", "use crate::numerics::{brdf, radiometry::merge::merge};"),
            ("extra.rs", ""),
        ] {
            assert_eq!(check(name, source).len(), 1, "{name}: {source}: {:?}", check(name, source));
        }
    }

    #[test]
    fn every_branch_of_a_use_is_seen() {
        let source = "use crate::{sim::{arm, pose::SharedPose as P}, http, session::state};\nuse tokio::sync;";
        assert_eq!(
            check("session/engine.rs", source),
            [
                "src/session/engine.rs: session must not import crate::http",
                "src/session/engine.rs: session must not import crate::sim::arm",
                "src/session/engine.rs: session must not import crate::sim::pose::SharedPose",
            ]
        );
    }

    #[test]
    fn what_is_allowed_passes() {
        for (name, source) in [
            ("main.rs", "use rigd::cli;"),
            ("cli/serve.rs", "use crate::{sim::arm, http, session};\nuse axum::Router;"),
            ("cli/merge.rs", "use crate::store::exr;\nfn f() { exr::write_radiance(); }"),
            ("store/mod.rs", "pub mod exr;\nfn f() { exr::write(); }"),
            ("store/exr.rs", "use ::exr::prelude::*;"),
            ("numerics/fit/mod.rs", "use super::brdf::Ward;\nuse std::f64::consts::PI;\nuse rayon::prelude::*;"),
            ("numerics/image.rs", "// use tokio::fs;\n/* crate::sim::x */ const A: &str = \"crate::http::x\";"),
            ("numerics/image.rs", "const A: &str = r#\"use \"tokio::fs\"\"#; const B: char = '\"'; fn f<'a>() {}"),
            ("session/engine.rs", "use super::state::SessionState;\nuse crate::devices::{Cancel, arm::Arm};"),
            ("session/engine.rs", "fn f() {}\n#[cfg(test)]\nmod tests {\n    use crate::sim::arm::SimulatedArm;\n}"),
            ("sim/world.rs", "use crate::numerics::brdf::{Brdf, ward::Ward};"),
            ("sim/world.rs", "fn f<'a>(x: &'a u8) -> impl Fn() + use<'a> { move || {} }"),
        ] {
            assert_eq!(check(name, source), [""; 0], "{name}: {source}");
        }
    }
}
