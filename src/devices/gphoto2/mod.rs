//! A camera behind libgphoto2, which runs in a process of its own: the camera worker (package `camera-worker`).

pub mod remedies;
mod worker;

pub use worker::{Worker, WorkerCommand, WorkerError};

use super::Cancel;
use super::camera::{Camera, CameraError, CameraIdentity, RawFrame, Shot, Supplies};
use camera_messages::labels::ImageFormat;
use camera_messages::message::{self, HandleState, Identity, Reply, Request, ShutterWish};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How long a call goes on after its caller gave up: a shot cut short confuses the body more than one that ends.
const AFTER_CANCEL: Duration = Duration::from_secs(4);
/// Shots after which the worker is replaced: libgphoto2 leaks a little with every one.
const SHOTS_PER_WORKER: u32 = 200;
/// One pumping of events while nothing is shot, seconds.
const PUMP_S: f64 = 0.2;

/// Which camera, and how it is reached.
#[derive(Clone, Debug)]
pub struct Gphoto2Settings {
    /// How the worker is started.
    pub worker: WorkerCommand,
    /// Model as libgphoto2 spells it; the only one found if none.
    pub model: Option<String>,
    /// Port as libgphoto2 spells it; the only one found if none.
    pub port: Option<String>,
    /// Serial number of the body that was opened first: what comes back after a fault must be the same. Clones share it.
    pub body: KnownBody,
}

/// The body that a daemon works with, once it has opened one.
#[derive(Clone, Debug, Default)]
pub struct KnownBody(Arc<Mutex<Known>>);

#[derive(Debug, Default)]
struct Known {
    serial: Option<String>,
    port: Option<String>,
}

impl KnownBody {
    fn known(&self) -> MutexGuard<'_, Known> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Remembers the first serial number and the last port; an error names another body.
    fn same(&self, identity: &Identity) -> Result<(), CameraError> {
        let mut body = self.known();
        body.port = Some(identity.port.clone());
        let Some(serial) = &identity.serial else { return Ok(()) };
        let known = body.serial.get_or_insert_with(|| serial.clone());
        if known == serial {
            return Ok(());
        }
        Err(unusable(format!("the body with serial number {serial} answers instead of {known}: connect the right one")))
    }

    fn serial(&self) -> Option<String> {
        self.known().serial.clone()
    }

    fn last_port(&self) -> Option<String> {
        self.known().port.clone()
    }
}

/// An open camera. After an error other than [`CameraError::Busy`] and [`CameraError::Refused`] it must be opened anew.
pub struct Gphoto2Camera {
    settings: Gphoto2Settings,
    worker: Option<Worker>,
    identity: Identity,
    shots: u32,
}

impl Gphoto2Camera {
    /// Starts a worker and opens the camera.
    ///
    /// # Errors
    /// [`CameraError::Unusable`] with what the worker or the camera said, and what to do; [`CameraError::Cancelled`].
    pub fn open(settings: Gphoto2Settings, cancel: &Cancel) -> Result<Self, CameraError> {
        let (worker, identity) = connect(&settings, cancel)?;
        settings.body.same(&identity)?;
        Ok(Self { settings, worker: Some(worker), identity, shots: 0 })
    }

    /// What the camera is and offers.
    pub fn offers(&self) -> &Identity {
        &self.identity
    }

    fn call(&mut self, request: Request, cancel: &Cancel) -> Result<(Reply, Vec<u8>), CameraError> {
        let worker = self.worker.as_mut().ok_or_else(|| unusable("its worker has ended".into()))?;
        let since = std::cell::Cell::new(None);
        let given_up = || {
            if cancel.is_cancelled() && since.get().is_none() {
                since.set(Some(Instant::now()));
            }
            since.get().is_some_and(|since: Instant| since.elapsed() > AFTER_CANCEL)
        };
        let result = worker.call(request, &given_up);
        let lives = match &result {
            Ok(_) => true,
            Err(WorkerError::Failed(failure)) => failure.handle != HandleState::Dead,
            Err(_) => false,
        };
        if !lives {
            self.worker = None;
        }
        result.map_err(camera_error)
    }
}

impl Camera for Gphoto2Camera {
    fn identity(&self) -> CameraIdentity {
        CameraIdentity { model: self.identity.model.clone() }
    }

    fn supplies(&self) -> Supplies {
        Supplies { shots_left: self.identity.available_shots, battery: self.identity.battery.clone() }
    }

    fn shoot(&mut self, shot: &Shot, cancel: &Cancel) -> Result<RawFrame, CameraError> {
        if self.shots >= SHOTS_PER_WORKER {
            self.worker = None;
            *self = Self::open(self.settings.clone(), cancel)?;
        }
        if cancel.is_cancelled() {
            return Err(CameraError::Cancelled);
        }
        self.shots += 1;
        let wish = message::Shot {
            shutter: ShutterWish::Label(shot.shutter.label.clone()),
            f_number: shot.f_number,
            iso: shot.iso,
            format: ImageFormat::Jpeg,
        };
        match self.call(Request::Shoot(wish), cancel)? {
            (Reply::Files { files, unexpected, transfer_s, .. }, bytes) => {
                for place in unexpected {
                    tracing::warn!(
                        folder = place.folder,
                        name = place.name,
                        "the camera announced a file of an earlier shot"
                    );
                }
                let name = files.into_iter().next().map(|file| format!("{}/{}", file.place.folder, file.place.name));
                let transfer = Duration::try_from_secs_f64(transfer_s).unwrap_or_default();
                Ok(RawFrame { bytes, name: name.unwrap_or_default(), transfer })
            }
            (other, _) => Err(unexpected_reply(&other)),
        }
    }

    fn keep_awake(&mut self) -> Result<(), CameraError> {
        self.call(Request::Idle { seconds: PUMP_S }, &Cancel::default()).map(|_| ())
    }
}

/// A worker with the camera open. On USB a body comes back under another number, and another body may have its former one: once it
/// is known it is looked for by its serial number alone.
fn connect(settings: &Gphoto2Settings, cancel: &Cancel) -> Result<(Worker, Identity), CameraError> {
    let on_usb = settings.port.as_ref().is_none_or(|port| port.starts_with("usb:"));
    let serial = settings.body.serial().filter(|_| on_usb);
    let port = settings.port.clone().filter(|_| serial.is_none());
    let given_up = || cancel.is_cancelled();
    let mut worker = Worker::start(&settings.worker, &given_up).map_err(camera_error)?;
    let request = Request::Open { model: settings.model.clone(), port, serial };
    match worker.call(request, &given_up).map_err(camera_error)? {
        (Reply::Identity(identity), _) => Ok((worker, *identity)),
        (other, _) => Err(unexpected_reply(&other)),
    }
}

fn camera_error(error: WorkerError) -> CameraError {
    match error {
        WorkerError::Failed(failure) => match failure.handle {
            HandleState::Busy => CameraError::Busy { reason: failure.to_string() },
            HandleState::Ready => CameraError::Refused { reason: failure.to_string() },
            HandleState::Dead => unusable(failure.to_string()),
        },
        WorkerError::Deadline(deadline_s) => CameraError::Deadline { what: "a request", deadline_s },
        WorkerError::GivenUp => CameraError::Cancelled,
        other => unusable(other.to_string()),
    }
}

fn unusable(reason: String) -> CameraError {
    CameraError::Unusable { reason }
}

fn unexpected_reply(reply: &Reply) -> CameraError {
    unusable(format!("its worker answered out of turn ({reply:?})"))
}
