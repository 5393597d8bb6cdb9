//! Device, decoder and clock as a microcontroller's main loop ties them together.

use crate::world::World;
use arm_logic::{Arm, Mechanics};
use firmware_protocol::{Decoder, Device, DeviceInfo, Hal, Motor, Wire};

/// A microcontroller with an arm on it.
pub struct Board {
    device: Device<Arm<World>>,
    decoder: Decoder,
    /// Time until the arm wants to be called, microseconds.
    wait_us: u32,
    /// Milliseconds and the microseconds beyond them; the device's clock wraps later than the timer's.
    clock: (u32, u32),
}

impl Board {
    /// A board that has just got its power.
    pub fn new(world: World, mechanics: Mechanics, info: DeviceInfo) -> Self {
        let device = Device::new(Arm::new(world, mechanics), info, 0);
        Self { device, decoder: Decoder::default(), wait_us: 0, clock: (0, 0) }
    }

    /// What the power leaves behind when it goes: the arm where it stands, the driver without current, the lamp dark.
    pub fn power_off(self) -> World {
        let mut world = self.device.hal().pins().clone();
        (world.lamp_permille, world.enabled) = (0, false);
        world
    }

    /// The physical truth.
    pub fn world(&self) -> &World {
        self.device.hal().pins()
    }

    /// The physical truth, to do harm to.
    pub fn world_mut(&mut self) -> &mut World {
        self.device.hal_mut().pins_mut()
    }

    /// The motor as the controller counts it.
    pub fn motor(&self) -> Motor {
        self.device.hal().motor()
    }

    /// Commands to the arm that do not come over the wire.
    pub fn arm_mut(&mut self) -> &mut Arm<World> {
        self.device.hal_mut()
    }

    /// Time until the arm wants to be called, microseconds.
    pub fn wait_us(&self) -> u32 {
        self.wait_us
    }

    /// Lets `us` pass, calling the arm whenever it asked to be called and the device every millisecond.
    pub fn advance(&mut self, us: u32) {
        let mut left = us;
        while left > 0 {
            let part = left.min(self.wait_us.max(1));
            self.pass(part);
            left -= part;
        }
    }

    /// Lets `us` pass in one piece, as for a processor that was busy elsewhere; then calls the arm and the device.
    pub fn pass(&mut self, us: u32) {
        let world = self.world_mut();
        world.now_us = world.now_us.wrapping_add(us);
        let (ms, beyond) = (self.clock.0, self.clock.1 + us);
        self.clock = (ms.wrapping_add(beyond / 1000), beyond % 1000);
        self.wait_us = self.device.hal_mut().poll();
        if self.clock.0 != ms {
            self.device.tick(self.clock.0);
        }
    }

    /// Takes a byte from the line; the answer when it completes a frame.
    pub fn hear(&mut self, byte: u8) -> Option<Wire> {
        let frame = self.decoder.push(byte)?;
        let answer = self.device.handle(&frame, self.clock.0);
        // A command may have made a step due sooner than was asked for.
        self.wait_us = 0;
        Some(answer.to_wire())
    }
}
