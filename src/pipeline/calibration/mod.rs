//! Calibration of the rig from photographs: named images in, plain reports out.
pub mod camera;
pub(super) mod doubts;
pub mod lights;
pub mod response;
