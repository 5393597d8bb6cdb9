//! What a simulated session is to live through.

use crate::support;
use rig_config::{Rig, Shutter};
use std::ops::Range;

/// A plan and its troubles.
pub struct Course {
    pub rig: Rig,
    /// How many times faster than real the engine rests.
    pub speed: f64,
    /// Operations of the disk within which the power goes.
    pub cut_within: u64,
    /// After so many cuts the power stays, so that every session ends.
    pub most_cuts: usize,
    /// Shots between two faults of camera, arm or disk, on average; none: only the power fails.
    pub fault_every: Option<u32>,
}

impl Course {
    /// Three stations of two exposures, without waits, and a cut about every half of it.
    pub fn brief() -> Self {
        let mut rig = support::rig();
        (rig.lamp.soak_s, rig.arm.settle_s) = (0.0, 0.0);
        Self { rig, speed: 10_000.0, cut_within: 70, most_cuts: 30, fault_every: None }
    }

    /// A night of 181 stations of ten exposures: a fault about every 50 frames, and the power goes a few times.
    pub fn night() -> Self {
        let mut rig = support::rig();
        rig.plan.stations_deg = (0..181).map(|i| -85.0 + f64::from(i) * 1.4).collect();
        let labels = ["1/30", "1/15", "1/8", "1/4", "0.5", "1", "2", "4", "8", "15"];
        rig.plan.exposures = labels.map(|label| Shutter::from_label(label).unwrap()).to_vec();
        Self { rig, speed: 1.0, cut_within: 12_000, most_cuts: 8, fault_every: Some(50) }
    }

    /// Operations before the next cut are drawn from this range; a fifth of the cuts come soon after a start.
    pub fn cut_range(&self, soon: bool) -> Range<u64> {
        0..if soon { 12 } else { self.cut_within }
    }
}
