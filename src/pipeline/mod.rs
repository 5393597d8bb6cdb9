//! Synchronous steps from frames to a fitted material: no paths, no devices, no clocks.
pub mod calibration;
pub mod contain;
pub mod dataset;
pub mod decode;
pub mod develop;
pub mod fine;
pub mod fit;
pub mod identify;
pub mod inputs;
pub mod judged;
pub mod metering;
pub mod options;
pub mod preview;
pub mod raw;
pub mod relight;
pub mod report;
pub mod settle;
