//! Faults that a test asks the camera for.

use crate::body::OpRequest;
use crate::codes::operation;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// When a fault strikes: at an operation of this kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// Setting a property (0x9110).
    Setting,
    /// The release that opens the shutter: 0x910f, or the full press of 0x9128.
    Release,
    /// Handing over a file (0x1009, 0x101b).
    Transfer,
    /// Asking for events (0x9116).
    Polling,
    /// Any operation.
    Any,
}

impl Moment {
    pub(crate) fn covers(self, request: &OpRequest) -> bool {
        match self {
            Self::Setting => request.code == operation::EOS_SET_DEVICE_PROP_VALUE_EX,
            Self::Release => request.opens_the_shutter(),
            Self::Transfer => matches!(request.code, operation::GET_OBJECT | operation::GET_PARTIAL_OBJECT),
            Self::Polling => request.code == operation::EOS_GET_EVENT,
            Self::Any => true,
        }
    }
}

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The operation is answered "device busy" (0x2019) and does nothing.
    Busy(Moment),
    /// The operation is answered late. Beyond 2 s libgphoto2 gives up on a PTP/IP camera, beyond 20 s on one on USB.
    Slow(Moment, Duration),
    /// The operation is done, but answered only after [`Faults::release`].
    Silent(Moment),
    /// The body stops: no operation of any connection is answered until [`Faults::release`], which switches it off and on, so that
    /// all connections end then.
    Hang(Moment),
    /// The connection closes: in a transfer after half of the file, else after the operation and before its answer.
    LinkDrop(Moment),
    /// The same as a link drop; then the body answers on another port, on USB as another device of the bus.
    ChangedPort(Moment),
    /// A setting is answered "OK" while the old value stays, and nothing is announced.
    IgnoredSetting,
    /// The file handed over is an earlier exposure's. Without one the shot is sound.
    WrongFile,
    /// The body says it is ready, and announces the file only this much later.
    LateFile(Duration),
    /// The file is announced twice.
    Duplicate,
    /// The card is full: no shots available, the release fails.
    CardFull,
    /// Half of the file is handed over as if it were all.
    TruncatedTransfer,
    /// USB alone: the port cannot be opened, with this result of libgphoto2 (gphoto2-port-result.h).
    UsbOpen(i32),
    /// USB alone: writing the operation fails with this result, and it is not done.
    UsbWrite(Moment, i32),
    /// USB alone: the operation is done, but the first read of its answer fails with this result.
    UsbRead(Moment, i32),
    /// USB alone: the operation is done, but the endpoint of its answer is halted: reads fail (-34) until the host clears that.
    UsbHalt(Moment),
    /// USB alone: the operation's data end in the middle although their length promises more; what is too short to be cut stays whole.
    UsbShortData(Moment),
    /// USB alone: the response ends amid its header.
    UsbShortResponse(Moment),
    /// USB alone: the operation is done, but the read of its answer never returns, not even at its time-out.
    UsbNoReturn(Moment),
}

impl Fault {
    /// When a fault of the link strikes; none for the faults of the body itself, and those of USB alone.
    pub(crate) fn link_moment(&self) -> Option<Moment> {
        match *self {
            Self::Slow(moment, _)
            | Self::Silent(moment)
            | Self::Hang(moment)
            | Self::LinkDrop(moment)
            | Self::ChangedPort(moment) => Some(moment),
            _ => None,
        }
    }

    /// When a fault strikes an operation over USB; none for the faults of the body itself.
    pub(crate) fn usb_moment(&self) -> Option<Moment> {
        match *self {
            Self::UsbWrite(moment, _)
            | Self::UsbRead(moment, _)
            | Self::UsbHalt(moment)
            | Self::UsbShortData(moment)
            | Self::UsbShortResponse(moment)
            | Self::UsbNoReturn(moment) => Some(moment),
            _ => self.link_moment(),
        }
    }
}

/// Handle on the faults of a body; clones share them.
#[derive(Clone, Debug, Default)]
pub struct Faults(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    released: Condvar,
}

#[derive(Debug, Default)]
struct State {
    pending: Vec<(Fault, u32)>,
    hung: bool,
    releases: u64,
}

impl Faults {
    /// The next `times` operations or shots that `fault` concerns show it, after those asked for earlier.
    pub fn inject(&self, fault: Fault, times: u32) {
        if times > 0 {
            self.lock().pending.push((fault, times));
        }
    }

    /// Takes back every fault that has not struck yet.
    pub fn clear(&self) {
        self.lock().pending.clear();
    }

    /// Whether every fault asked for has struck.
    pub fn all_struck(&self) -> bool {
        self.lock().pending.is_empty()
    }

    /// Ends every silence, and switches a hanging body off and on.
    pub fn release(&self) {
        let mut state = self.lock();
        state.releases += 1;
        state.hung = false;
        drop(state);
        self.0.released.notify_all();
    }

    /// The first pending fault that `concerns` accepts, counted as struck.
    pub(crate) fn take(&self, concerns: impl Fn(&Fault) -> bool) -> Option<Fault> {
        let mut state = self.lock();
        let index = state.pending.iter().position(|(fault, _)| concerns(fault))?;
        let (fault, times) = state.pending.get_mut(index)?;
        let struck = *fault;
        *times -= 1;
        if *times == 0 {
            state.pending.remove(index);
        }
        state.hung |= matches!(struck, Fault::Hang(_));
        Some(struck)
    }

    /// Whether `fault` is still to strike.
    pub(crate) fn is_pending(&self, fault: Fault) -> bool {
        self.lock().pending.iter().any(|(pending, _)| *pending == fault)
    }

    pub(crate) fn is_hung(&self) -> bool {
        self.lock().hung
    }

    /// How often [`Faults::release`] was called.
    pub(crate) fn releases(&self) -> u64 {
        self.lock().releases
    }

    /// Waits until [`Faults::release`] was called more than `releases` times, or until `given_up`, which is looked at every 20 ms.
    pub(crate) fn wait_for_release(&self, releases: u64, given_up: impl Fn() -> bool) {
        let mut state = self.lock();
        while state.releases <= releases && !given_up() {
            let waited = self.0.released.wait_timeout(state, Duration::from_millis(20));
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// `by` after `now`; what lies beyond the clock's range, a year after.
pub(crate) fn after(now: Instant, by: Duration) -> Instant {
    const YEAR: Duration = Duration::from_secs(365 * 86_400);
    now.checked_add(by).unwrap_or_else(|| now + YEAR)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_strike_in_order_and_as_often_as_asked() {
        let faults = Faults::default();
        faults.inject(Fault::Duplicate, 2);
        faults.inject(Fault::WrongFile, 1);
        faults.inject(Fault::CardFull, 0);
        let any = |_: &Fault| true;
        let struck: Vec<_> = std::iter::from_fn(|| faults.take(any)).collect();
        assert_eq!(struck, [Fault::Duplicate, Fault::Duplicate, Fault::WrongFile]);
        assert!(faults.all_struck());
    }

    #[test]
    fn a_fault_waits_for_what_it_concerns() {
        let faults = Faults::default();
        faults.inject(Fault::Busy(Moment::Release), 1);
        let press = |button| OpRequest { code: operation::EOS_REMOTE_RELEASE_ON, params: vec![button], data: vec![] };
        let strikes = |request: OpRequest| {
            faults.take(|fault| matches!(fault, Fault::Busy(moment) if moment.covers(&request))).is_some()
        };
        assert!(!strikes(press(1)), "a half press opens no shutter");
        assert!(strikes(press(2)));
        assert!(!strikes(press(2)));
    }
}
