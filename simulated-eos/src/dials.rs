//! The values a 5D Mark II offers in third-stop mode, by code (libgphoto2 2.5.30, camlibs/ptp2/config.c).

use crate::pack::{Pack, u32_at};

/// A shutter speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shutter {
    /// Tv code.
    pub code: u32,
    /// As the body's display writes it: `15`, `0.4`, `1/100`.
    pub label: &'static str,
    /// Time the shutter is really open, seconds: 2^-((code - 0x38) / 8 stops), where eighths 3 and 5 are thirds of a stop.
    pub true_s: f64,
}

/// An aperture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aperture {
    /// Av code.
    pub code: u32,
    /// As the body's display writes it: `5.6`.
    pub label: &'static str,
    /// The f-number of the label.
    pub f_number: f64,
}

/// An ISO speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Iso {
    /// Code of the speed.
    pub code: u32,
    /// The speed.
    pub speed: u32,
}

/// Which files an exposure makes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageFormat {
    /// One large fine JPEG.
    Jpeg,
    /// One raw file.
    Raw,
    /// A raw file and a large fine JPEG.
    RawAndJpeg,
}

/// Display labels of the 55 third stops from 30 s (0x10) to 1/8000 s (0xa0).
const SHUTTER_LABELS: [&str; 55] = [
    "30", "25", "20", "15", "13", "10", "8", "6", "5", "4", "3.2", "2.5", "2", "1.6", "1.3", "1", "0.8", "0.6", "0.5",
    "0.4", "0.3", "1/4", "1/5", "1/6", "1/8", "1/10", "1/13", "1/15", "1/20", "1/25", "1/30", "1/40", "1/50", "1/60",
    "1/80", "1/100", "1/125", "1/160", "1/200", "1/250", "1/320", "1/400", "1/500", "1/640", "1/800", "1/1000",
    "1/1250", "1/1600", "1/2000", "1/2500", "1/3200", "1/4000", "1/5000", "1/6400", "1/8000",
];

/// An f/2.8 lens to f/32.
const APERTURES: [(u32, &str, f64); 22] = [
    (0x20, "2.8", 2.8),
    (0x23, "3.2", 3.2),
    (0x25, "3.5", 3.5),
    (0x28, "4", 4.0),
    (0x2b, "4.5", 4.5),
    (0x2d, "5", 5.0),
    (0x30, "5.6", 5.6),
    (0x33, "6.3", 6.3),
    (0x35, "7.1", 7.1),
    (0x38, "8", 8.0),
    (0x3b, "9", 9.0),
    (0x3d, "10", 10.0),
    (0x40, "11", 11.0),
    (0x43, "13", 13.0),
    (0x45, "14", 14.0),
    (0x48, "16", 16.0),
    (0x4b, "18", 18.0),
    (0x4d, "20", 20.0),
    (0x50, "22", 22.0),
    (0x53, "25", 25.0),
    (0x55, "29", 29.0),
    (0x58, "32", 32.0),
];

/// ISO 100 to 6400 in thirds.
const ISOS: [(u32, u32); 19] = [
    (0x48, 100),
    (0x4b, 125),
    (0x4d, 160),
    (0x50, 200),
    (0x53, 250),
    (0x55, 320),
    (0x58, 400),
    (0x5b, 500),
    (0x5d, 640),
    (0x60, 800),
    (0x63, 1000),
    (0x65, 1250),
    (0x68, 1600),
    (0x6b, 2000),
    (0x6d, 2500),
    (0x70, 3200),
    (0x73, 4000),
    (0x75, 5000),
    (0x78, 6400),
];

impl Shutter {
    /// Every speed, longest first.
    pub fn all() -> impl Iterator<Item = Self> {
        (0_u32..).zip(SHUTTER_LABELS).map(|(index, label)| {
            let code = 0x10 + 8 * (index / 3) + [0, 3, 5][index as usize % 3];
            // One second is third 15 of the row.
            Self { code, label, true_s: ((15.0 - f64::from(index)) / 3.0).exp2() }
        })
    }

    /// The speed of a code.
    pub fn from_code(code: u32) -> Option<Self> {
        Self::all().find(|shutter| shutter.code == code)
    }
}

