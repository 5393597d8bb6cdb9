//! Any bytes as a JPEG whose levels are wanted beyond whole numbers: finite levels of every pixel asked for, or a reason.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigd::pipeline::fine::fine_levels;

fuzz_target!(|bytes: &[u8]| {
    let points = [(0, 0), (7, 8), (15, 11), (usize::MAX, 0)];
    for count in 0..=points.len() {
        let Ok(levels) = fine_levels(bytes, &points[..count]) else { continue };
        assert_eq!(levels.len(), count);
        assert!(levels.iter().flatten().all(|level| level.is_finite()), "a level that is no number");
    }
});
