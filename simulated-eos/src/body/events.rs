//! What the body has to tell, until the host asks.

use crate::card::Object;
use crate::codes::event;
use crate::pack::{Pack, count};
use std::time::Instant;

/// Records waiting for 0x9116, each with the time from which on it may be told.
#[derive(Debug, Default)]
pub(super) struct Events {
    listening: bool,
    records: Vec<(Instant, Vec<u8>)>,
}

impl Events {
    /// Starts or stops collecting; what was collected is forgotten.
    pub(super) fn listen(&mut self, listening: bool) {
        self.listening = listening;
        self.records.clear();
    }

    pub(super) fn push(&mut self, due: Instant, record: Vec<u8>) {
        if self.listening {
            self.records.push((due, record));
        }
    }

    /// The answer to 0x9116: everything that is due, then the end mark.
    pub(super) fn drain(&mut self, now: Instant) -> Vec<u8> {
        let (due, later) = std::mem::take(&mut self.records).into_iter().partition(|(due, _)| *due <= now);
        self.records = later;
        let due: Vec<(Instant, Vec<u8>)> = due;
        let mut told: Vec<u8> = due.into_iter().flat_map(|(_, record)| record).collect();
        told.extend(record(0, &[]));
        told
    }
}

/// One record: size, code, payload.
pub(super) fn record(code: u32, payload: &[u8]) -> Vec<u8> {
    Pack::default().u32(count(payload.len() + 8)).u32(code).bytes(payload).0
}

/// 1 while the body works, 0 when it is ready.
pub(super) fn camera_status(busy: bool) -> Vec<u8> {
    record(event::CAMERA_STATUS_CHANGED, &u32::from(busy).to_le_bytes())
}

/// A new file or folder on the card.
pub(super) fn object_added(object: &Object) -> Vec<u8> {
    let payload = Pack::default()
        .u32(object.handle)
        .u32(object.storage)
        .u32(object.format.into())
        .bytes(&[0; 8])
        .u32(count(object.bytes.len()))
        .u32(object.parent)
        .u32(object.handle);
    record(event::OBJECT_ADDED_EX, &named(payload, &object.name))
}

/// A file in memory that the host has to fetch.
pub(super) fn request_transfer(object: &Object) -> Vec<u8> {
    let payload =
        Pack::default().u32(object.handle).u32(object.format.into()).u32(0).u32(count(object.bytes.len())).u32(0);
    record(event::REQUEST_OBJECT_TRANSFER, &named(payload, &object.name))
}

/// The name in ASCII, its closing zero, zeros to a multiple of four, and a time that is not simulated.
fn named(payload: Pack, name: &str) -> Vec<u8> {
    let mut bytes = payload.bytes(name.as_bytes()).u8(0).0;
    bytes.resize(bytes.len().next_multiple_of(4) + 4, 0);
    bytes
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::pack::u32_at;
    use std::time::Duration;

    /// Offsets of libgphoto2 2.5.30, camlibs/ptp2/ptp-pack.c (PTP_ece_OA_*, PTP_ece_OI_*).
    #[test]
    fn records_have_their_fields_where_libgphoto2_reads_them() {
        let object =
            Object { handle: 7, storage: 9, parent: 3, name: "IMG_0001.JPG".into(), format: 0x3801, bytes: vec![0; 5] };
        let added = object_added(&object);
        let fields = [0, 4, 8, 0xc, 0x10, 0x1c, 0x20].map(|offset| u32_at(&added, offset).unwrap());
        assert_eq!(fields, [count(added.len()), 0xc181, 7, 9, 0x3801, 5, 3]);
        assert_eq!(&added[0x28..0x35], b"IMG_0001.JPG\0");
        let asked = request_transfer(&object);
        let fields = [0, 4, 8, 0xc, 0x14].map(|offset| u32_at(&asked, offset).unwrap());
        assert_eq!(fields, [count(asked.len()), 0xc186, 7, 0x3801, 5]);
        assert_eq!(&asked[0x1c..0x29], b"IMG_0001.JPG\0");
    }

    #[test]
    fn what_is_not_due_yet_is_told_later() {
        let now = Instant::now();
        let later = now + Duration::from_secs(5);
        let mut events = Events::default();
        events.push(now, camera_status(true));
        assert_eq!(events.drain(now), [8, 0, 0, 0, 0, 0, 0, 0], "nobody listened");
        events.listen(true);
        events.push(later, camera_status(true));
        events.push(now, camera_status(false));
        assert_eq!(events.drain(now), [&camera_status(false)[..], &[8, 0, 0, 0, 0, 0, 0, 0]].concat());
        assert_eq!(events.drain(later), [&camera_status(true)[..], &[8, 0, 0, 0, 0, 0, 0, 0]].concat());
    }
}
