//! Shutter speeds: the label a body offers and the time it really opens.

/// A shutter speed of a third-stop body.
#[derive(Clone, Debug, PartialEq)]
pub struct Shutter {
    /// As written on the body: `1/100`, `0.4`, `15`.
    pub label: String,
    /// The label as a number, seconds.
    pub nominal_s: f64,
    /// The time the body aims at, 2^(k/3) seconds: a label of 15 opens for 16 s.
    pub true_s: f64,
}

/// Why a label is no shutter speed that can be planned.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShutterError {
    /// The label belongs to a body in half-stop mode.
    #[error(
        "`{0}` is a half-stop label, whose true time the third-stop rule gets wrong: set the body to third stops and use {1}"
    )]
    HalfStop(String, &'static str),
    /// No body offers the label.
    #[error(
        "`{0}` is no third-stop shutter label: write one as the body does, from `30` through `0.6` and `1/4` to `1/8000`"
    )]
    Unknown(String),
}

/// Third-stop labels of Canon bodies (libgphoto2, camlibs/canon/library.c), and ptp2's spelling of two of them (10.3, 6.3).
const THIRD_STOPS: &str = "30 25 20 15 13 10.3 10 8 6.3 6 5 4 3.2 2.5 2 1.6 1.3 1 0.8 0.6 0.5 0.4 0.3 1/4 1/5 1/6 1/8 1/10 \
    1/13 1/15 1/20 1/25 1/30 1/40 1/50 1/60 1/80 1/100 1/125 1/160 1/200 1/250 1/320 1/400 1/500 1/640 1/800 1/1000 1/1250 \
    1/1600 1/2000 1/2500 1/3200 1/4000 1/5000 1/6400 1/8000";

/// Labels that only a body in half-stop mode offers (libgphoto2, camlibs/ptp2/config.c), each with the third stop nearby.
const HALF_STOPS: &[(&str, &str)] = &[
    ("20.3", "20"),
    ("3", "3.2"),
    ("1.5", "1.6"),
    ("0.7", "0.6"),
    ("1/45", "1/40"),
    ("1/90", "1/100"),
    ("1/180", "1/160"),
    ("1/350", "1/320"),
    ("1/750", "1/800"),
    ("1/1500", "1/1600"),
    ("1/3000", "1/3200"),
    ("1/6000", "1/6400"),
];

impl Shutter {
    /// The shutter speed of a third-stop label: true time 2^(k/3) s with k = round(3 log2 nominal).
    pub fn from_label(label: &str) -> Result<Self, ShutterError> {
        if let Some((_, near)) = HALF_STOPS.iter().find(|(half, _)| *half == label) {
            return Err(ShutterError::HalfStop(label.into(), near));
        }
        let unknown = || ShutterError::Unknown(label.chars().take(40).collect());
        if !THIRD_STOPS.split_whitespace().any(|known| known == label) {
            return Err(unknown());
        }
        let nominal_s = seconds(label).ok_or_else(unknown)?;
        let k = (3.0 * nominal_s.log2()).round();
        Ok(Self { label: label.into(), nominal_s, true_s: (k / 3.0).exp2() })
    }
}

fn seconds(label: &str) -> Option<f64> {
    match label.split_once('/') {
        Some((numerator, denominator)) => Some(numerator.parse::<f64>().ok()? / denominator.parse::<f64>().ok()?),
        None => label.parse().ok(),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// True times computed from the bodies' own codes (code - 0x38 in eighths of a stop), not from the labels.
    #[test]
    fn true_times_follow_the_body_codes() {
        let by_code = [
            ("30", 0x10),
            ("25", 0x13),
            ("15", 0x18),
            ("13", 0x1b),
            ("10", 0x1d),
            ("10.3", 0x1d),
            ("6", 0x23),
            ("6.3", 0x23),
            ("1", 0x38),
            ("0.8", 0x3b),
            ("0.6", 0x3d),
            ("0.3", 0x45),
            ("1/4", 0x48),
            ("1/6", 0x4d),
            ("1/10", 0x53),
            ("1/13", 0x55),
            ("1/60", 0x68),
            ("1/100", 0x6d),
            ("1/8000", 0xa0),
        ];
        for (label, code) in by_code {
            let n: i32 = code - 0x38;
            let fraction = [0.0, f64::NAN, f64::NAN, 1.0 / 3.0, 0.5, 2.0 / 3.0][n.rem_euclid(8) as usize];
            let want = (-(f64::from(n.div_euclid(8)) + fraction)).exp2();
            let got = Shutter::from_label(label).unwrap().true_s;
            assert!((got / want - 1.0).abs() < 1e-12, "{label}: {got} s, code says {want} s");
        }
    }

    #[test]
    fn every_third_stop_label_has_its_own_third() {
        let mut k: Vec<i64> = THIRD_STOPS
            .split_whitespace()
            .filter(|l| !["10.3", "6.3"].contains(l))
            .map(|l| (3.0 * Shutter::from_label(l).unwrap().true_s.log2()).round() as i64)
            .collect();
        k.sort_unstable();
        assert_eq!(k, (-39..=15).collect::<Vec<_>>());
    }

    #[test]
    fn refuses_half_stops_bulb_and_nonsense() {
        for (label, near) in HALF_STOPS {
            let error = Shutter::from_label(label).unwrap_err();
            assert!(matches!(error, ShutterError::HalfStop(..)), "{label}");
            assert!(error.to_string().contains(near));
            assert!(Shutter::from_label(near).is_ok());
        }
        for label in ["bulb", "", "1/3", "1/0", "0", "-1", "NaN", "inf", "15 ", "1//4", "2e1"] {
            assert!(matches!(Shutter::from_label(label), Err(ShutterError::Unknown(_))), "{label}");
        }
    }
}
