//! What a driver's labels mean. Labels are parsed from what a camera offers, never written down: the same speed is "10" with one
//! driver and "10.3" with another.

use serde::{Deserialize, Serialize};

/// Farthest a choice may be from what is wanted, stops: half a third.
const NEAR: f64 = 1.0 / 6.0;

/// Labels that only a body in half-stop mode offers (libgphoto2 2.5.30, camlibs/ptp2/config.c).
const HALF_STOPS: [&str; 8] = ["20.3", "1.5", "0.7", "1/45", "1/90", "1/180", "1/350", "1/750"];

/// A shutter speed offered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shutter {
    /// As the driver spells it.
    pub label: String,
    /// Third stops from one second.
    pub thirds: i32,
    /// Time the shutter is really open, seconds: 2^(thirds / 3).
    pub true_s: f64,
}

/// An aperture offered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Aperture {
    /// As the driver spells it.
    pub label: String,
    /// The f-number.
    pub f_number: f64,
}

/// An ISO speed offered.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Iso {
    /// As the driver spells it.
    pub label: String,
    /// The speed.
    pub iso: u32,
}

/// Which files an exposure makes; JPEG means large and fine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImageFormat {
    /// One JPEG.
    Jpeg,
    /// One raw file of full size.
    Raw,
    /// A raw file and a JPEG.
    RawAndJpeg,
}

/// An image format offered.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Format {
    /// As the driver spells it.
    pub label: String,
    /// What it is.
    pub format: ImageFormat,
}

impl Shutter {
    /// A speed by its label in third-stop mode; none for bulb, automatic and what is no time.
    pub fn from_label(label: &str) -> Option<Self> {
        let seconds = match label.split_once('/') {
            Some((numerator, denominator)) => number(numerator)? / number(denominator)?,
            None => number(label)?,
        };
        let thirds = (3.0 * seconds.log2()).round();
        // Longer than an hour or shorter than a microsecond is no shutter; within, the cast is exact.
        let shutter = Self { label: label.into(), thirds: thirds as i32, true_s: (thirds / 3.0).exp2() };
        (1e-6..3600.0).contains(&seconds).then_some(shutter)
    }
}

impl ImageFormat {
    /// How many files an exposure makes.
    pub fn files(self) -> usize {
        if self == Self::RawAndJpeg { 2 } else { 1 }
    }

    fn from_label(label: &str) -> Option<Self> {
        match label {
            "Large Fine JPEG" => Some(Self::Jpeg),
            "RAW" => Some(Self::Raw),
            "RAW + Large Fine JPEG" => Some(Self::RawAndJpeg),
            _ => None,
        }
    }
}

/// The shutter speeds among `offered`, or the label that shows the body to be in half-stop mode, where "10" means 11.3 s.
pub fn shutters(offered: &[String]) -> Result<Vec<Shutter>, String> {
    match offered.iter().find(|label| HALF_STOPS.contains(&label.as_str())) {
        Some(half_stop) => Err(half_stop.clone()),
        None => Ok(offered.iter().filter_map(|label| Shutter::from_label(label)).collect()),
    }
}

/// The apertures among `offered`.
pub fn apertures(offered: &[String]) -> Vec<Aperture> {
    let aperture = |label: &String| {
        let f_number = number(label.trim_start_matches("f/"))?;
        Some(Aperture { label: label.clone(), f_number })
    };
    offered.iter().filter_map(aperture).collect()
}

/// The ISO speeds among `offered`, without automatic.
pub fn isos(offered: &[String]) -> Vec<Iso> {
    offered.iter().filter_map(|label| Some(Iso { label: label.clone(), iso: label.parse().ok()? })).collect()
}

/// The image formats among `offered` that can be used.
pub fn formats(offered: &[String]) -> Vec<Format> {
    let format = |label: &String| Some(Format { label: label.clone(), format: ImageFormat::from_label(label)? });
    offered.iter().filter_map(format).collect()
}

/// The speed offered that is nearest to `true_s`, if it is within a sixth of a stop.
pub fn nearest_shutter(offered: &[Shutter], true_s: f64) -> Option<&Shutter> {
    nearest(offered, |shutter| (shutter.true_s / true_s).log2())
}

/// The aperture offered that is nearest to `f_number`, if it is within a sixth of a stop.
pub fn nearest_aperture(offered: &[Aperture], f_number: f64) -> Option<&Aperture> {
    nearest(offered, |aperture| 2.0 * (aperture.f_number / f_number).log2())
}

fn nearest<T>(offered: &[T], stops: impl Fn(&T) -> f64) -> Option<&T> {
    let near = offered.iter().filter(|choice| stops(choice).abs() <= NEAR);
    near.min_by(|a, b| stops(a).abs().total_cmp(&stops(b).abs()))
}

