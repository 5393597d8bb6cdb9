//! Finding a camera, opening it, and what it offers.

use crate::library::{call, refused};
use crate::settings::Settings;
use camera_messages::labels;
use camera_messages::message::{Driver, Failure, FilePlace, HandleState, Identity, Step};
use camera_messages::words;
use gphoto2::camera::CameraEvent;
use gphoto2::file::CameraFilePath;
use gphoto2::list::CameraDescriptor;
use gphoto2::{Camera, Context};
use std::collections::HashSet;
use std::time::{Duration, Instant};

/// A PTP/IP camera cannot be detected; libgphoto2 asks it what it is.
const PTP_IP_MODEL: &str = "PTP/IP Camera";
/// The card, in both spellings of libgphoto2's drivers.
const CARD: &str = "Memory card";
/// One wait for events while idling.
const PUMP: Duration = Duration::from_millis(500);

/// A camera that is open.
pub(crate) struct OpenCamera {
    pub(crate) camera: Camera,
    identity: Identity,
    /// Every file announced so far, so that none is taken for a later shot's.
    pub(crate) seen: HashSet<FilePlace>,
}

impl OpenCamera {
    /// Opens the camera of this model at this port: the only one found, or of several the one with this serial number.
    pub(crate) fn open(
        context: &Context,
        model: Option<String>,
        port: Option<String>,
        serial: Option<String>,
    ) -> Result<Self, Failure> {
        let opened = find(context, model, port).and_then(|found| match serial {
            Some(serial) => open_body(context, found, &serial),
            None => open(context, only(found)?),
        });
        opened.map_err(|failure| Failure { handle: HandleState::Dead, ..failure })
    }

    pub(crate) fn identity(&self) -> &Identity {
        &self.identity
    }

    pub(crate) fn settings(&self) -> Settings<'_> {
        Settings(&self.camera)
    }

    /// Adds a file that was just announced, unless it had been announced before.
    pub(crate) fn note(&mut self, places: &mut Vec<FilePlace>, place: FilePlace) {
        if self.seen.insert(place.clone()) {
            places.push(place);
        }
    }

    /// Keeps the camera awake; the files that it announces meanwhile.
    pub(crate) fn idle(&mut self, time: Duration) -> Result<Vec<FilePlace>, Failure> {
        let end = Instant::now() + time;
        let mut unexpected = Vec::new();
        // The old driver has no events and needs no keep-awake.
        while self.identity.driver == Driver::Ptp2 {
            let left = end.saturating_duration_since(Instant::now());
            if let CameraEvent::NewFile(path) = call(Step::Idle, self.camera.wait_event(left.min(PUMP)))? {
                self.note(&mut unexpected, place(&path));
            }
            if left.is_zero() {
                return Ok(unexpected);
            }
        }
        std::thread::sleep(end.saturating_duration_since(Instant::now()));
        Ok(unexpected)
    }
}

/// Where a file is.
pub(crate) fn place(path: &CameraFilePath) -> FilePlace {
    FilePlace { folder: path.folder().into(), name: path.name().into() }
}

/// Opens one camera after another until one has the serial number. What another program holds is passed over.
fn open_body(context: &Context, found: Vec<CameraDescriptor>, serial: &str) -> Result<OpenCamera, Failure> {
    let (mut others, mut failed) = (Vec::new(), None);
    for descriptor in found {
        match open(context, descriptor) {
            Ok(camera) if camera.identity.serial.as_deref() == Some(serial) => return Ok(camera),
            Ok(camera) => others.push((camera.identity.port, camera.identity.serial)),
            Err(failure) => failed = Some(failure),
        }
    }
    Err(match failed {
        Some(failure) => failure,
        None if others.is_empty() => refused(Step::Open, words::which_camera(&[])),
        None => refused(Step::Open, words::other_bodies(serial, &others)),
    })
}

