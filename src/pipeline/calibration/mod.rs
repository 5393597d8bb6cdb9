//! Calibration of the rig from photographs: named images in, plain reports out.
pub mod lights;
