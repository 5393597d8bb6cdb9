//! The simulated rig: an arm that runs the firmware's own handler behind a PTY, a camera, and the one world both share.
//! Imported only by main (through `cli`), studies and tests.
pub mod arm;
pub mod camera;
pub mod eos;
pub mod grbl;
pub mod lamp;
mod lens;
pub mod pose;
pub mod ringing;
pub mod scene;
pub mod stage;
pub mod tone;
pub mod truth;
pub mod world;