fn open(context: &Context, descriptor: CameraDescriptor) -> Result<OpenCamera, Failure> {
    let camera = call(Step::Open, context.get_camera(&descriptor))?;
    let abilities = camera.abilities();
    let driver = words::driver(&abilities.id());
    let operations = abilities.camera_operations();
    let refusal = words::refusal(&descriptor.model, driver, operations.capture_image(), operations.configure());
    let driver = match (refusal, driver) {
        (None, Some(driver)) => driver,
        (words, _) => return Err(refused(Step::Open, words.unwrap_or_default())),
    };
    let settings = Settings(&camera);
    let targets = settings.offered("capturetarget")?.unwrap_or_default();
    if driver == Driver::Ptp2 {
        to_card(&settings, &targets)?;
    }
    let identity = identity(&settings, descriptor, driver, targets)?;
    Ok(OpenCamera { camera, identity, seen: HashSet::new() })
}

/// Cameras of this model at this port. What is named in full is not looked for.
fn find(context: &Context, model: Option<String>, port: Option<String>) -> Result<Vec<CameraDescriptor>, Failure> {
    match (model, port) {
        (Some(model), Some(port)) => Ok(vec![CameraDescriptor { model, port }]),
        (None, Some(port)) if port.starts_with("ptpip:") => {
            Ok(vec![CameraDescriptor { model: PTP_IP_MODEL.into(), port }])
        }
        (model, port) => {
            let wanted = |found: &CameraDescriptor| {
                model.as_ref().is_none_or(|model| *model == found.model)
                    && port.as_ref().is_none_or(|port| *port == found.port)
            };
            Ok(call(Step::Open, context.list_cameras())?.filter(wanted).collect())
        }
    }
}

fn only(found: Vec<CameraDescriptor>) -> Result<CameraDescriptor, Failure> {
    <[CameraDescriptor; 1]>::try_from(found).map(|[only]| only).map_err(|found| {
        let all: Vec<_> = found.into_iter().map(|found| (found.model, found.port)).collect();
        refused(Step::Open, words::which_camera(&all))
    })
}

/// Makes pictures go to the card. The choice is the host's own, kept in its home, and applied by the library before each capture.
fn to_card(settings: &Settings<'_>, targets: &[String]) -> Result<(), Failure> {
    if !targets.iter().any(|target| target == CARD) {
        let all = targets.join(", ");
        return Err(refused(Step::Set, format!("pictures cannot go to a card, only to {all}: put a card in")));
    }
    settings.set("capturetarget", CARD)?;
    match settings.choice("capturetarget")? {
        Some(target) if target == CARD => Ok(()),
        target => Err(refused(Step::Set, format!("pictures go to {target:?} although the card was set"))),
    }
}

fn identity(
    settings: &Settings<'_>,
    descriptor: CameraDescriptor,
    driver: Driver,
    targets: Vec<String>,
) -> Result<Identity, Failure> {
    let offered = |key| Ok(settings.offered(key)?.unwrap_or_default());
    let shutters = labels::shutters(&offered("shutterspeed")?).map_err(|half_stop| {
        let what = format!(
            "the body offers a shutter of {half_stop}: it is in half-stop mode, in which labels mean other times; set its custom \
             function for exposure steps to 1/3 stop"
        );
        refused(Step::Read, what)
    })?;
    if shutters.is_empty() {
        let what = "the body offers no shutter speeds: turn its mode dial to M and switch the lens to MF";
        return Err(refused(Step::Read, what));
    }
    let shots = settings.text("availableshots")?;
    Ok(Identity {
        model: settings.text("cameramodel")?.unwrap_or(descriptor.model),
        driver,
        port: descriptor.port,
        serial: match settings.text("eosserialnumber")? {
            Some(serial) => Some(serial),
            None => settings.text("serialnumber")?,
        },
        shutters,
        apertures: labels::apertures(&offered("aperture")?),
        isos: labels::isos(&offered("iso")?),
        formats: labels::formats(&offered("imageformat")?),
        targets,
        available_shots: shots.and_then(|shots| shots.parse().ok()),
        battery: settings.text("batterylevel")?,
    })
}
