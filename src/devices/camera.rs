//! The camera as the session sees it.

use super::Cancel;
use rig_config::Shutter;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};

/// One picture to take. `station` and `exposure` index the plan; a camera that plays stored frames uses them to find its frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// Index of the light station in the plan.
    pub station: usize,
    /// Index of the exposure in the bracket.
    pub exposure: usize,
    /// Shutter to set.
    pub shutter: Shutter,
    /// Aperture to set, f-number.
    pub f_number: f64,
    /// ISO speed to set.
    pub iso: u32,
}

/// A downloaded frame, still as the camera wrote it.
#[derive(Clone, Debug)]
pub struct RawFrame {
    /// The file's bytes.
    pub bytes: Vec<u8>,
    /// The camera's own name of the file.
    pub name: String,
    /// Time the file took from the camera.
    pub transfer: Duration,
}

/// What body this is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraIdentity {
    /// Maker and model as the camera reports it.
    pub model: String,
}

/// What a body says of its card and its battery, where it tells.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Supplies {
    /// Shots that the card still takes.
    pub shots_left: Option<u32>,
    /// The battery in the body's own words: `100%`, `Low`.
    pub battery: Option<String>,
}

/// Why a camera call failed.
#[derive(Clone, Debug, thiserror::Error)]
pub enum CameraError {
    /// The camera could not be opened or used.
    #[error("camera: {reason}")]
    Unusable {
        /// What happened and what to do.
        reason: String,
    },
    /// It is still at an earlier shot; the same call may succeed in half a second.
    #[error("{reason}")]
    Busy {
        /// What it said.
        reason: String,
    },
    /// It refused this call and can be used further.
    #[error("{reason}")]
    Refused {
        /// What it said, and what to do.
        reason: String,
    },
    /// The camera has no frame for this shot.
    #[error("camera: no frame for station {station}, exposure {exposure}: {reason}")]
    NoFrame {
        /// Station of the shot.
        station: usize,
        /// Exposure of the shot.
        exposure: usize,
        /// What happened and what to do.
        reason: String,
    },
    /// The call outlived its deadline; the driver must be reopened.
    #[error("camera: {what} took longer than {deadline_s:.0} s: switch the camera off and on, then start again")]
    Deadline {
        /// The call.
        what: &'static str,
        /// The deadline, seconds.
        deadline_s: f64,
    },
    /// The caller's [`Cancel`] was set before the frame was taken.
    #[error("the shot was cancelled")]
    Cancelled,
}

/// A camera driver: blocking, run on its own thread by [`CameraHandle`].
pub trait Camera: Send {
    /// What body this is.
    fn identity(&self) -> CameraIdentity;
    /// Card and battery as of the opening.
    fn supplies(&self) -> Supplies {
        Supplies::default()
    }
    /// Whether a shot shows what is before the camera now; one that plays stored frames has none but those of the plan.
    fn is_live(&self) -> bool {
        true
    }
    /// Sets the exposure, shoots, downloads.
    fn shoot(&mut self, shot: &Shot, cancel: &Cancel) -> Result<RawFrame, CameraError>;
    /// Called while nothing is shot, so that a body does not go to sleep and what it has to tell is taken.
    fn keep_awake(&mut self) -> Result<(), CameraError> {
        Ok(())
    }
}

/// Time a call may take beyond twice the exposure, seconds: setting, readout, transfer, write.
pub const CALL_GRACE_S: f64 = 30.0;
/// Time a driver has to come back after a cancel, and to let go of the camera at the end.
const RELEASE: Duration = Duration::from_secs(5);
/// A camera that is left alone is kept awake this often: bodies sleep after a minute at the earliest.
const KEEP_AWAKE: Duration = Duration::from_secs(10);
/// How often a waiting call looks at its [`Cancel`].
const LOOK: Duration = Duration::from_millis(50);

type Request = (Shot, Cancel, SyncSender<Result<RawFrame, CameraError>>);

/// A camera on its own thread: no call outlives its deadline, whatever the driver does. After [`CameraError::Deadline`] or
/// [`CameraError::Unusable`] drop the handle and open the camera anew.
pub struct CameraHandle {
    identity: CameraIdentity,
    supplies: Supplies,
    live: bool,
    grace_s: f64,
    inbox: Option<SyncSender<Request>>,
    released: Receiver<()>,
}

impl CameraHandle {
    /// Takes the camera; `grace_s` as [`CALL_GRACE_S`].
    pub fn new(mut camera: Box<dyn Camera>, grace_s: f64) -> Result<Self, CameraError> {
        let (identity, supplies, live) = (camera.identity(), camera.supplies(), camera.is_live());
        let (inbox, requests) = sync_channel::<Request>(1);
        let (release, released) = sync_channel(1);
        let serve = move || {
            loop {
                match requests.recv_timeout(KEEP_AWAKE) {
                    Ok((shot, cancel, reply)) => {
                        // Nobody waits any more when the deadline has passed.
                        let _ = reply.send(camera.shoot(&shot, &cancel));
                    }
                    Err(RecvTimeoutError::Timeout) => {
                        if let Err(error) = camera.keep_awake() {
                            // The next shot meets it again.
                            tracing::warn!(%error, "the camera cannot be kept awake");
                        }
                    }
                    Err(RecvTimeoutError::Disconnected) => break,
                }
            }
            drop(camera);
            let _ = release.send(());
        };
        std::thread::Builder::new()
            .name("camera".into())
            .spawn(serve)
            .map_err(|e| CameraError::Unusable { reason: format!("no thread for its driver: {e}") })?;
        Ok(Self { identity, supplies, live, grace_s, inbox: Some(inbox), released })
    }

