//! What the body says of itself (libgphoto2, camlibs/ptp2/cameras/canon-eos5dmark2.txt), cut down to what it does here.

use super::{BodyOptions, Release};
use crate::card::Store;
use crate::codes::{format, operation};
use crate::pack::Pack;

pub(super) const FRIENDLY_NAME: u32 = 0xd402;
pub(super) const DEVICE_TYPE: u32 = 0xd407;
const MODEL: &str = "Canon EOS 5D Mark II";
/// A guess of the size of a file, bytes, for the space left on the card.
const FILE_SIZE: u64 = 30_000_000;

/// The DeviceInfo data set (PTP, ISO 15740, section 5.5.1).
pub(super) fn device_info(options: &BodyOptions) -> Vec<u8> {
    Pack::default()
        .u16(100)
        .u32(0xb)
        .u16(200)
        .string("")
        .u16(0)
        .u16s(&operations(options.release))
        .u16s(&[0x4002, 0x4003, 0x4006, 0x400d])
        .u16s(&[0xd402, 0xd407])
        .u16s(&[format::JPEG])
        .u16s(&[format::FOLDER, format::JPEG, format::CR2])
        .string("Canon Inc.")
        .string(MODEL)
        .string("3-1.0.7")
        .string(&options.serial)
        .0
}

/// Every operation that is answered; the list decides how libgphoto2 releases the shutter.
pub(super) fn operations(release: Release) -> Vec<u16> {
    let release: &[u16] = match release {
        Release::Buttons => &[operation::EOS_REMOTE_RELEASE_ON, operation::EOS_REMOTE_RELEASE_OFF],
        Release::Command => &[operation::EOS_REMOTE_RELEASE],
    };
    [
        operation::GET_DEVICE_INFO,
        operation::OPEN_SESSION,
        operation::CLOSE_SESSION,
        operation::GET_STORAGE_IDS,
        operation::GET_STORAGE_INFO,
        operation::GET_NUM_OBJECTS,
        operation::GET_OBJECT_HANDLES,
        operation::GET_OBJECT_INFO,
        operation::GET_OBJECT,
        operation::GET_THUMB,
        operation::DELETE_OBJECT,
        operation::GET_DEVICE_PROP_DESC,
        operation::GET_DEVICE_PROP_VALUE,
        operation::GET_PARTIAL_OBJECT,
        operation::EOS_GET_STORAGE_IDS,
        operation::EOS_GET_STORAGE_INFO,
        operation::EOS_SET_DEVICE_PROP_VALUE_EX,
        operation::EOS_SET_REMOTE_MODE,
        operation::EOS_SET_EVENT_MODE,
        operation::EOS_GET_EVENT,
        operation::EOS_TRANSFER_COMPLETE,
        operation::EOS_PC_HDD_CAPACITY,
        operation::EOS_SET_UI_LOCK,
        operation::EOS_RESET_UI_LOCK,
        operation::EOS_KEEP_DEVICE_ON,
        operation::EOS_REQUEST_DEVICE_PROP_VALUE,
    ]
    .iter()
    .chain(release)
    .copied()
    .collect()
}

/// The StorageInfo data set: removable, DCF, writable.
pub(super) fn storage_info(store: &Store) -> Vec<u8> {
    let bytes = |files: u32| u64::from(files) * FILE_SIZE;
    Pack::default()
        .u16(4)
        .u16(3)
        .u16(0)
        .u64(bytes(store.capacity()))
        .u64(bytes(store.room()))
        .u32(store.room())
        .string("CF")
        .string("")
        .0
}

/// A DevicePropDesc data set, without a list of choices.
pub(super) fn property_description(code: u32) -> Option<Vec<u8>> {
    let value = property_value(code)?;
    let (code, kind) = if code == FRIENDLY_NAME { (0xd402, 0xffff) } else { (0xd407, 6) };
    Some(Pack::default().u16(code).u16(kind).u8(0).bytes(&value).bytes(&value).u8(0).0)
}

/// The value of a property that DeviceInfo lists.
pub(super) fn property_value(code: u32) -> Option<Vec<u8>> {
    match code {
        FRIENDLY_NAME => Some(Pack::default().string(MODEL).0),
        DEVICE_TYPE => Some(Pack::default().u32(1).0),
        _ => None,
    }
}
