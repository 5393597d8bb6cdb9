//! From the release to the files.

use super::events::{camera_status, object_added, request_transfer};
use super::exposure::Exposing;
use super::settings::TO_CARD;
use super::{Body, OpResponse, Release};
use crate::codes::{format, property, response};
use crate::dials::{Aperture, Iso, Shutter};
use crate::faults::{Fault, after};
use crate::sensor::{ExposureSettings, Picture};
use std::time::{Duration, Instant};

/// Result of 0x910f in its response's parameter: the card is full.
const CARD_FULL: u32 = 7;
/// Shots available when they go to the host: what libgphoto2 says of the host's disk is ample.
const SHOTS_TO_HOST: u32 = 1000;

impl Body {
    /// Opens the shutter.
    pub(super) fn release(&mut self) -> OpResponse {
        if self.exposer.is_busy() {
            return OpResponse::only(response::DEVICE_BUSY);
        }
        self.count_shots();
        if self.settings.number(property::AVAILABLE_SHOTS) == Some(0) {
            self.faults.take(|fault| *fault == Fault::CardFull);
            return self.release_answer(true);
        }
        let Some(settings) = self.exposure_settings() else {
            return OpResponse::only(response::GENERAL_ERROR);
        };
        let open = self.open_time(settings.shutter.true_s);
        let to_card = self.to_card();
        if !self.exposer.open_shutter(settings, to_card, open) {
            return OpResponse::only(response::GENERAL_ERROR);
        }
        self.frames += 1;
        self.events.push(Instant::now(), camera_status(true));
        self.release_answer(false)
    }

    /// The answer to a release. With buttons a full card is a PTP error, which is a guess; the command answers "OK" with a result.
    fn release_answer(&self, full: bool) -> OpResponse {
        match self.options.release {
            Release::Buttons if full => OpResponse::only(response::STORE_FULL),
            Release::Buttons => OpResponse::ok(),
            Release::Command => OpResponse { params: vec![if full { CARD_FULL } else { 0 }], ..OpResponse::ok() },
        }
    }

    fn exposure_settings(&self) -> Option<ExposureSettings> {
        Some(ExposureSettings {
            shutter: Shutter::from_code(self.settings.number(property::SHUTTER_SPEED)?)?,
            aperture: Aperture::from_code(self.settings.number(property::APERTURE)?)?,
            iso: Iso::from_code(self.settings.number(property::ISO_SPEED)?)?,
            format: self.settings.format(),
            frame: self.frames + 1,
        })
    }

    fn open_time(&self, true_s: f64) -> Duration {
        Duration::try_from_secs_f64(true_s / self.options.speed).unwrap_or(Duration::MAX)
    }

    fn to_card(&self) -> bool {
        self.settings.number(property::CAPTURE_DESTINATION) == Some(TO_CARD)
    }

    /// Announces the available shots if they are not what was announced last.
    pub(super) fn count_shots(&mut self) {
        let shots = if self.faults.is_pending(Fault::CardFull) {
            0
        } else if self.to_card() {
            self.store.room()
        } else if self.host_has_room {
            SHOTS_TO_HOST
        } else {
            0
        };
        if self.settings.update(property::AVAILABLE_SHOTS, shots) {
            self.tell_again(property::AVAILABLE_SHOTS);
        }
    }

    /// Stores and announces the files of an exposure that has ended.
    pub(super) fn look_at_exposure(&mut self, now: Instant) {
        let Some((exposing, pictures)) = self.exposer.finished(now) else {
            self.count_shots();
            return;
        };
        let pictures = self.exchanged(pictures);
        let late = self.faults.take(|fault| matches!(fault, Fault::LateFile(_)));
        let due = match late {
            Some(Fault::LateFile(by)) => after(now, by),
            _ => now,
        };
        for picture in pictures {
            self.store_and_announce(&exposing, picture, due);
        }
        self.count_shots();
        self.events.push(now, camera_status(false));
    }

    fn store_and_announce(&mut self, exposing: &Exposing, picture: Picture, due: Instant) {
        let frame = exposing.settings.frame;
        let records: Vec<Vec<u8>> = if exposing.to_card {
            let new = self.store.put_on_card(frame, picture);
            let twice = self.faults.take(|fault| *fault == Fault::Duplicate).is_some();
            new.iter()
                .flat_map(|object| {
                    let times = if twice && object.format != format::FOLDER { 2 } else { 1 };
                    std::iter::repeat_n(object_added(object), times)
                })
                .collect()
        } else {
            vec![request_transfer(&self.store.put_in_memory(frame, picture))]
        };
        for record in records {
            self.events.push(due, record);
        }
    }

    /// The pictures, or under the fault [`Fault::WrongFile`] the newest file of an earlier exposure in place of each.
    fn exchanged(&self, pictures: Vec<Picture>) -> Vec<Picture> {
        let Some(earlier) = self.store.newest() else {
            return pictures;
        };
        if self.faults.take(|fault| *fault == Fault::WrongFile).is_none() {
            return pictures;
        }
        pictures.into_iter().map(|picture| Picture { bytes: earlier.clone(), ..picture }).collect()
    }
}
