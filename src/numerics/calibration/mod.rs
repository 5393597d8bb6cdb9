//! What a rig is made of, measured from photographs (paper 3.2).
pub mod lights;
