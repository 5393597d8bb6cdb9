//! The sensor on its own thread, and the exposure under way.

use crate::faults::after;
use crate::sensor::{ExposureSettings, Picture, Sensor};
use std::io;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// An exposure that has begun.
#[derive(Debug)]
pub(super) struct Exposing {
    pub(super) settings: ExposureSettings,
    /// Whether the files go to the card, else over the body's memory to the host.
    pub(super) to_card: bool,
    closes: Instant,
    pictures: Option<Vec<Picture>>,
}

/// The sensor's thread. It ends with its last exposure when this is dropped.
#[derive(Debug)]
pub(super) struct Exposer {
    orders: Option<Sender<ExposureSettings>>,
    done: Receiver<Vec<Picture>>,
    thread: Option<JoinHandle<()>>,
    under_way: Option<Exposing>,
}

impl Exposer {
    pub(super) fn new(mut sensor: Box<dyn Sensor>) -> io::Result<Self> {
        let (orders, inbox) = channel::<ExposureSettings>();
        let (outbox, done) = channel();
        let expose = move || {
            for settings in inbox {
                if outbox.send(sensor.expose(&settings)).is_err() {
                    return;
                }
            }
        };
        let thread = std::thread::Builder::new().name("sensor".into()).spawn(expose)?;
        Ok(Self { orders: Some(orders), done, thread: Some(thread), under_way: None })
    }

    pub(super) fn is_busy(&self) -> bool {
        self.under_way.is_some()
    }

    /// Opens the shutter for `open`; false if the sensor's thread is gone.
    pub(super) fn open_shutter(&mut self, settings: ExposureSettings, to_card: bool, open: Duration) -> bool {
        let sent = self.orders.as_ref().is_some_and(|orders| orders.send(settings.clone()).is_ok());
        if sent {
            self.under_way = Some(Exposing { settings, to_card, closes: after(Instant::now(), open), pictures: None });
        }
        sent
    }

    /// The exposure and its files, once it has lasted its time and the sensor is done. No files if the sensor failed.
    pub(super) fn finished(&mut self, now: Instant) -> Option<(Exposing, Vec<Picture>)> {
        let exposing = self.under_way.as_mut()?;
        if exposing.pictures.is_none() {
            exposing.pictures = match self.done.try_recv() {
                Ok(pictures) => Some(pictures),
                Err(TryRecvError::Disconnected) => Some(Vec::new()),
                Err(TryRecvError::Empty) => None,
            };
        }
        if now < exposing.closes {
            return None;
        }
        let pictures = exposing.pictures.take()?;
        self.under_way.take().map(|exposing| (exposing, pictures))
    }
}

impl Drop for Exposer {
    fn drop(&mut self) {
        self.orders = None;
        if let Some(thread) = self.thread.take() {
            // A sensor that panicked has been reported already.
            let _ = thread.join();
        }
    }
}
