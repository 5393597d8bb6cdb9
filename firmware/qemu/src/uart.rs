//! UART0 of the LM3S6965.
#![allow(unsafe_code, reason = "registers are places in memory")]

const DATA: *mut u32 = 0x4000_c000 as *mut u32;
const FLAGS: *const u32 = 0x4000_c018 as *const u32;
const CONTROL: *mut u32 = 0x4000_c030 as *mut u32;
const RECEIVE_EMPTY: u32 = 0x10;
const TRANSMIT_FULL: u32 = 0x20;
/// The UART itself, its transmitter and its receiver.
const ON: u32 = 0x301;

/// The started UART.
pub struct Uart(());

impl Uart {
    /// Switches it on; QEMU does not pace bytes, so there is no speed to set.
    pub fn start() -> Self {
        // SAFETY: a register of this board, written by this program's only thread.
        unsafe { CONTROL.write_volatile(ON) };
        Self(())
    }

    /// A byte, if one has come.
    pub fn read(&self) -> Option<u8> {
        // SAFETY: as above; reading data takes the byte out, and nobody else reads.
        unsafe { (FLAGS.read_volatile() & RECEIVE_EMPTY == 0).then(|| DATA.read_volatile() as u8) }
    }

    /// Sends a byte, waiting for room.
    pub fn write(&self, byte: u8) {
        // SAFETY: as above.
        unsafe {
            while FLAGS.read_volatile() & TRANSMIT_FULL != 0 {}
            DATA.write_volatile(u32::from(byte));
        }
    }
}
