//! The camera without its cable: PTP operations in, answers out.

mod datasets;
mod events;
mod exposure;
mod settings;
mod shooting;

use crate::card::{ALL, CARD, Object, Store};
use crate::codes::{operation, property, response};
use crate::faults::{Fault, Faults};
use crate::pack::{Pack, count};
use crate::sensor::Sensor;
use events::Events;
use exposure::Exposer;
use settings::Settings;
use std::io;
use std::time::Instant;

/// How the body lets the host release the shutter. Real bodies offer both; libgphoto2 then takes the buttons.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Release {
    /// 0x9128 and 0x9129: buttons pressed half, pressed full, let go.
    Buttons,
    /// 0x910f: one command, whose answer has a result in its parameter.
    Command,
}

/// What kind of body it is.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyOptions {
    /// How the shutter is released.
    pub release: Release,
    /// An exposure lasts its true time divided by this; infinite: as long as the sensor takes.
    pub speed: f64,
    /// Serial number.
    pub serial: String,
    /// Files that fit on the card. They are kept in memory.
    pub card_files: u32,
}

impl Default for BodyOptions {
    fn default() -> Self {
        Self { release: Release::Buttons, speed: f64::INFINITY, serial: "1234567890".into(), card_files: 500 }
    }
}

/// An operation with the data its host sends.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OpRequest {
    /// Operation code.
    pub code: u16,
    /// Up to five parameters.
    pub params: Vec<u32>,
    /// Data, empty if there is none.
    pub data: Vec<u8>,
}

impl OpRequest {
    /// Parameter `index`, 0 if it was not sent.
    fn param(&self, index: usize) -> u32 {
        self.params.get(index).copied().unwrap_or(0)
    }

    /// Whether the operation releases the shutter, by whichever way.
    pub(crate) fn opens_the_shutter(&self) -> bool {
        match self.code {
            operation::EOS_REMOTE_RELEASE => true,
            operation::EOS_REMOTE_RELEASE_ON => self.param(0) & 2 != 0,
            _ => false,
        }
    }
}

/// The answer to an operation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OpResponse {
    /// Response code.
    pub code: u16,
    /// Parameters of the response.
    pub params: Vec<u32>,
    /// Data for the host, if the operation has any.
    pub data: Option<Vec<u8>>,
}

impl OpResponse {
    pub(crate) fn only(code: u16) -> Self {
        Self { code, params: Vec::new(), data: None }
    }

    fn ok() -> Self {
        Self::only(response::OK)
    }

    fn data(data: Vec<u8>) -> Self {
        Self { data: Some(data), ..Self::ok() }
    }

    /// Data, or what it means that there is none.
    fn data_or(data: Option<Vec<u8>>, missing: u16) -> Self {
        data.map_or_else(|| Self::only(missing), Self::data)
    }
}

/// The state of a body; it outlives every connection.
#[derive(Debug)]
pub struct Body {
    options: BodyOptions,
    faults: Faults,
    store: Store,
    settings: Settings,
    events: Events,
    exposer: Exposer,
    /// Exposures so far.
    frames: u32,
    session: bool,
    /// Whether the host has said what room it has: without, no shots to the host are available.
    host_has_room: bool,
}

impl Body {
    /// A body with an empty card that photographs with `sensor`. Fails if there is no thread for it.
    pub fn new(sensor: Box<dyn Sensor>, options: BodyOptions) -> io::Result<Self> {
        Ok(Self {
            faults: Faults::default(),
            store: Store::new(options.card_files),
            settings: Settings::new(&options.serial, options.card_files),
            events: Events::default(),
            exposer: Exposer::new(sensor)?,
            frames: 0,
            session: false,
            host_has_room: false,
            options,
        })
    }

    /// Handle on the faults it shows.
    pub fn faults(&self) -> Faults {
        self.faults.clone()
    }

    /// A new cable: the session and what was to be told on the old one are gone. An exposure under way goes on.
    pub fn connect(&mut self) {
        self.session = false;
        self.events.listen(false);
        self.host_has_room = false;
    }

    /// Does one operation.
    pub fn handle(&mut self, request: &OpRequest) -> OpResponse {
        self.look_at_exposure(Instant::now());
        if !self.session && !matches!(request.code, operation::GET_DEVICE_INFO | operation::OPEN_SESSION) {
            return OpResponse::only(response::SESSION_NOT_OPEN);
        }
        if !datasets::operations(self.options.release).contains(&request.code) {
            return OpResponse::only(response::OPERATION_NOT_SUPPORTED);
        }
        if self.faults.take(|fault| matches!(fault, Fault::Busy(moment) if moment.covers(request))).is_some() {
            return OpResponse::only(response::DEVICE_BUSY);
        }
        self.answer(request)
    }

    /// Presses the button on the body itself. Returns whether the shutter opened.
    pub fn press_shutter(&mut self) -> bool {
        self.look_at_exposure(Instant::now());
        let before = self.frames;
        self.release();
        self.frames > before
    }

