//! When the next step is due: constant acceleration, then constant speed, then the same ramp down, in integers.
//!
//! From rest at acceleration a, step n is due after sqrt(2 n / a). The ramp keeps count of n, its level: the steps that led up
//! to the speed of now, and as many as lead down to rest. Every interval is the difference of two such times, so errors of
//! rounding do not add up.

/// A greatest speed and an acceleration, for one kind of motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pace {
    /// 2 / acceleration of the ramp, microseconds squared a step.
    two_by_a: u64,
    /// Level at which the greatest speed is reached, steps: also the longest braking distance.
    top: u32,
    /// Time a step at the greatest speed, microseconds.
    cruise_us: u32,
}

const MICRO: u128 = 1_000_000;
/// Half of what a wrapping clock of 32 bits tells apart, microseconds.
const LONGEST: u128 = 1 << 30;

impl Pace {
    /// Speed in millidegrees per second and acceleration in millidegrees per second squared, both above 0, of a motor with
    /// `steps_per_turn` steps to 360 degrees.
    ///
    /// None where a ramp or a step would take longer than 18 minutes.
    pub const fn new(steps_per_turn: u32, speed_mdeg_s: u32, acceleration_mdeg_s2: u32) -> Option<Self> {
        if steps_per_turn == 0 || speed_mdeg_s == 0 || acceleration_mdeg_s2 == 0 {
            return None;
        }
        let (speed, acceleration) = (speed_mdeg_s as u128 * steps_per_turn as u128, acceleration_mdeg_s2 as u128);
        // v^2 / 2a, rounded up: the ramp ends at exactly the greatest speed, and its acceleration is never exceeded.
        let top = (speed * speed_mdeg_s as u128).div_ceil(2 * acceleration * 360_000);
        if top >= LONGEST {
            return None;
        }
        let second = MICRO * 360_000;
        // 2/a = 4 top / v^2.
        let two_by_a = (4 * top * second * second).div_ceil(speed * speed);
        // Rounded up, so that the greatest speed is never exceeded.
        let cruise_us = second.div_ceil(speed);
        if cruise_us >= LONGEST || two_by_a * (top + 1) >= LONGEST * LONGEST {
            return None;
        }
        Some(Self { two_by_a: two_by_a as u64, top: top as u32, cruise_us: cruise_us as u32 })
    }

    /// Longest way from full speed to rest, steps.
    pub const fn braking_steps(&self) -> u32 {
        self.top
    }

    /// Steps made at full speed within `time_us`, rounded up.
    pub const fn steps_within(&self, time_us: u32) -> u32 {
        time_us.div_ceil(self.cruise_us)
    }

    /// Time from level `n` to level `n + 1` or back, microseconds.
    fn between_us(&self, n: u32) -> u32 {
        let since_rest_us = |n: u64| (n * self.two_by_a).isqrt();
        // Both are below 2^31, as `new` checked.
        (since_rest_us(u64::from(n) + 1) - since_rest_us(u64::from(n))) as u32
    }
}

/// A motion from rest to rest over a number of steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ramp {
    pace: Pace,
    level: u32,
    left: u32,
}

impl Ramp {
    /// At rest, `steps` ahead.
    pub const fn new(pace: Pace, steps: u32) -> Self {
        Self { pace, level: 0, left: steps }
    }

    /// Ends after `steps` more steps, or as soon as braking allows.
    pub fn end_within(&mut self, steps: u32) {
        self.left = steps.max(self.level);
    }

    /// Time from the step before (or the start) to the next step, microseconds; none when at rest at the end.
    pub fn next_us(&mut self) -> Option<u32> {
        let Self { pace, level, left } = *self;
        if left == 0 {
            return None;
        }
        let interval_us = if left <= level {
            self.level = level - 1;
            pace.between_us(self.level)
        } else if level < pace.top && left > level + 1 {
            self.level = level + 1;
            pace.between_us(level)
        } else if level == pace.top {
            pace.cruise_us
        } else {
            // The odd step of a move too short for full speed, at the speed reached.
            pace.between_us(level.saturating_sub(1))
        };
        self.left = left - 1;
        Some(interval_us.max(pace.cruise_us))
    }
}
