//! How long a motion may take, and which stated angle that may be computed from.

use super::arm::ArmError;
use std::time::Duration;

/// How far outside `arm.travel_deg` the home switch may lie, degrees.
pub(super) const SWITCH_DEG: f64 = 10.0;
/// How far beyond its switch an arm may stand that looks for it, degrees.
const BEYOND_DEG: f64 = 2.0;

/// The angle that a homed arm states, if it can be believed: limits of time are computed from it.
///
/// # Errors
/// [`ArmError::Locked`] when no homed arm can stand there.
pub(super) fn believed(angle_deg: f64, [lower, upper]: [f64; 2]) -> Result<f64, ArmError> {
    let margin = SWITCH_DEG + BEYOND_DEG;
    if (lower - margin..=upper + margin).contains(&angle_deg) {
        return Ok(angle_deg);
    }
    let reason = format!(
        "it says that it stands at {} degrees, which is not believed: arm.travel_deg is [{lower}, {upper}], its switch at most \
         {SWITCH_DEG} outside: home it again, check its supply and cable",
        told(angle_deg)
    );
    Err(ArmError::Locked { reason })
}

/// A number from the wire in words, never hundreds of digits long.
pub(super) fn told(number: f64) -> String {
    if number == 0.0 || (1e-4..1e9).contains(&number.abs()) { format!("{number}") } else { format!("{number:e}") }
}

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
    fn only_an_angle_near_the_travel_is_believed_and_the_rest_is_told_shortly() {
        let travel = [-90.0, 90.0];
        assert!([-102.0, -90.0, 0.0, 102.0].iter().all(|angle| believed(*angle, travel).is_ok()));
        for angle in [-102.1, 102.1, 2_147_483.647, 1e308, -1e300, f64::INFINITY, f64::NAN] {
            let words = believed(angle, travel).map_or_else(|fault| fault.to_string(), |angle| angle.to_string());
            assert!(words.contains("not believed") && words.len() < 250, "{words}");
        }
    }

    #[test]
    fn travel_time_is_that_of_the_controllers_measured() {
        // GRBL at 30 deg/s and 100 deg/s^2: 40 degrees ideal in 1.633 s, 36.9 in 1.53; a short move never cruises.
        assert!((travel_time_s(40.0, 30.0, 100.0) - 1.633).abs() < 1e-3);
        assert!((travel_time_s(36.9, 30.0, 100.0) - 1.533).abs() < 4e-3);
        assert!((travel_time_s(1.0, 30.0, 100.0) - 0.2).abs() < 1e-12);
        assert!((travel_time_s(9.0, 30.0, 100.0) - 0.6).abs() < 1e-12);
    }
}
