//! Light positions from photographs of polished balls, light intensity from a grey card (paper 3.2).
//!
//! Silhouettes give the balls' centres ([`balls`], [`outline`]), highlights give mirror rays ([`highlight`], [`mirror`]), their
//! meeting points start a joint refinement with all lights on the arm's circle ([`arm`], [`joint`], [`solve`]). The card gives
//! the intensity ([`card`], [`plane`]).

pub mod arm;
pub mod balls;
pub mod card;
mod edges;
mod fitted;
pub mod highlight;
mod hough;
pub mod joint;
mod limb;
pub mod mirror;
pub mod outline;
pub mod plane;
pub mod solve;
