//! Any bytes as a frame: a whole picture or a typed error, and its EXIF facts.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigd::pipeline::decode::{FrameInfo, decode};

fuzz_target!(|bytes: &[u8]| {
    if let Ok(picture) = decode(bytes) {
        assert_eq!(picture.pixels.len(), picture.width * picture.height);
    }
    if let Some(time_s) = FrameInfo::read(bytes).true_time_s() {
        assert!(time_s.is_finite() && time_s > 0.0, "an exposure of {time_s} s");
    }
});
