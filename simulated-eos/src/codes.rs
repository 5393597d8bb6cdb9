//! Numbers of PTP and of Canon's extension (libgphoto2, camlibs/ptp2/ptp.h).

/// Operation codes that the body answers.
pub mod operation {
    #![allow(missing_docs, reason = "the names are those of ptp.h")]
    pub const GET_DEVICE_INFO: u16 = 0x1001;
    pub const OPEN_SESSION: u16 = 0x1002;
    pub const CLOSE_SESSION: u16 = 0x1003;
    pub const GET_STORAGE_IDS: u16 = 0x1004;
    pub const GET_STORAGE_INFO: u16 = 0x1005;
    pub const GET_NUM_OBJECTS: u16 = 0x1006;
    pub const GET_OBJECT_HANDLES: u16 = 0x1007;
    pub const GET_OBJECT_INFO: u16 = 0x1008;
    pub const GET_OBJECT: u16 = 0x1009;
    pub const GET_THUMB: u16 = 0x100a;
    pub const DELETE_OBJECT: u16 = 0x100b;
    pub const GET_DEVICE_PROP_DESC: u16 = 0x1014;
    pub const GET_DEVICE_PROP_VALUE: u16 = 0x1015;
    pub const GET_PARTIAL_OBJECT: u16 = 0x101b;
    pub const EOS_GET_STORAGE_IDS: u16 = 0x9101;
    pub const EOS_GET_STORAGE_INFO: u16 = 0x9102;
    pub const EOS_REMOTE_RELEASE: u16 = 0x910f;
    pub const EOS_SET_DEVICE_PROP_VALUE_EX: u16 = 0x9110;
    pub const EOS_SET_REMOTE_MODE: u16 = 0x9114;
    pub const EOS_SET_EVENT_MODE: u16 = 0x9115;
    pub const EOS_GET_EVENT: u16 = 0x9116;
    pub const EOS_TRANSFER_COMPLETE: u16 = 0x9117;
    pub const EOS_PC_HDD_CAPACITY: u16 = 0x911a;
    pub const EOS_SET_UI_LOCK: u16 = 0x911b;
    pub const EOS_RESET_UI_LOCK: u16 = 0x911c;
    pub const EOS_KEEP_DEVICE_ON: u16 = 0x911d;
    pub const EOS_REQUEST_DEVICE_PROP_VALUE: u16 = 0x9127;
    pub const EOS_REMOTE_RELEASE_ON: u16 = 0x9128;
    pub const EOS_REMOTE_RELEASE_OFF: u16 = 0x9129;
}

/// Response codes that the body gives.
pub mod response {
    #![allow(missing_docs, reason = "the names are those of ptp.h")]
    pub const OK: u16 = 0x2001;
    pub const GENERAL_ERROR: u16 = 0x2002;
    pub const SESSION_NOT_OPEN: u16 = 0x2003;
    pub const OPERATION_NOT_SUPPORTED: u16 = 0x2005;
    pub const PARAMETER_NOT_SUPPORTED: u16 = 0x2006;
    pub const INVALID_STORAGE_ID: u16 = 0x2008;
    pub const INVALID_OBJECT_HANDLE: u16 = 0x2009;
    pub const DEVICE_PROP_NOT_SUPPORTED: u16 = 0x200a;
    pub const STORE_FULL: u16 = 0x200c;
    pub const ACCESS_DENIED: u16 = 0x200f;
    pub const NO_THUMBNAIL: u16 = 0x2010;
    pub const DEVICE_BUSY: u16 = 0x2019;
    pub const INVALID_DEVICE_PROP_VALUE: u16 = 0x201c;
}

/// Records inside the answer to `EOS_GET_EVENT`.
pub mod event {
    #![allow(missing_docs, reason = "the names are those of ptp.h")]
    pub const OBJECT_ADDED_EX: u32 = 0xc181;
    pub const REQUEST_OBJECT_TRANSFER: u32 = 0xc186;
    pub const PROP_VALUE_CHANGED: u32 = 0xc189;
    pub const AVAIL_LIST_CHANGED: u32 = 0xc18a;
    pub const CAMERA_STATUS_CHANGED: u32 = 0xc18b;
}

/// Properties of the body.
pub mod property {
    #![allow(missing_docs, reason = "the names are those of ptp.h")]
    pub const APERTURE: u32 = 0xd101;
    pub const SHUTTER_SPEED: u32 = 0xd102;
    pub const ISO_SPEED: u32 = 0xd103;
    pub const AUTO_EXPOSURE_MODE: u32 = 0xd105;
    pub const DRIVE_MODE: u32 = 0xd106;
    pub const FOCUS_MODE: u32 = 0xd108;
    pub const BATTERY_POWER: u32 = 0xd111;
    pub const AUTO_POWER_OFF: u32 = 0xd114;
    pub const OWNER: u32 = 0xd115;
    pub const MODEL_ID: u32 = 0xd116;
    pub const AVAILABLE_SHOTS: u32 = 0xd11b;
    pub const CAPTURE_DESTINATION: u32 = 0xd11c;
    pub const CURRENT_STORAGE: u32 = 0xd11e;
    pub const IMAGE_FORMAT: u32 = 0xd120;
    pub const SERIAL_NUMBER: u32 = 0xd1af;
    pub const EVF_OUTPUT: u32 = 0xd1b0;
    pub const ARTIST: u32 = 0xd1d0;
    pub const COPYRIGHT: u32 = 0xd1d1;
}

/// Object formats.
pub mod format {
    pub const FOLDER: u16 = 0x3001;
    pub const JPEG: u16 = 0x3801;
    pub const CR2: u16 = 0xb103;
}