    /// What body this is.
    pub fn identity(&self) -> &CameraIdentity {
        &self.identity
    }

    /// Card and battery as of the opening.
    pub fn supplies(&self) -> &Supplies {
        &self.supplies
    }

    /// As [`Camera::is_live`].
    pub fn is_live(&self) -> bool {
        self.live
    }

    /// Shoots within twice the exposure and the grace time.
    pub fn shoot(&self, shot: &Shot, cancel: &Cancel) -> Result<RawFrame, CameraError> {
        let deadline_s = 2.0 * shot.shutter.true_s + self.grace_s;
        let ended = || CameraError::Unusable { reason: "its driver has ended".into() };
        let (reply, answer) = sync_channel(1);
        let inbox = self.inbox.as_ref().ok_or_else(ended)?;
        inbox.try_send((shot.clone(), cancel.clone(), reply)).map_err(|error| match error {
            TrySendError::Full(_) => {
                CameraError::Unusable { reason: "its driver is still busy with a late call".into() }
            }
            TrySendError::Disconnected(_) => ended(),
        })?;
        let mut end = Instant::now() + Duration::from_secs_f64(deadline_s);
        let mut cancelled = false;
        loop {
            if cancel.is_cancelled() && !cancelled {
                cancelled = true;
                end = end.min(Instant::now() + RELEASE);
            }
            let left = end.saturating_duration_since(Instant::now());
            match answer.recv_timeout(left.min(LOOK)) {
                Ok(result) => return result,
                Err(RecvTimeoutError::Disconnected) => return Err(ended()),
                Err(RecvTimeoutError::Timeout) if !left.is_zero() => {}
                Err(RecvTimeoutError::Timeout) if cancelled => return Err(CameraError::Cancelled),
                Err(RecvTimeoutError::Timeout) => return Err(CameraError::Deadline { what: "a shot", deadline_s }),
            }
        }
    }

    /// Lets go of the camera; false when its driver did not come back in time and was left behind.
    pub fn release(mut self) -> bool {
        self.inbox = None;
        !matches!(self.released.recv_timeout(RELEASE), Err(RecvTimeoutError::Timeout))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;

    /// Answers at once, hangs until its sender is dropped, or panics.
    enum Driver {
        Prompt,
        Hanging(Receiver<()>),
        Panicking,
    }

    impl Camera for Driver {
        fn identity(&self) -> CameraIdentity {
            CameraIdentity { model: "test".into() }
        }
        fn shoot(&mut self, shot: &Shot, _cancel: &Cancel) -> Result<RawFrame, CameraError> {
            match self {
                Self::Prompt => {}
                Self::Hanging(until) => drop(until.recv()),
                Self::Panicking => panic!("as planned"),
            }
            Ok(RawFrame {
                bytes: vec![7],
                name: format!("{}-{}", shot.station, shot.exposure),
                transfer: Duration::ZERO,
            })
        }
    }

    fn shot() -> Shot {
        let shutter = Shutter { label: "1/8000".into(), nominal_s: 1.25e-4, true_s: 1.0 / 8192.0 };
        Shot { station: 2, exposure: 3, shutter, f_number: 5.6, iso: 100 }
    }

    #[test]
    fn a_prompt_camera_delivers_and_is_released() {
        let handle = CameraHandle::new(Box::new(Driver::Prompt), 30.0).unwrap();
        assert_eq!(handle.shoot(&shot(), &Cancel::default()).unwrap().name, "2-3");
        assert!(handle.release());
    }

    #[test]
    fn a_hanging_call_ends_at_its_deadline_and_the_handle_says_so_from_then_on() {
        let (free, until) = sync_channel(1);
        let handle = CameraHandle::new(Box::new(Driver::Hanging(until)), 0.05).unwrap();
        let late = handle.shoot(&shot(), &Cancel::default());
        assert!(matches!(late, Err(CameraError::Deadline { .. })), "{late:?}");
        let again = handle.shoot(&shot(), &Cancel::default());
        assert!(matches!(again, Err(CameraError::Deadline { .. } | CameraError::Unusable { .. })), "{again:?}");
        drop(free);
        assert!(handle.release());
    }

    #[test]
    fn a_panicking_driver_is_an_error_not_a_hang() {
        let handle = CameraHandle::new(Box::new(Driver::Panicking), 30.0).unwrap();
        assert!(matches!(handle.shoot(&shot(), &Cancel::default()), Err(CameraError::Unusable { .. })));
        assert!(handle.release());
    }
}
