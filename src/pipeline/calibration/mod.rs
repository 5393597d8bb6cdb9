//! Calibration from photographs: reports that are stored and used again.
pub mod response;
