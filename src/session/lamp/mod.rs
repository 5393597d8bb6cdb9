//! What is known of the lamp: how bright it is at every station, by the reference patch, and for how long it was lit.

pub mod drift;
pub mod hours;
pub mod patch;
