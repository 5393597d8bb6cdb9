//! A device as one host holds it: what is written becomes operations, what they answer waits to be read.

use super::bus::Shared;
use super::container::{self, Incoming};
use super::wire;
use crate::body::OpRequest;
use crate::codes::operation;
use crate::faults::{Fault, Faults};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Size of a packet: a transfer that is a multiple of it ends with an empty one.
const PACKET: usize = 512;

/// Why a call gets no answer any more: its host is gone.
pub(super) struct HostGone;

pub(super) struct Claim<'a> {
    shared: &'a Shared,
    /// Which device, and its number when it was claimed.
    device: usize,
    number: u8,
    faults: Faults,
    written: Vec<u8>,
    /// An operation whose data are still to come.
    begun: Option<Operation>,
    /// Transfers for the host; what is left of them.
    answers: VecDeque<Vec<u8>>,
    trouble: Trouble,
}

struct Operation {
    transaction: u32,
    request: OpRequest,
    fault: Option<Fault>,
}

/// What reading meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    Nothing,
    /// Answers wait until then.
    Late(Instant),
    /// Answers wait for one more release than these; the claim is void then if the body was switched off and on.
    Silent {
        releases: u64,
        void_then: bool,
    },
    /// The next read ends with this code.
    Fails(i32),
    /// Reads fail until the host clears the halt.
    Halted,
    /// Reads never return.
    Never,
    /// After what can still be read the claim is void.
    Broken,
}

impl<'a> Claim<'a> {
    /// Claims the device at `port`; the result of the call if that fails.
    pub(super) fn new(shared: &'a Shared, port: &str) -> Result<Self, i32> {
        let (device, number, faults) = shared.claim(port)?;
        let (written, answers) = (Vec::new(), VecDeque::new());
        Ok(Self { shared, device, number, faults, written, begun: None, answers, trouble: Trouble::Nothing })
    }

    fn is_there(&self) -> bool {
        self.shared.number(self.device) == Some(self.number)
    }

    /// Takes bytes of the bulk endpoint out; the call's result.
    pub(super) fn write(&mut self, bytes: &[u8]) -> i32 {
        if !self.is_there() {
            return wire::IO_USB_FIND;
        }
        if self.trouble == Trouble::Broken {
            return wire::IO;
        }
        self.written.extend(bytes);
        while let Some(incoming) = Incoming::take(&mut self.written) {
            match incoming {
                Incoming::Command { code, transaction, params } => {
                    let request = OpRequest { code, params, data: Vec::new() };
                    let strikes = |fault: &Fault| fault.usb_moment().is_some_and(|moment| moment.covers(&request));
                    let fault = self.faults.take(strikes);
                    if let Some(Fault::UsbWrite(_, result)) = fault {
                        return result;
                    }
                    self.begun = Some(Operation { transaction, request, fault });
                    if code != operation::EOS_SET_DEVICE_PROP_VALUE_EX {
                        self.operate(Vec::new());
                    }
                }
                Incoming::Data(bytes) => self.operate(bytes),
                Incoming::Nonsense => return wire::IO,
            }
        }
        i32::try_from(bytes.len()).unwrap_or(i32::MAX)
    }

    /// Does the operation that was begun.
    fn operate(&mut self, data: Vec<u8>) {
        let Some(Operation { transaction, mut request, fault }) = self.begun.take() else { return };
        request.data = data;
        self.answers.clear();
        let releases = self.faults.releases();
        if self.faults.is_hung() {
            self.trouble = Trouble::Silent { releases, void_then: true };
            return;
        }
        let Some(response) = self.shared.body(self.device).map(|mut body| body.handle(&request)) else { return };
        if let Some(bytes) = &response.data {
            self.answers.push_back(container::data(request.code, transaction, bytes));
        }
        self.answers.push_back(container::response(response.code, transaction, &response.params));
        self.trouble = match fault {
            Some(Fault::Slow(_, by)) => Trouble::Late(crate::faults::after(Instant::now(), by)),
            Some(Fault::Silent(_)) => Trouble::Silent { releases, void_then: false },
            Some(Fault::UsbRead(_, result)) => Trouble::Fails(result),
            Some(Fault::UsbHalt(_)) => Trouble::Halted,
            Some(Fault::UsbNoReturn(_)) => Trouble::Never,
            Some(Fault::LinkDrop(_)) => {
                self.answers.truncate(self.answers.len() - 1);
                self.halve_data();
                Trouble::Broken
            }
            Some(Fault::ChangedPort(_)) => {
                self.shared.replug(self.device);
                Trouble::Nothing
            }
            Some(Fault::UsbShortData(_)) => {
                self.halve_data();
                Trouble::Nothing
            }
            Some(Fault::UsbShortResponse(_)) => {
                self.answers.back_mut().into_iter().for_each(|response| response.truncate(8));
                Trouble::Nothing
            }
            _ => Trouble::Nothing,
        };
    }

    /// Half of a data container, which says that it is whole.
    fn halve_data(&mut self) {
        if let Some(data) = self.answers.front_mut().filter(|data| data.len() > PACKET) {
            data.truncate(data.len() / 2);
        }
    }

    /// Reads of the bulk endpoint in: at most `wanted` bytes, or the result of a call that fails.
    pub(super) fn read(
        &mut self,
        wanted: usize,
        timeout: Duration,
        pause: impl Fn() -> Result<(), HostGone>,
    ) -> Result<Result<Vec<u8>, i32>, HostGone> {
        let end = Instant::now() + timeout;
        loop {
            match self.trouble {
                Trouble::Never => {}
                _ if !self.is_there() => return Ok(Err(wire::IO_USB_FIND)),
                Trouble::Fails(result) => {
                    self.trouble = Trouble::Nothing;
                    return Ok(Err(result));
                }
                Trouble::Halted => return Ok(Err(wire::IO_READ)),
                Trouble::Broken if self.answers.is_empty() => return Ok(Err(wire::IO)),
                Trouble::Late(until) if Instant::now() >= until => self.trouble = Trouble::Nothing,
                Trouble::Silent { releases, void_then } if self.faults.releases() > releases => {
                    self.trouble = if void_then { Trouble::Broken } else { Trouble::Nothing };
                }
                Trouble::Nothing | Trouble::Broken if !self.answers.is_empty() => return Ok(Ok(self.next(wanted))),
                _ if Instant::now() >= end => return Ok(Err(wire::TIMEOUT)),
                _ => {}
            }
            pause()?;
        }
    }

    /// The next bytes of the first transfer.
    fn next(&mut self, wanted: usize) -> Vec<u8> {
        let Some(mut first) = self.answers.pop_front() else { return Vec::new() };
        let rest = first.split_off(wanted.min(first.len()));
        let ends_with_empty_packet = !first.is_empty() && first.len() == wanted && wanted.is_multiple_of(PACKET);
        if !rest.is_empty() || ends_with_empty_packet {
            self.answers.push_front(rest);
        }
        first
    }

    /// The host makes a halted endpoint go on.
    pub(super) fn clear_halt(&mut self) {
        if self.trouble == Trouble::Halted {
            self.trouble = Trouble::Nothing;
        }
    }
}

impl Drop for Claim<'_> {
    fn drop(&mut self) {
        self.shared.let_go(self.device, self.number);
    }
}