    fn answer(&mut self, request: &OpRequest) -> OpResponse {
        let first = request.param(0);
        match request.code {
            operation::GET_DEVICE_INFO => OpResponse::data(datasets::device_info(&self.options)),
            operation::OPEN_SESSION => self.open_session(),
            operation::CLOSE_SESSION => {
                self.connect();
                OpResponse::ok()
            }
            operation::GET_STORAGE_IDS | operation::EOS_GET_STORAGE_IDS => {
                OpResponse::data(Pack::default().u32s(&[CARD]).0)
            }
            operation::GET_STORAGE_INFO | operation::EOS_GET_STORAGE_INFO if first == CARD => {
                OpResponse::data(datasets::storage_info(&self.store))
            }
            operation::GET_STORAGE_INFO | operation::EOS_GET_STORAGE_INFO => {
                OpResponse::only(response::INVALID_STORAGE_ID)
            }
            operation::GET_NUM_OBJECTS | operation::GET_OBJECT_HANDLES => self.list(request),
            operation::GET_DEVICE_PROP_DESC => {
                OpResponse::data_or(datasets::property_description(first), response::DEVICE_PROP_NOT_SUPPORTED)
            }
            operation::GET_DEVICE_PROP_VALUE => {
                OpResponse::data_or(datasets::property_value(first), response::DEVICE_PROP_NOT_SUPPORTED)
            }
            operation::GET_OBJECT_INFO => self.of_object(first, Object::info),
            operation::GET_OBJECT => self.transfer(first, 0, ALL),
            operation::GET_PARTIAL_OBJECT => self.transfer(first, request.param(1), request.param(2)),
            operation::GET_THUMB => OpResponse::only(response::NO_THUMBNAIL),
            operation::DELETE_OBJECT | operation::EOS_TRANSFER_COMPLETE => self.remove(first),
            operation::EOS_SET_EVENT_MODE => self.set_event_mode(first != 0),
            operation::EOS_GET_EVENT => OpResponse::data(self.events.drain(Instant::now())),
            operation::EOS_REQUEST_DEVICE_PROP_VALUE => self.tell_again(first),
            operation::EOS_SET_DEVICE_PROP_VALUE_EX => self.set(&request.data),
            operation::EOS_REMOTE_RELEASE | operation::EOS_REMOTE_RELEASE_ON if request.opens_the_shutter() => {
                self.release()
            }
            operation::EOS_PC_HDD_CAPACITY => {
                self.host_has_room = true;
                self.count_shots();
                OpResponse::ok()
            }
            // Half presses, buttons let go, remote mode, locks and keep-awake need no doing here.
            _ => OpResponse::ok(),
        }
    }

    fn open_session(&mut self) -> OpResponse {
        self.connect();
        self.session = true;
        OpResponse::ok()
    }

    fn list(&self, request: &OpRequest) -> OpResponse {
        if ![CARD, ALL].contains(&request.param(0)) {
            return OpResponse::only(response::INVALID_STORAGE_ID);
        }
        let handles = self.store.handles(request.param(1), request.param(2));
        if request.code == operation::GET_NUM_OBJECTS {
            return OpResponse { params: vec![count(handles.len())], ..OpResponse::ok() };
        }
        OpResponse::data(Pack::default().u32s(&handles).0)
    }

    fn of_object(&self, handle: u32, what: impl Fn(&Object) -> Vec<u8>) -> OpResponse {
        OpResponse::data_or(self.store.get(handle).map(what), response::INVALID_OBJECT_HANDLE)
    }

    /// `size` bytes of a file from `offset` on, as far as there are any.
    fn transfer(&self, handle: u32, offset: u32, size: u32) -> OpResponse {
        let (offset, size) = (offset as usize, size as usize);
        let mut answer = self.of_object(handle, |object| {
            let rest = object.bytes.get(offset..).unwrap_or_default();
            rest.get(..size).unwrap_or(rest).to_vec()
        });
        if let Some(data) = &mut answer.data {
            if self.faults.take(|fault| *fault == Fault::TruncatedTransfer).is_some() {
                data.truncate(data.len() / 2);
            }
            answer.params = vec![count(data.len())];
        }
        answer
    }

    fn remove(&mut self, handle: u32) -> OpResponse {
        if !self.store.remove(handle) {
            return OpResponse::only(response::INVALID_OBJECT_HANDLE);
        }
        self.count_shots();
        OpResponse::ok()
    }

    /// The mode's first event is the whole state.
    fn set_event_mode(&mut self, listening: bool) -> OpResponse {
        self.events.listen(listening);
        let now = Instant::now();
        for record in self.settings.all_records() {
            self.events.push(now, record);
        }
        self.events.push(now, events::camera_status(self.exposer.is_busy()));
        OpResponse::ok()
    }

    fn tell_again(&mut self, code: u32) -> OpResponse {
        match self.settings.value_record(code) {
            Some(record) => {
                self.events.push(Instant::now(), record);
                OpResponse::ok()
            }
            None => OpResponse::only(response::GENERAL_ERROR),
        }
    }

    fn set(&mut self, data: &[u8]) -> OpResponse {
        if self.exposer.is_busy() {
            return OpResponse::only(response::DEVICE_BUSY);
        }
        if self.faults.take(|fault| *fault == Fault::IgnoredSetting).is_some() {
            return OpResponse::ok();
        }
        match self.settings.set(data) {
            Ok(code) => {
                let answer = self.tell_again(code);
                if code == property::CAPTURE_DESTINATION {
                    self.count_shots();
                }
                answer
            }
            Err(code) => OpResponse::only(code),
        }
    }
}
