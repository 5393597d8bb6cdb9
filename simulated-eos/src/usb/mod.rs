//! PTP over USB (ISO 15740, annex D): containers on bulk endpoints, and the bus that a driver of libgphoto2 finds bodies on.
//!
//! The driver is `iolib/simulated_usb.c`. What it is asked comes here over a socket, call by call, and only here is anything decided.

mod bus;
mod claim;
mod container;
mod port;
mod wire;

pub use bus::UsbBus;
