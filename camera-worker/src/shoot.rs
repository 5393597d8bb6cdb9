//! One shot: settings, release, files.

use crate::camera::{OpenCamera, place};
use crate::library::{call, refused};
use camera_messages::labels;
use camera_messages::message::{Driver, Failure, FileEntry, FilePlace, ReadBack, Reply, Shot, Step};
use gphoto2::camera::CameraEvent;
use std::time::{Duration, Instant};

/// Silence after which a camera is taken to have no more to tell.
const SILENCE: Duration = Duration::from_millis(300);
/// Longest wait for the files that follow the first one.
const LAST_FILE: Duration = Duration::from_secs(20);
/// Longest draining of old events.
const OLD_EVENTS: Duration = Duration::from_secs(10);
/// What the `canon` driver calls a file that it did not find.
const NOT_FOUND: &str = "*UNKNOWN*";

/// Labels chosen among those offered.
struct Labels {
    shutter: String,
    aperture: Option<String>,
    iso: String,
    format: String,
}

impl OpenCamera {
    /// Sets, exposes, fetches. The files stay on the card: one body hangs after a deletion, and a copy does no harm.
    pub(crate) fn shoot(&mut self, shot: &Shot) -> Result<(Reply, Vec<u8>), Failure> {
        let labels = self.choose(shot)?;
        let unexpected = self.drain()?;
        let read_back = self.set(&labels)?;
        self.check_room()?;
        let places = self.capture(shot)?;
        let (mut files, mut blob, begin) = (Vec::new(), Vec::new(), Instant::now());
        for place in places {
            let bytes = self.fetch(&place)?;
            files.push(FileEntry { place, size: bytes.len() as u64 });
            blob.extend_from_slice(&bytes);
        }
        let transfer_s = begin.elapsed().as_secs_f64();
        Ok((Reply::Files { files, read_back, unexpected, transfer_s }, blob))
    }

    fn choose(&self, shot: &Shot) -> Result<Labels, Failure> {
        let offered = self.identity();
        let none = |what: String| refused(Step::Set, what);
        let true_s = shot.shutter.true_s().ok_or_else(|| none(format!("{:?} is no shutter speed", shot.shutter)))?;
        let shutter = labels::nearest_shutter(&offered.shutters, true_s).ok_or_else(|| {
            none(format!("the camera offers no shutter speed within a sixth of a stop of {true_s} s"))
        })?;
        let aperture = if offered.apertures.is_empty() {
            None
        } else {
            let nearest = labels::nearest_aperture(&offered.apertures, shot.f_number);
            Some(nearest.ok_or_else(|| none(format!("the camera offers no aperture near f/{}", shot.f_number)))?)
        };
        let iso = offered.isos.iter().find(|iso| iso.iso == shot.iso);
        let iso = iso.ok_or_else(|| none(format!("the camera offers no ISO {}", shot.iso)))?;
        let format = offered.formats.iter().find(|format| format.format == shot.format);
        let format = format.ok_or_else(|| none(format!("the camera offers no image format {:?}", shot.format)))?;
        Ok(Labels {
            shutter: shutter.label.clone(),
            aperture: aperture.map(|aperture| aperture.label.clone()),
            iso: iso.label.clone(),
            format: format.label.clone(),
        })
    }

    fn set(&self, labels: &Labels) -> Result<ReadBack, Failure> {
        let settings = self.settings();
        settings.set("imageformat", &labels.format)?;
        settings.set("iso", &labels.iso)?;
        if let Some(aperture) = &labels.aperture {
            settings.set("aperture", aperture)?;
        }
        settings.set("shutterspeed", &labels.shutter)?;
        let read = |key| Ok(settings.choice(key)?.unwrap_or_default());
        Ok(ReadBack {
            shutter: read("shutterspeed")?,
            aperture: labels.aperture.as_ref().map(|_| read("aperture")).transpose()?,
            iso: read("iso")?,
            format: read("imageformat")?,
        })
    }

    /// A release on a full card can keep the library waiting for 90 s.
    fn check_room(&self) -> Result<(), Failure> {
        match self.settings().text("availableshots")?.as_deref() {
            Some("0") => Err(refused(Step::Capture, "the card is full: put in an empty one")),
            _ => Ok(()),
        }
    }

    /// Takes what the camera still has to tell of earlier shots: the library would throw it away at the release.
    fn drain(&mut self) -> Result<Vec<FilePlace>, Failure> {
        let mut files = Vec::new();
        let end = Instant::now() + OLD_EVENTS;
        while self.has_events() && Instant::now() < end {
            match call(Step::Drain, self.camera.wait_event(Duration::ZERO))? {
                CameraEvent::Timeout => break,
                CameraEvent::NewFile(path) => self.note(&mut files, place(&path)),
                _ => {}
            }
        }
        Ok(files)
    }

    /// Releases, and waits for all files of the shot and for the camera to be ready.
    fn capture(&mut self, shot: &Shot) -> Result<Vec<FilePlace>, Failure> {
        let wanted = shot.format.files();
        let first = call(Step::Capture, self.camera.capture_image())?;
        if first.name() == NOT_FOUND || first.name().is_empty() {
            let what = "the camera released but its file was not found: take the picture again, on an empty card if this repeats";
            return Err(refused(Step::Capture, what));
        }
        let mut places = Vec::new();
        self.note(&mut places, place(&first));
        // The first file may be an earlier shot's, and then this exposure still lasts.
        let time =
            LAST_FILE + Duration::try_from_secs_f64(2.0 * shot.shutter.true_s().unwrap_or(0.0)).unwrap_or_default();
        let end = Instant::now() + time;
        while self.has_events() && Instant::now() < end {
            match call(Step::Capture, self.camera.wait_event(SILENCE))? {
                CameraEvent::NewFile(path) => self.note(&mut places, place(&path)),
                CameraEvent::CaptureComplete | CameraEvent::Timeout if places.len() >= wanted => break,
                _ => {}
            }
        }
        if places.len() < wanted {
            let what = format!("{} of {wanted} files of the shot came: take the picture again", places.len());
            return Err(refused(Step::Capture, what));
        }
        Ok(places)
    }

    fn fetch(&self, FilePlace { folder, name }: &FilePlace) -> Result<Box<[u8]>, Failure> {
        let fs = self.camera.fs();
        let file = call(Step::Download, fs.download(folder, name))?;
        let bytes = call(Step::Download, file.get_data(&self.camera))?;
        let announced = call(Step::Download, fs.file_info(folder, name))?.file().size();
        match announced {
            Some(size) if size != bytes.len() as u64 => {
                let what =
                    format!("{name} came with {} bytes; the camera says {size}: take the picture again", bytes.len());
                Err(refused(Step::Download, what))
            }
            _ => Ok(bytes),
        }
    }

    /// The old driver has none to tell.
    fn has_events(&self) -> bool {
        self.identity().driver == Driver::Ptp2
    }
}
