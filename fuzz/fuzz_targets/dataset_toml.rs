//! Any text as a dataset.toml: taken, or refused with reasons.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigd::store::dataset::check_text;

fuzz_target!(|text: &str| {
    if let Err(reasons) = check_text(text) {
        assert!(!reasons.is_empty() && reasons.iter().all(|reason| !reason.is_empty()), "refused without a reason");
    }
});
