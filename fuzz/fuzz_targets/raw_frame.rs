//! Any bytes as a Canon raw file: lit photosites of even width and height, or a typed error.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigd::pipeline::raw::decode;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(frame) = decode(bytes) {
        let counts = &frame.counts;
        assert_eq!(counts.pixels.len(), counts.width * counts.height);
        assert!(counts.width % 2 == 0 && counts.height % 2 == 0 && counts.width > 0 && counts.height > 0);
        assert!(frame.black.level.iter().all(|level| level.is_finite()), "a black level that is no number");
        assert!(counts.pixels.iter().all(|count| count >> frame.body.bits == 0), "a count beyond the converter");
    }
});
