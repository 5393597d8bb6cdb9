//! Any bytes as the one image, PNG or TIFF, of a dataset of 10 x 8 pixels: sound radiance or a typed error.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigd::store::dataset;
use std::sync::LazyLock;
use tempfile::TempDir;

const IMAGES: [&str; 2] = ["a.png", "a.tiff"];

static FOLDERS: LazyLock<[TempDir; 2]> = LazyLock::new(|| {
    IMAGES.map(|image| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let text = include_str!("../seeds/dataset_toml/orthographic.toml").replace("a.png", image);
        std::fs::write(folder.path().join(dataset::FILE), text).expect("the description is written");
        folder
    })
});

fuzz_target!(|bytes: &[u8]| {
    for (folder, image) in FOLDERS.iter().zip(IMAGES) {
        std::fs::write(folder.path().join(image), bytes).expect("the image is written");
        let Ok(dataset) = dataset::read(folder.path()) else { continue };
        let image = &dataset.images[0];
        assert_eq!((image.radiance.pixels.len(), image.valid.pixels.len()), (80, 80));
        assert!(image.radiance.pixels.iter().flatten().all(|v| (0.0..=1.0).contains(v)), "unsound radiance");
    }
});
