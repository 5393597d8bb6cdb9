//! What photographs of known objects say of the rig.
pub mod camera;
pub mod lights;
