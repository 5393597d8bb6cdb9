//! Camera response (Debevec & Malik 1997), bracket merge with variance, dark frames, flat field, lamp drift, sensor noise.
pub mod bracket;
pub mod dark;
pub mod drift;
pub mod flat;
pub mod merge;
mod monotone;
pub mod noise;
pub mod response;
mod sampling;
