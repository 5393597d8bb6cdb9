//! Synchronous mathematics: no tokio, no serde, no files, no clocks, no configuration.
pub mod brdf;
pub mod calibration;
pub mod fit;
pub mod geometry;
pub mod image;
pub mod quality;
pub mod radiometry;
pub mod render;
pub mod settle;
pub mod simd;
