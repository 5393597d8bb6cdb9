//! Camera response (Debevec & Malik 1997), bracket merge with variance, sensor noise.
pub mod merge;
pub mod noise;
pub mod response;
