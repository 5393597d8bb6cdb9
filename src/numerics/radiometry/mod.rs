//! Camera response (Debevec & Malik 1997, Robertson 2003), exposure ratios (Hanji & Mantiuk 2023), bracket merge with variance,
//! dark frames, flat field, lamp drift, sensor noise.
pub mod alignment;
pub mod bracket;
mod contradictions;
mod curve_system;
pub mod dark;
mod dark_levels;
pub mod drift;
mod error;
mod exposure_ratios;
pub mod flat;
mod gauge;
mod groups;
pub mod lean;
mod level_samples;
pub mod merge;
pub mod metering;
mod monotone;
pub mod mosaic;
pub mod noise;
pub mod response;
pub mod robertson;
pub mod times;
