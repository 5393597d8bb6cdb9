//! The serial line over USB.

use firmware_protocol::{Decoder, Frame};
use rp2040_hal::clocks::UsbClock;
use rp2040_hal::pac::{RESETS, USBCTRL_DPRAM, USBCTRL_REGS};
use rp2040_hal::usb::UsbBus;
use usb_device::bus::UsbBusAllocator;
use usb_device::device::{StringDescriptors, UsbDevice, UsbDeviceBuilder, UsbVidPid};
use usbd_serial::{SerialPort, USB_CLASS_CDC};

/// The number pair that V-USB shares out for serial ports told apart by their names.
const NUMBERS: UsbVidPid = UsbVidPid(0x16c0, 0x27dd);

/// The USB controller.
pub fn bus(
    registers: USBCTRL_REGS,
    memory: USBCTRL_DPRAM,
    clock: UsbClock,
    resets: &mut RESETS,
) -> UsbBusAllocator<UsbBus> {
    UsbBusAllocator::new(UsbBus::new(registers, memory, clock, true, resets))
}

/// Frames in, frames out.
pub struct Wire<'a> {
    device: UsbDevice<'a, UsbBus>,
    serial: SerialPort<'a, UsbBus>,
    decoder: Decoder,
}

impl<'a> Wire<'a> {
    /// Linux names it /dev/serial/by-id/usb-rigd_light_arm-if00. None if the library refuses the descriptors, which are fixed.
    pub fn new(bus: &'a UsbBusAllocator<UsbBus>) -> Option<Self> {
        let serial = SerialPort::new(bus);
        let names = StringDescriptors::default().manufacturer("rigd").product("light arm");
        let device = UsbDeviceBuilder::new(bus, NUMBERS).strings(&[names]).ok()?.device_class(USB_CLASS_CDC).build();
        Some(Self { device, serial, decoder: Decoder::default() })
    }

    /// Takes what has come and sends the answers; to be called at least every 10 ms.
    pub fn serve(&mut self, mut answer: impl FnMut(&Frame) -> Option<Frame>) {
        if !self.device.poll(&mut [&mut self.serial]) {
            return;
        }
        let mut buffer = [0; 64];
        let count = self.serial.read(&mut buffer).unwrap_or(0);
        for byte in buffer.iter().take(count) {
            let Some(frame) = self.decoder.push(*byte) else { continue };
            if let Some(answer) = answer(&frame) {
                // A host that does not fetch its answers loses them, as on a real line; it has one at a time to fetch.
                let _ = self.serial.write(answer.to_wire().as_slice());
            }
        }
    }
}
