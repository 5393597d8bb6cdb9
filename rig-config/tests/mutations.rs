//! Whatever the bytes of a rig file: it is read or refused for a reason.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use rig_config::{Rig, SHIPPED};

/// What hostile or careless hands do to a good file.
fn mutated() -> impl Strategy<Value = String> {
    let pieces = prop::sample::select(vec![
        "nan",
        "-inf",
        "1e400",
        "-1",
        "0",
        "[]",
        "[[",
        "{}",
        "\"",
        "'''",
        "=",
        "\n",
        "[arm]",
        "\u{0}",
        "é",
        "true",
        "1979-05-27",
        "0x7fffffffffffffff",
        "999999999999999999999",
        "a.b.c = 1",
        "[plan.exposures]",
        "[[arm]]",
        "#",
    ]);
    let edits = prop::collection::vec((any::<prop::sample::Index>(), 0_usize..40, pieces), 1..6);
    (prop::sample::select(SHIPPED.to_vec()), edits).prop_map(|((_, text), edits)| {
        let code: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
        let mut text: Vec<char> = code.join("\n").chars().collect();
        for (at, remove, insert) in edits {
            let start = at.index(text.len());
            let end = (start + remove).min(text.len());
            text.splice(start..end, insert.chars());
        }
        text.into_iter().collect()
    })
}

/// A file is either a rig or has at least one reason against it, whatever its bytes.
fn is_answered(text: &str) {
    if let Err(error) = Rig::from_toml(text, "random") {
        assert!(!error.reasons.is_empty() && !error.to_string().is_empty());
        assert!(error.reasons.iter().all(|r| !r.key.is_empty()), "serde refused what the checks let through: {error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 5000, failure_persistence: None, rng_seed: RngSeed::Fixed(7), ..ProptestConfig::default() })]

    #[test]
    fn random_text_is_answered(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        is_answered(&String::from_utf8_lossy(&bytes));
    }

    #[test]
    fn mutated_files_are_answered(text in mutated()) {
        is_answered(&text);
    }
}
