//! What is known right after a reset: why it came, and a number that the boot before did not have.

use rp2040_hal::Watchdog;
use rp2040_hal::pac::{ROSC, VREG_AND_CHIP_RESET, WATCHDOG};
use rp2040_hal::rosc::RingOscillator;
use rp2040_hal::watchdog::ScratchRegister;

/// Reset causes as this board numbers them; docs/firmware.md lists them.
pub fn reset_cause(watchdog: &WATCHDOG, chip: &VREG_AND_CHIP_RESET) -> u8 {
    let (reason, chip) = (watchdog.reason().read(), chip.chip_reset().read());
    if reason.timer().bit_is_set() {
        3
    } else if reason.force().bit_is_set() {
        4
    } else if chip.had_psm_restart().bit_is_set() {
        5
    } else if chip.had_run().bit_is_set() {
        2
    } else if chip.had_por().bit_is_set() {
        1
    } else {
        0
    }
}

/// 32 bits of the ring oscillator's phase against the program's; never the number of the boot before, which is remembered
/// where only a loss of power or the RUN pin clears it.
pub fn nonce(ring: ROSC, watchdog: &mut Watchdog) -> u32 {
    let ring = RingOscillator::new(ring).initialize();
    let mut nonce = 0u32;
    for _ in 0..32 {
        nonce = nonce << 1 | u32::from(unbiased(&ring));
    }
    if nonce == watchdog.read_scratch(ScratchRegister::Scratch0) {
        nonce = nonce.wrapping_add(1);
    }
    watchdog.write_scratch(ScratchRegister::Scratch0, nonce);
    nonce
}

/// The first of two bits that differ: a bias towards one of them cancels. Sixty-four equal pairs mean that the oscillator
/// stands, and any bit will do.
fn unbiased(ring: &RingOscillator<rp2040_hal::rosc::Enabled>) -> bool {
    for _ in 0..64 {
        let bits = (spaced_bit(ring), spaced_bit(ring));
        if bits.0 != bits.1 {
            return bits.0;
        }
    }
    false
}

/// Bits read at once hang together: the oscillator gets time to drift in between.
fn spaced_bit(ring: &RingOscillator<rp2040_hal::rosc::Enabled>) -> bool {
    cortex_m::asm::delay(200);
    ring.get_random_bit()
}
