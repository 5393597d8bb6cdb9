//! Requests and replies.

use crate::labels::{Aperture, Format, ImageFormat, Iso, Shutter};
use serde::{Deserialize, Serialize};

/// Version of these messages; both sides must have the same.
pub const PROTOCOL: u32 = 3;

/// Third stops from one second that a shutter can be: a microsecond to an hour.
const SHUTTERS: std::ops::RangeInclusive<i32> = -60..=36;

/// A request with the time its caller gives it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Call {
    /// The caller's number of this request; its reply has the same.
    pub number: u64,
    /// Seconds until the caller kills the worker. The worker does not watch it: a call of the library may never return.
    pub deadline_s: f64,
    /// What is wanted.
    pub request: Request,
}

/// What the daemon wants.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// The first request: which messages the daemon speaks. Answered by [`Reply::Hello`].
    Hello {
        /// [`PROTOCOL`].
        protocol: u32,
    },
    /// Opens a camera, closing one that is open. Answered by [`Reply::Identity`].
    Open {
        /// Model as libgphoto2 spells it; without it the only one found.
        model: Option<String>,
        /// Port as libgphoto2 spells it: `usb:001,005`, `ptpip:127.0.0.1:15740:15740`; without it the only one found.
        port: Option<String>,
        /// Serial number: of the cameras found the one whose body has it; without it there must be only one.
        serial: Option<String>,
    },
    /// Sets, exposes, and hands over the files. Answered by [`Reply::Files`].
    Shoot(Shot),
    /// Keeps the camera awake and takes what it has to tell. Answered by [`Reply::Idle`].
    Idle {
        /// How long, seconds.
        seconds: f64,
    },
    /// Resets the USB device. Answered by [`Reply::Failed`] so far: the crate has no such call, and PTP/IP has no such thing.
    Reset,
    /// Lets go of the camera. Answered by [`Reply::Closed`].
    Close,
}

impl Request {
    /// Time to give it, seconds: an exposure twice (noise reduction doubles it) and 30 s, all else 30 s (a single operation over
    /// USB may take libgphoto2 20 s), and idling its own time besides.
    pub fn deadline_s(&self) -> f64 {
        match self {
            Self::Shoot(shot) => 30.0 + 2.0 * shot.shutter.true_s().unwrap_or(0.0),
            Self::Idle { seconds } => 30.0 + seconds,
            Self::Hello { .. } | Self::Open { .. } | Self::Reset | Self::Close => 30.0,
        }
    }
}

/// A shutter speed that is wanted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ShutterWish {
    /// As a body in third-stop mode writes it: `1/100`, `0.4`, `15`.
    Label(String),
    /// Third stops from one second: 2^(k/3) s.
    Thirds(i32),
}

impl ShutterWish {
    /// The time the shutter is really open, seconds; none if it is no time of a shutter.
    pub fn true_s(&self) -> Option<f64> {
        match self {
            Self::Label(label) => Shutter::from_label(label).map(|shutter| shutter.true_s),
            Self::Thirds(k) => SHUTTERS.contains(k).then(|| (f64::from(*k) / 3.0).exp2()),
        }
    }
}

/// One exposure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shot {
    /// Shutter speed.
    pub shutter: ShutterWish,
    /// Aperture, f-number.
    pub f_number: f64,
    /// ISO speed.
    pub iso: u32,
    /// Files wanted.
    pub format: ImageFormat,
}

/// A reply with the number of the request it answers, so that one said twice or late is not believed of another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// [`Call::number`].
    pub number: u64,
    /// What the worker says.
    pub reply: Reply,
}

/// What the worker answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reply {
    /// Which messages the worker speaks.
    Hello {
        /// [`PROTOCOL`].
        protocol: u32,
        /// Version of the worker.
        version: String,
    },
    /// The camera that is now open.
    Identity(Box<Identity>),
    /// The files of a shot. Their bytes are the frame's blob, one after another.
    Files {
        /// Names and sizes, in the order of the blob.
        files: Vec<FileEntry>,
        /// What the driver says was set: no proof, it may be the driver's own memory. Verify by the files.
        read_back: ReadBack,
        /// Files of earlier shots that the camera announced only now.
        unexpected: Vec<FilePlace>,
        /// Time the files took from the camera, seconds.
        transfer_s: f64,
    },
    /// The idling is over.
    Idle {
        /// Files that the camera announced meanwhile and nobody asked for: late ones of an earlier shot.
        unexpected: Vec<FilePlace>,
    },
    /// The camera is let go.
    Closed,
    /// The request failed.
    Failed(Failure),
}

