//! Any bytes as a radiance image of 10 x 8 pixels: sound radiance in every valid pixel, or a typed error.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigd::store::exr::read_radiance;
use std::sync::LazyLock;
use tempfile::{NamedTempFile, TempPath};

static FILE: LazyLock<TempPath> = LazyLock::new(|| NamedTempFile::new().expect("a temporary file").into_temp_path());

fuzz_target!(|bytes: &[u8]| {
    std::fs::write(&*FILE, bytes).expect("the temporary file takes the bytes");
    let Ok(image) = read_radiance(&FILE, (10, 8)) else { return };
    assert_eq!((image.radiance.pixels.len(), image.valid.pixels.len()), (80, 80));
    for (pixel, valid) in image.radiance.pixels.iter().zip(&image.valid.pixels) {
        assert!(!valid || pixel.iter().all(|v| v.is_finite() && *v >= 0.0), "unsound radiance");
    }
});
