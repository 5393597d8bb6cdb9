//! Motion at constant acceleration, in closed form, so that time may run at any speed.

/// A speed profile of three phases: ramp up, cruise, ramp down. Degrees and seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    from_deg: f64,
    /// +1 or -1.
    sense: f64,
    acceleration: f64,
    peak_speed: f64,
    ramp_up_s: f64,
    cruise_s: f64,
}

impl Profile {
    /// From rest at `from_deg` to rest at `to_deg`.
    pub fn between(from_deg: f64, to_deg: f64, speed: f64, acceleration: f64) -> Self {
        let distance = (to_deg - from_deg).abs();
        let peak_speed = speed.min((distance * acceleration).sqrt());
        let cruise_deg = (distance - peak_speed * peak_speed / acceleration).max(0.0);
        Self {
            from_deg,
            sense: (to_deg - from_deg).signum(),
            acceleration,
            peak_speed,
            ramp_up_s: peak_speed / acceleration,
            cruise_s: if peak_speed > 0.0 { cruise_deg / peak_speed } else { 0.0 },
        }
    }

    /// From `velocity` (signed) at `from_deg` to rest, as soon as the acceleration allows.
    pub fn stopping(from_deg: f64, velocity: f64, acceleration: f64) -> Self {
        let (sense, peak_speed) = (velocity.signum(), velocity.abs());
        Self { from_deg, sense, acceleration, peak_speed, ramp_up_s: 0.0, cruise_s: 0.0 }
    }

    /// Time to rest, seconds.
    pub fn duration_s(&self) -> f64 {
        self.ramp_up_s + self.cruise_s + self.peak_speed / self.acceleration
    }

    /// Greatest speed on the way, degrees per second.
    pub fn peak_speed(&self) -> f64 {
        self.peak_speed
    }

    /// Angle (degrees) and signed velocity (degrees per second) `time_s` after the start.
    pub fn at(&self, time_s: f64) -> (f64, f64) {
        let time_s = time_s.clamp(0.0, self.duration_s());
        let up_s = time_s.min(self.ramp_up_s);
        let cruise_s = (time_s - self.ramp_up_s).clamp(0.0, self.cruise_s);
        let down_s = (time_s - self.ramp_up_s - self.cruise_s).max(0.0);
        let travelled = self.acceleration * up_s * up_s / 2.0
            + self.peak_speed * (cruise_s + down_s)
            + -self.acceleration * down_s * down_s / 2.0;
        let speed = if time_s < self.ramp_up_s {
            self.acceleration * up_s
        } else {
            self.peak_speed - self.acceleration * down_s
        };
        (self.from_deg + self.sense * travelled, self.sense * speed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-6 * (1.0 + a.abs() + b.abs())
    }

    proptest! {
        #[test]
        fn a_profile_keeps_its_ends_and_its_limits(
            from in -180.0..180.0, to in -180.0..180.0, speed in 1.0..90.0, acceleration in 5.0..500.0, part in 0.0..1.0,
        ) {
            let profile = Profile::between(from, to, speed, acceleration);
            let end = profile.duration_s();
            prop_assert!(near(profile.at(0.0).0, from) && near(profile.at(end).0, to));
            prop_assert!(near(profile.at(end).1, 0.0));
            let (dt, time) = (end * 1e-4, end * part);
            let ((a, v), (b, w)) = (profile.at(time), profile.at(time + dt));
            prop_assert!(v.abs() <= speed * (1.0 + 1e-9));
            prop_assert!((w - v).abs() <= acceleration * dt * (1.0 + 1e-6) + 1e-9);
            // Velocity is the derivative of the angle: the step agrees with the trapezoid rule to second order.
            prop_assert!((b - a - (v + w) / 2.0 * dt).abs() <= acceleration * dt * dt + 1e-9);
        }

        #[test]
        fn stopping_takes_the_braking_distance(velocity in -90.0..90.0f64, acceleration in 5.0..500.0) {
            let profile = Profile::stopping(10.0, velocity, acceleration);
            let (angle, speed) = profile.at(profile.duration_s());
            prop_assert!(near(angle - 10.0, velocity * velocity.abs() / (2.0 * acceleration)));
            prop_assert!(near(speed, 0.0));
        }
    }
}
