//! A simulated Canon EOS 5D Mark II.
//!
//! [`Body`] is the camera without its cable: it takes PTP operations and answers them, keeps settings, card and events.
//! [`Server`] puts it on a loopback port, where the stock libgphoto2 drives it as `ptpip:127.0.0.1:PORT:PORT`; [`UsbBus`] on a USB
//! bus that the stock libgphoto2 finds with the driver in `iolib/`.
//! What the picture shows is the caller's [`Sensor`]; how long an exposure lasts is the body's: a dial of 15 is 16 s.
//! [`Faults`] makes it misbehave as real bodies do.
//!
//! Sources: libgphoto2 2.5.30 (camlibs/ptp2: ptp-pack.c for event records, config.c for codes and labels, library.c for
//! the order of operations, cameras/canon-eos5dmark2.txt for what the body says of itself), and for the packets
//! CIPA DC-005 (PTP-IP). No real body was at hand: what one answers to a wrong value or on a full card is a guess, and said so there.

mod body;
mod card;
mod codes;
mod dials;
mod faults;
mod pack;
mod ptpip;
mod sensor;
mod usb;

pub use body::{Body, BodyOptions, OpRequest, OpResponse, Release};
pub use codes::{event, operation, property, response};
pub use dials::{Aperture, ImageFormat, Iso, Shutter};
pub use faults::{Fault, Faults, Moment};
pub use ptpip::Server;
pub use sensor::{ExposureSettings, Picture, PictureKind, Sensor};
pub use usb::UsbBus;