/// A positive number in plain digits: no sign, no exponent, no "inf".
fn number(text: &str) -> Option<f64> {
    let plain = text.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.');
    text.parse().ok().filter(|number: &f64| plain && *number > 0.0)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn labels(text: &str) -> Vec<String> {
        text.split_whitespace().map(str::to_owned).collect()
    }

    /// What ptp2 offers for a body in third-stop mode, with the body's codes (libgphoto2 2.5.30, camlibs/ptp2/config.c).
    const PTP2: &str = "auto bulb 30 25 20 15 13 10.3 8 6.3 5 4 3.2 2.5 2 1.6 1.3 1 0.8 0.6 0.5 0.4 0.3 1/4 1/5 1/6 1/8 1/10 1/13 \
        1/15 1/20 1/25 1/30 1/40 1/50 1/60 1/80 1/100 1/125 1/160 1/200 1/250 1/320 1/400 1/500 1/640 1/800 1/1000 1/1250 1/1600 \
        1/2000 1/2500 1/3200 1/4000 1/5000 1/6400 1/8000";

    #[test]
    fn offered_labels_are_every_third_of_a_stop_once() {
        let shutters = shutters(&labels(PTP2)).unwrap();
        let thirds: Vec<i32> = shutters.iter().map(|shutter| shutter.thirds).collect();
        assert_eq!(thirds, (-39..=15).rev().collect::<Vec<_>>());
        for shutter in &shutters {
            let code = 0x38 - 8 * shutter.thirds.div_euclid(3) - [0, 3, 5][shutter.thirds.rem_euclid(3) as usize];
            let n = code - 0x38;
            let fraction =
                [0.0, f64::NAN, f64::NAN, 1.0 / 3.0, 0.5, 2.0 / 3.0, f64::NAN, f64::NAN][n.rem_euclid(8) as usize];
            let true_s = (-(f64::from(n.div_euclid(8)) + fraction)).exp2();
            assert!(
                (shutter.true_s / true_s - 1.0).abs() < 1e-12,
                "{}: {} s, not {true_s}",
                shutter.label,
                shutter.true_s
            );
        }
    }

    #[test]
    fn a_speed_is_found_under_whatever_label_the_driver_has_for_it() {
        let ptp2 = shutters(&labels(PTP2)).unwrap();
        let canon = shutters(&labels("Bulb 30 25 20 15 13 10 8 6 5")).unwrap();
        for (wanted, on_ptp2, on_canon) in [("10", "10.3", "10"), ("6", "6.3", "6"), ("15", "15", "15")] {
            let true_s = Shutter::from_label(wanted).unwrap().true_s;
            assert_eq!(nearest_shutter(&ptp2, true_s).unwrap().label, on_ptp2);
            assert_eq!(nearest_shutter(&canon, true_s).unwrap().label, on_canon);
        }
        assert_eq!(nearest_shutter(&canon, 1.0), None);
        assert_eq!(nearest_shutter(&canon, f64::NAN), None);
    }

    #[test]
    fn half_stop_mode_is_recognised() {
        assert_eq!(shutters(&labels("30 20.3 15 10 8 6")), Err("20.3".into()));
        assert_eq!(shutters(&labels("1/60 1/90 1/125")), Err("1/90".into()));
    }

    #[test]
    fn what_is_no_time_is_no_speed() {
        for label in [
            "",
            "bulb",
            "Auto",
            "Unknown",
            "1/0",
            "0",
            "-1",
            "inf",
            "NaN",
            "1e3",
            "1//4",
            "/",
            "1 ",
            "99999",
            "1/99999999",
        ] {
            assert_eq!(Shutter::from_label(label), None, "{label}");
        }
    }

    #[test]
    fn apertures_isos_and_formats_are_read_in_both_spellings() {
        let offered = apertures(&["implicit auto".into(), "f/5.6".into(), "2.0".into(), "8".into()]);
        assert_eq!(offered.iter().map(|aperture| aperture.f_number).collect::<Vec<_>>(), [5.6, 2.0, 8.0]);
        assert_eq!(nearest_aperture(&offered, 5.657).unwrap().label, "f/5.6");
        assert_eq!(nearest_aperture(&offered, 6.3), None);
        assert_eq!(isos(&labels("Auto 100 125 Factory")).iter().map(|iso| iso.iso).collect::<Vec<_>>(), [100, 125]);
        let offered = ["mRAW", "RAW 2", "RAW", "Small Fine JPEG", "RAW + Large Fine JPEG", "Large Fine JPEG"];
        let found: Vec<ImageFormat> = formats(&offered.map(String::from)).iter().map(|format| format.format).collect();
        assert_eq!(found, [ImageFormat::Raw, ImageFormat::RawAndJpeg, ImageFormat::Jpeg]);
    }
}
