//! Calibration from photographs: reports that are stored and used again.
mod doubts;
pub mod response;
