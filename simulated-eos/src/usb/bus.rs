//! The bus: its devices, and a thread for each port that a host has open.

use super::port::{LOOK, Port};
use super::wire;
use crate::body::Body;
use crate::faults::{Fault, Faults};
use std::io;
use std::net::Shutdown;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::JoinHandle;

/// Number of the first device on bus 1.
const FIRST: u8 = 5;

/// A USB bus with bodies on it, until it is dropped. A host that loads the driver `iolib/simulated_usb.c` with `IOLIBS` and has
/// the socket's path in `SIMULATED_USB` finds them as `usb:001,005` and so on. One host at a time can claim a body.
#[derive(Debug)]
pub struct UsbBus {
    shared: Arc<Shared>,
    accepting: Option<JoinHandle<()>>,
}

#[derive(Debug)]
pub(super) struct Shared {
    devices: Vec<Device>,
    plugs: Mutex<Vec<Plug>>,
    stopping: AtomicBool,
}

#[derive(Debug)]
struct Device {
    body: Mutex<Body>,
    faults: Faults,
}

/// How a device is plugged in.
#[derive(Clone, Copy, Debug)]
struct Plug {
    /// Its number, none if it is not plugged in.
    number: Option<u8>,
    claimed: bool,
}

impl UsbBus {
    /// Plugs the bodies in, from device 5 of bus 1 on, and listens on a socket made at `socket`.
    pub fn start(socket: &Path, bodies: Vec<Body>) -> io::Result<Self> {
        let listener = UnixListener::bind(socket)?;
        listener.set_nonblocking(true)?;
        let devices: Vec<Device> =
            bodies.into_iter().map(|body| Device { faults: body.faults(), body: Mutex::new(body) }).collect();
        let plugs = (FIRST..).zip(&devices).map(|(number, _)| Plug { number: Some(number), claimed: false }).collect();
        let shared = Arc::new(Shared { devices, plugs: Mutex::new(plugs), stopping: AtomicBool::new(false) });
        let accept = Arc::clone(&shared);
        let accepting = std::thread::Builder::new().name("usb".into()).spawn(move || accept.run(&listener))?;
        Ok(Self { shared, accepting: Some(accepting) })
    }

    /// Where body `index` is plugged in, as libgphoto2 spells it; none if it is not.
    pub fn port(&self, index: usize) -> Option<String> {
        self.shared.number(index).map(path)
    }

    /// Handle on the faults of body `index`; none if there is no such body.
    pub fn faults(&self, index: usize) -> Option<Faults> {
        self.shared.devices.get(index).map(|device| device.faults.clone())
    }

    /// Pulls the plug of body `index`: whoever has claimed it finds it gone.
    pub fn unplug(&self, index: usize) {
        self.shared.renumber(index, |_| None);
    }

    /// Plugs body `index` in as device `number`, pulling its plug before if need be. Another with that number is unplugged.
    pub fn plug(&self, index: usize, number: u8) {
        for other in 0..self.shared.devices.len() {
            if self.shared.number(other) == Some(number) {
                self.unplug(other);
            }
        }
        self.shared.renumber(index, |_| Some(number));
    }
}

impl Drop for UsbBus {
    fn drop(&mut self) {
        self.shared.stopping.store(true, Ordering::SeqCst);
        if let Some(accepting) = self.accepting.take() {
            // A panic there has been reported already.
            let _ = accepting.join();
        }
    }
}

impl Shared {
    fn run(self: Arc<Self>, listener: &UnixListener) {
        let mut hosts: Vec<(Weak<UnixStream>, JoinHandle<()>)> = Vec::new();
        while !self.stopping.load(Ordering::SeqCst) {
            hosts.retain(|(_, thread)| !thread.is_finished());
            match listener.accept() {
                Ok((stream, _)) => hosts.extend(Self::host(&self, stream)),
                Err(_) => std::thread::sleep(LOOK),
            }
        }
        for (stream, thread) in hosts {
            if let Some(stream) = stream.upgrade() {
                // It may be closed already.
                let _ = stream.shutdown(Shutdown::Both);
            }
            let _ = thread.join();
        }
    }

    /// A thread for the port that a host has opened, unless the system has none.
    fn host(self: &Arc<Self>, stream: UnixStream) -> Option<(Weak<UnixStream>, JoinHandle<()>)> {
        stream.set_nonblocking(false).ok()?;
        let (shared, stream) = (Arc::clone(self), Arc::new(stream));
        let open = Arc::downgrade(&stream);
        let serve = move || {
            // Whatever a host asks ends its connection at worst.
            let _ = Port { shared: &shared, stream: &stream, claim: None }.serve();
        };
        Some((open, std::thread::Builder::new().name("usb port".into()).spawn(serve).ok()?))
    }

    /// Where there are devices, as libgphoto2 spells it.
    pub(super) fn ports(&self) -> Vec<String> {
        self.plugs().iter().filter_map(|plug| plug.number.map(path)).collect()
    }

    pub(super) fn device_at(&self, port: &str) -> Option<usize> {
        self.plugs().iter().position(|plug| plug.number.is_some_and(|number| path(number) == port))
    }

    pub(super) fn number(&self, device: usize) -> Option<u8> {
        self.plugs().get(device)?.number
    }

    /// Gives a host the device at `port`; the result of the call if it cannot have it.
    pub(super) fn claim(&self, port: &str) -> Result<(usize, u8, Faults), i32> {
        let index = self.device_at(port).ok_or(wire::IO_USB_FIND)?;
        let faults = self.devices.get(index).ok_or(wire::IO_USB_FIND)?.faults.clone();
        if let Some(Fault::UsbOpen(result)) = faults.take(|fault| matches!(fault, Fault::UsbOpen(_))) {
            return Err(result);
        }
        let number = match self.plugs().get_mut(index) {
            Some(Plug { number: Some(number), claimed: claimed @ false }) => {
                *claimed = true;
                *number
            }
            Some(Plug { number: Some(_), .. }) => return Err(wire::IO_USB_CLAIM),
            _ => return Err(wire::IO_USB_FIND),
        };
        if let Some(mut body) = self.body(index) {
            body.connect();
        }
        Ok((index, number, faults))
    }

    /// Ends a claim, unless the device has another number by now.
    pub(super) fn let_go(&self, device: usize, number: u8) {
        if let Some(plug) = self.plugs().get_mut(device).filter(|plug| plug.number == Some(number)) {
            plug.claimed = false;
        }
    }

    /// The device vanishes from the bus and comes back under the next number.
    pub(super) fn replug(&self, device: usize) {
        self.renumber(device, |highest| Some(highest.wrapping_add(1)));
    }

    fn renumber(&self, device: usize, number: impl Fn(u8) -> Option<u8>) {
        let mut plugs = self.plugs();
        let highest = plugs.iter().filter_map(|plug| plug.number).max().unwrap_or(FIRST);
        if let Some(plug) = plugs.get_mut(device) {
            *plug = Plug { number: number(highest), claimed: false };
        }
    }

    pub(super) fn body(&self, device: usize) -> Option<MutexGuard<'_, Body>> {
        Some(self.devices.get(device)?.body.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn plugs(&self) -> MutexGuard<'_, Vec<Plug>> {
        self.plugs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The port of a device on bus 1, as libgphoto2 spells it.
fn path(number: u8) -> String {
    format!("usb:001,{number:03}")
}
