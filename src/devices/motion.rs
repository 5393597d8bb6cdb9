//! How long a motion may take.

use std::time::Duration;

/// Time a motion of `ideal_s` may take before it counts as failed.
pub(super) fn allowance(ideal_s: f64) -> Duration {
    seconds(ideal_s * 1.5 + 2.0)
}

/// A duration; absurd settings must not overflow the clock, and no motion takes a day.
pub(super) fn seconds(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or(Duration::from_secs(86_400))
}

/// Time of a trapezoidal (or, if short, triangular) speed profile from rest to rest, seconds.
pub(super) fn travel_time_s(distance_deg: f64, speed_deg_s: f64, acceleration_deg_s2: f64) -> f64 {
    let ramps_deg = speed_deg_s * speed_deg_s / acceleration_deg_s2;
    if distance_deg < ramps_deg {
        2.0 * (distance_deg / acceleration_deg_s2).sqrt()
    } else {
        distance_deg / speed_deg_s + speed_deg_s / acceleration_deg_s2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn travel_time_is_that_of_the_controllers_measured() {
        // GRBL at 30 deg/s and 100 deg/s^2: 40 degrees ideal in 1.633 s, 36.9 in 1.53; a short move never cruises.
        assert!((travel_time_s(40.0, 30.0, 100.0) - 1.633).abs() < 1e-3);
        assert!((travel_time_s(36.9, 30.0, 100.0) - 1.533).abs() < 4e-3);
        assert!((travel_time_s(1.0, 30.0, 100.0) - 0.2).abs() < 1e-12);
        assert!((travel_time_s(9.0, 30.0, 100.0) - 0.6).abs() < 1e-12);
    }
}
