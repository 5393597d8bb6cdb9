//! Any text as a rig file: a rig, or reasons for refusing it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rig_config::Rig;

fuzz_target!(|text: &str| {
    if let Err(error) = Rig::from_toml(text, "rig.toml") {
        assert!(!error.reasons.is_empty(), "refused without a reason");
        assert!(error.reasons.iter().all(|reason| !reason.key.is_empty()), "a reason that names no key: {error}");
    }
});