/// What camera is open, and what it offers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// Model as the body says it, or as libgphoto2 spells it where the body says nothing.
    pub model: String,
    /// The driver.
    pub driver: Driver,
    /// Port as libgphoto2 spells it.
    pub port: String,
    /// Serial number of the body, where it tells one.
    pub serial: Option<String>,
    /// Shutter speeds offered, without bulb and automatic.
    pub shutters: Vec<Shutter>,
    /// Apertures offered; empty if none can be set (a manual lens).
    pub apertures: Vec<Aperture>,
    /// ISO speeds offered.
    pub isos: Vec<Iso>,
    /// Image formats offered that can be used.
    pub formats: Vec<Format>,
    /// Capture targets offered; empty if there is no choice.
    pub targets: Vec<String>,
    /// Shots that the card still takes, where the body tells.
    pub available_shots: Option<u32>,
    /// Battery as the body words it, where it tells.
    pub battery: Option<String>,
}

/// Driver of libgphoto2.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Driver {
    /// PTP bodies: EOS 5D Mark II and newer.
    Ptp2,
    /// The Canon protocol before PTP: EOS 5D in "PC connection" mode.
    Canon,
}

/// Where a file is on the camera.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct FilePlace {
    /// Folder, such as `/store_00020001/DCIM/100EOS5D`.
    pub folder: String,
    /// Name, such as `IMG_0001.CR2`.
    pub name: String,
}

/// A file of a shot.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileEntry {
    /// Where it is and stays.
    pub place: FilePlace,
    /// Bytes of the file, in the blob.
    pub size: u64,
}

/// Settings as the driver reads them back.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReadBack {
    /// Shutter label.
    pub shutter: String,
    /// Aperture label, if apertures can be set.
    pub aperture: Option<String>,
    /// ISO label.
    pub iso: String,
    /// Format label.
    pub format: String,
}

/// Why a request failed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("camera, {step}: {what}")]
pub struct Failure {
    /// What was being done.
    pub step: Step,
    /// What happened and what to do, in words.
    pub what: String,
    /// The library's own words on it.
    pub library: Option<LibraryError>,
    /// What can be done with the camera now.
    pub handle: HandleState,
}

/// An error of libgphoto2.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LibraryError {
    /// Its number, such as -110. Numbers that the crate has no name for come as -1.
    pub number: i32,
    /// Its name, such as `GP_ERROR_CAMERA_BUSY`.
    pub name: String,
    /// The last error text of the library, which often says more.
    pub context: Option<String>,
}

/// Part of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Step {
    /// Agreeing on the messages.
    Handshake,
    /// Finding and opening the camera.
    Open,
    /// Reading what it offers.
    Read,
    /// Setting shutter, aperture, ISO, format or target.
    Set,
    /// Taking what it still had to tell.
    Drain,
    /// Releasing and waiting for the file.
    Capture,
    /// Fetching a file.
    Download,
    /// Keeping it awake.
    Idle,
    /// Resetting it.
    Reset,
}

impl std::fmt::Display for Step {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Handshake => "handshake",
            Self::Open => "opening",
            Self::Read => "reading settings",
            Self::Set => "setting",
            Self::Drain => "taking events",
            Self::Capture => "capture",
            Self::Download => "download",
            Self::Idle => "idling",
            Self::Reset => "reset",
        })
    }
}

/// What a failure leaves of the open camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HandleState {
    /// It can be used; the request was wrong or the camera refused it.
    Ready,
    /// It can be used, and the same request may succeed after half a second.
    Busy,
    /// It must be opened anew.
    Dead,
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn calls_are_as_documented() {
        let call: Call = serde_json::from_str(
            r#"{"number": 7, "deadline_s": 62, "request": {"shoot": {"shutter": {"label": "15"}, "f_number": 5.6, "iso": 100, "format": "raw"}}}"#,
        )
        .unwrap();
        let shot = Shot { shutter: ShutterWish::Label("15".into()), f_number: 5.6, iso: 100, format: ImageFormat::Raw };
        assert_eq!(call, Call { number: 7, deadline_s: 62.0, request: Request::Shoot(shot) });
        assert_eq!(call.request.deadline_s(), 62.0, "a dial of 15 is 16 s");
        assert!(
            serde_json::from_str::<Call>(r#"{"number": 7, "deadline_s": 1, "request": {"format": "disk"}}"#).is_err()
        );
    }

    #[test]
    fn thirds_and_labels_mean_the_same() {
        assert_eq!(ShutterWish::Thirds(12).true_s(), Some(16.0));
        assert_eq!(ShutterWish::Thirds(12).true_s(), ShutterWish::Label("15".into()).true_s());
        assert_eq!(ShutterWish::Label("bulb".into()).true_s(), None);
        assert_eq!([i32::MIN, -61, 37, i32::MAX].map(|k| ShutterWish::Thirds(k).true_s()), [None; 4]);
    }
}
