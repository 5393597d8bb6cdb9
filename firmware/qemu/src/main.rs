//! The light arm in QEMU: the firmware's logic and protocol on an LM3S6965 (Cortex-M3) whose arm is a few numbers.
//!
//! It shows that the code runs without std on a real instruction set, and answers over a real UART model. Motor, switch and
//! lamp are not there; `Model` stands in for them.
#![no_std]
#![no_main]

mod model;
mod uart;

use arm_logic::{Arm, rig};
use cortex_m::peripheral::{SYST, syst::SystClkSource};
use cortex_m_rt::entry;
use firmware_protocol::{Decoder, Device, caps};
use model::Model;
use uart::Uart;

#[entry]
fn main() -> ! {
    let Some(cortex_m::Peripherals { mut SYST, .. }) = cortex_m::Peripherals::take() else { hang() };
    start_clock(&mut SYST);
    let uart = Uart::start();
    // Without a source of chance there is no boot nonce, so reboots cannot be told: the ability is not claimed.
    let info = rig::info(caps::DIMMING, 0, 1);
    let mut device = Device::new(Arm::new(Model::new(SYST), rig::MECHANICS), info, 0);
    let mut decoder = Decoder::default();
    let (mut now_ms, mut ms_began_us) = (0u32, 0u32);
    loop {
        device.hal_mut().poll();
        let now_us = device.hal_mut().pins_mut().tick();
        while now_us.wrapping_sub(ms_began_us) >= 1000 {
            (now_ms, ms_began_us) = (now_ms.wrapping_add(1), ms_began_us.wrapping_add(1000));
            device.tick(now_ms);
        }
        let Some(frame) = uart.read().and_then(|byte| decoder.push(byte)) else { continue };
        let answer = device.handle(&frame, now_ms);
        for byte in answer.to_wire().as_slice() {
            uart.write(*byte);
        }
    }
}

fn start_clock(clock: &mut SYST) {
    clock.set_clock_source(SystClkSource::Core);
    clock.set_reload(model::RELOAD);
    clock.clear_current();
    clock.enable_counter();
}

#[panic_handler]
fn panicked(_: &core::panic::PanicInfo) -> ! {
    hang()
}

fn hang() -> ! {
    loop {
        cortex_m::asm::wfi();
    }
}
