//! Which pin does what. docs/firmware.md has the same as a table.

use arm_logic::Pins;
use embedded_hal::digital::{InputPin, OutputPin, PinState};
use embedded_hal::pwm::SetDutyCycle;
use rp2040_hal::Timer;
use rp2040_hal::gpio::bank0::{Gpio2, Gpio3, Gpio4, Gpio5, Gpio25};
use rp2040_hal::gpio::{FunctionSio, Pin, PullDown, PullUp, SioInput, SioOutput};
use rp2040_hal::pwm::{A, Channel, FreeRunning, Pwm3, Slice, Slices};

/// Of 125 MHz: 25000 counts a period, 5 kHz, far above what a filament follows.
const LAMP_TOP: u16 = 24_999;
const COUNTS_A_PERMILLE: u16 = 25;
/// Pulse of a step, processor cycles: 3 us, more than any common driver needs (DRV8825: 1.9 us).
const PULSE_CYCLES: u32 = 375;

type Output<I> = Pin<I, FunctionSio<SioOutput>, PullDown>;

/// The arm's wires.
pub struct PicoPins {
    step: Output<Gpio2>,
    direction: Output<Gpio3>,
    /// Low switches the driver's current on.
    not_enable: Output<Gpio4>,
    /// High while pressed: a normally closed switch to ground opens, so that a broken wire looks pressed.
    switch: Pin<Gpio5, FunctionSio<SioInput>, PullUp>,
    lamp: Channel<Slice<Pwm3, FreeRunning>, A>,
    timer: Timer,
}

/// The light on the board.
pub struct Led(Output<Gpio25>);

/// Takes the pins, with motor and lamp off; until here the pull resistors of the wiring hold both.
pub fn take(gpio: rp2040_hal::gpio::Pins, slices: Slices, timer: Timer) -> (PicoPins, Led) {
    let not_enable = gpio.gpio4.into_push_pull_output_in_state(PinState::High);
    let mut slice = slices.pwm3;
    slice.default_config();
    slice.set_top(LAMP_TOP);
    slice.enable();
    let mut lamp = slice.channel_a;
    set_duty(&mut lamp, 0);
    lamp.output_to(gpio.gpio6);
    let pins = PicoPins {
        step: gpio.gpio2.into_push_pull_output(),
        direction: gpio.gpio3.into_push_pull_output(),
        not_enable,
        switch: gpio.gpio5.into_pull_up_input(),
        lamp,
        timer,
    };
    (pins, Led(gpio.gpio25.into_push_pull_output()))
}

impl Pins for PicoPins {
    fn now_us(&self) -> u32 {
        self.timer.get_counter_low()
    }

    fn pressed(&mut self) -> bool {
        // The pins of this chip cannot fail to be read; were it otherwise, a pressed switch is the safe guess.
        self.switch.is_high().unwrap_or(true)
    }

    fn enable(&mut self) {
        let _ = self.not_enable.set_low();
    }

    fn direction(&mut self, up: bool) {
        let _ = self.direction.set_state(PinState::from(up));
    }

    fn step(&mut self) {
        let _ = self.step.set_high();
        cortex_m::asm::delay(PULSE_CYCLES);
        let _ = self.step.set_low();
    }

    fn lamp(&mut self, permille: u16) {
        set_duty(&mut self.lamp, permille);
    }
}

fn set_duty(lamp: &mut impl SetDutyCycle, permille: u16) {
    // 1000 permille is one count above the top: on without a gap.
    let _ = lamp.set_duty_cycle(permille.saturating_mul(COUNTS_A_PERMILLE));
}

impl Led {
    /// A second lit, a second dark while all is well; five flashes a second while a fault is latched.
    pub fn show(&mut self, fault: bool, now_ms: u32) {
        let half_period_ms = if fault { 100 } else { 1000 };
        let _ = self.0.set_state(PinState::from(now_ms / half_period_ms % 2 == 0));
    }
}
