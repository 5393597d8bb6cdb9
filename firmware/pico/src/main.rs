//! The light arm on a Raspberry Pi Pico: protocol over USB serial, steps from a timer interrupt, lamp by PWM, watchdog.
//!
//! Wiring, building and flashing: docs/firmware.md.
#![no_std]
#![no_main]

mod boot;
mod pins;
mod wire;

use arm_logic::{Arm, rig};
use core::cell::RefCell;
use critical_section::Mutex;
use firmware_protocol::{Device, Faults, caps};
use pins::PicoPins;
use rp2040_hal::clocks::init_clocks_and_plls;
use rp2040_hal::fugit::ExtU32;
use rp2040_hal::pac::{self, interrupt};
use rp2040_hal::timer::{Alarm, Alarm0};
use rp2040_hal::{Sio, Timer, Watchdog, pwm};

/// The crystal of every Pico, hertz.
const CRYSTAL_HZ: u32 = 12_000_000;
/// Without a round of the main loop and a call of the interrupt within this time, the board starts anew: lamp off, motor off.
const WATCHDOG_MS: u32 = 500;

#[unsafe(link_section = ".boot2")]
#[used]
#[allow(unsafe_code, reason = "the boot ROM looks for it at this place")]
static BOOT2: [u8; 256] = rp2040_boot2::BOOT_LOADER_GENERIC_03H;

/// Shared between the main loop, which answers the host, and the timer's interrupt, which makes the steps.
struct Machine {
    device: Device<Arm<PicoPins>>,
    alarm: Alarm0,
    /// Calls of the interrupt; wraps.
    calls: u32,
}

static MACHINE: Mutex<RefCell<Option<Machine>>> = Mutex::new(RefCell::new(None));

fn with_machine<R>(act: impl FnOnce(&mut Machine) -> R) -> Option<R> {
    critical_section::with(|section| MACHINE.borrow_ref_mut(section).as_mut().map(act))
}

#[rp2040_hal::entry]
fn main() -> ! {
    let Some(mut board) = pac::Peripherals::take() else { hang() };
    let reset_cause = boot::reset_cause(&board.WATCHDOG, &board.VREG_AND_CHIP_RESET);
    let mut watchdog = Watchdog::new(board.WATCHDOG);
    let boot_nonce = boot::nonce(board.ROSC, &mut watchdog);
    let clocks = init_clocks_and_plls(
        CRYSTAL_HZ,
        board.XOSC,
        board.CLOCKS,
        board.PLL_SYS,
        board.PLL_USB,
        &mut board.RESETS,
        &mut watchdog,
    );
    let Ok(clocks) = clocks else { hang() };
    let mut timer = Timer::new(board.TIMER, &mut board.RESETS, &clocks);
    let sio = Sio::new(board.SIO);
    let gpio = rp2040_hal::gpio::Pins::new(board.IO_BANK0, board.PADS_BANK0, sio.gpio_bank0, &mut board.RESETS);
    let (pins, mut led) = pins::take(gpio, pwm::Slices::new(board.PWM, &mut board.RESETS), timer);
    let Some(alarm) = timer.alarm_0() else { hang() };
    let info = rig::info(caps::DIMMING | caps::REBOOT_DETECT, reset_cause, boot_nonce);
    start(Machine { device: Device::new(Arm::new(pins, rig::MECHANICS), info, 0), alarm, calls: 0 });

    let bus = wire::bus(board.USBCTRL_REGS, board.USBCTRL_DPRAM, clocks.usb_clock, &mut board.RESETS);
    let Some(mut wire) = wire::Wire::new(&bus) else { hang() };
    watchdog.start(WATCHDOG_MS.millis());
    let (mut last_calls, mut now_ms) = (0, 0);
    loop {
        // Truncated, so it wraps as the device expects of its clock.
        let ms = (timer.get_counter().ticks() / 1000) as u32;
        wire.serve(|frame| with_machine(|machine| machine.device.handle(frame, ms)));
        if ms == now_ms {
            continue;
        }
        now_ms = ms;
        let beat = with_machine(|machine| {
            machine.device.tick(ms);
            (machine.calls, machine.device.status().faults)
        });
        let Some((calls, faults)) = beat else { continue };
        led.show(faults != Faults::default(), ms);
        if calls != last_calls {
            last_calls = calls;
            watchdog.feed();
        }
    }
}

fn start(machine: Machine) {
    critical_section::with(|section| MACHINE.replace(section, Some(machine)));
    with_machine(|machine| {
        machine.alarm.enable_interrupt();
        poll(machine);
    });
    // SAFETY: what the interrupt shares is behind a critical section, and is there by now.
    #[allow(unsafe_code, reason = "switching an interrupt on may break critical sections by masking; this breaks none")]
    unsafe {
        pac::NVIC::unmask(pac::Interrupt::TIMER_IRQ_0);
    }
}

/// Makes the step that is due and has the timer call again when the arm wants it.
fn poll(machine: &mut Machine) {
    let wait_us = machine.device.hal_mut().poll();
    // The HAL has no error for a time as short as this; were there one, the watchdog would end the silence.
    let _ = machine.alarm.schedule(wait_us.micros());
    machine.calls = machine.calls.wrapping_add(1);
}

#[interrupt]
fn TIMER_IRQ_0() {
    with_machine(|machine| {
        machine.alarm.clear_interrupt();
        poll(machine);
    });
}

#[panic_handler]
fn panicked(_: &core::panic::PanicInfo) -> ! {
    hang()
}

/// Waits for the watchdog. Before it runs, nothing has been switched on.
fn hang() -> ! {
    cortex_m::interrupt::disable();
    loop {
        cortex_m::asm::nop();
    }
}