impl Aperture {
    /// Every aperture, widest first.
    pub fn all() -> impl Iterator<Item = Self> {
        APERTURES.into_iter().map(|(code, label, f_number)| Self { code, label, f_number })
    }

    /// The aperture of a code.
    pub fn from_code(code: u32) -> Option<Self> {
        Self::all().find(|aperture| aperture.code == code)
    }
}

impl Iso {
    /// Every speed, lowest first.
    pub fn all() -> impl Iterator<Item = Self> {
        ISOS.into_iter().map(|(code, speed)| Self { code, speed })
    }

    /// The speed of a code.
    pub fn from_code(code: u32) -> Option<Self> {
        Self::all().find(|iso| iso.code == code)
    }
}

impl ImageFormat {
    /// Every format offered.
    pub const ALL: [Self; 3] = [Self::Jpeg, Self::Raw, Self::RawAndJpeg];

    /// Number of entries, then for each its size 0x10, type (1 JPEG, 6 raw), size (0 large), compression (3 fine, 4 raw).
    pub(crate) fn bytes(self) -> Vec<u8> {
        const JPEG: [u32; 3] = [1, 0, 3];
        const RAW: [u32; 3] = [6, 0, 4];
        let entries: &[[u32; 3]] = match self {
            Self::Jpeg => &[JPEG],
            Self::Raw => &[RAW],
            Self::RawAndJpeg => &[RAW, JPEG],
        };
        let start = Pack::default().u32(if entries.len() == 1 { 1 } else { 2 });
        entries
            .iter()
            .fold(start, |pack, [kind, size, compression]| pack.u32(0x10).u32(*kind).u32(*size).u32(*compression))
            .0
    }

    /// The format these bytes stand for, if it is offered; what follows it is ignored.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        u32_at(bytes, 0)?;
        Self::ALL.into_iter().find(|format| bytes.starts_with(&format.bytes()))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// Codes and times as published for the bodies: n = code - 0x38, time 2^-(whole + fraction).
    #[test]
    fn codes_labels_and_true_times_agree() {
        let known = [
            (0x10, "30", 32.0),
            (0x18, "15", 16.0),
            (0x1d, "10", 10.079_368_399_158_986),
            (0x23, "6", 6.349_604_207_872_797),
            (0x38, "1", 1.0),
            (0x45, "0.3", 0.314_980_262_473_718_3),
            (0x6d, "1/100", 1.0 / 101.593_667_325_965),
            (0xa0, "1/8000", 1.0 / 8192.0),
        ];
        for (code, label, true_s) in known {
            let shutter = Shutter::from_code(code).unwrap();
            assert_eq!(shutter.label, label);
            assert!((shutter.true_s / true_s - 1.0).abs() < 1e-9, "{label}: {} s", shutter.true_s);
        }
        assert_eq!(Shutter::from_code(0x3c), None, "half stops are not offered");
    }

    #[test]
    fn every_label_is_within_a_sixth_of_a_stop_of_its_time() {
        for shutter in Shutter::all() {
            let label = match shutter.label.split_once('/') {
                Some((_, denominator)) => 1.0 / denominator.parse::<f64>().unwrap(),
                None => shutter.label.parse().unwrap(),
            };
            assert!((label / shutter.true_s).log2().abs() < 1.0 / 6.0, "{}", shutter.label);
        }
    }

    #[test]
    fn apertures_follow_their_codes() {
        for aperture in Aperture::all() {
            let n = aperture.code - 8;
            let stops = f64::from(n / 8) + [0.0, f64::NAN, f64::NAN, 1.0 / 3.0, 0.5, 2.0 / 3.0][n as usize % 8];
            let exact = (stops / 2.0).exp2();
            assert!((aperture.f_number / exact - 1.0).abs() < 0.03, "{} is not {exact}", aperture.label);
        }
    }

    #[test]
    fn image_formats_read_back_and_others_are_refused() {
        for format in ImageFormat::ALL {
            assert_eq!(ImageFormat::from_bytes(&format.bytes()), Some(format));
        }
        assert_eq!(ImageFormat::Raw.bytes()[..8], [1, 0, 0, 0, 0x10, 0, 0, 0]);
        for bytes in [&[][..], &[1], &[2, 0, 0, 0, 0x10, 0, 0, 0], &[1; 20]] {
            assert_eq!(ImageFormat::from_bytes(bytes), None);
        }
    }
}
