//! Compiles only if nothing below `firmware-protocol` brings std in: std has a panic handler of its own, and rustc refuses a
//! program with two. `make no-std` builds it for the host, so no microcontroller target need be installed.
#![no_std]

pub use firmware_protocol::{Decoder, Device};

#[panic_handler]
fn panicked(_: &core::panic::PanicInfo) -> ! {
    loop {}
}
