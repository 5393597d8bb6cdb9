//! Everything on disk: session directories, journal, frame commit, datasets, results, EXR in and out.
pub mod dataset;
pub mod exr;
pub mod frames;
pub mod journal;
pub mod manifest;
pub mod result;
pub mod sessions;
