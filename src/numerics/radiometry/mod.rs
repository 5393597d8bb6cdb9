//! Camera response (Debevec & Malik 1997), bracket merge with variance, sensor noise.
pub mod bracket;
pub mod merge;
mod monotone;
pub mod noise;
pub mod response;
mod sampling;
