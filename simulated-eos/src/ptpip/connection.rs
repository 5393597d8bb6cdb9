//! One connection: the operations of a host, or its wait for events that never come (an EOS tells them when asked).

use super::packet::{Incoming, Outgoing, WireError};
use super::server::Shared;
use crate::body::{OpRequest, OpResponse};
use crate::faults::Fault;
use rustix::net::sockopt::set_tcp_quickack;
use std::io::{self, Write};
use std::net::TcpStream;
use std::time::Duration;

/// Time for the first packet.
const FIRST_PACKET: Duration = Duration::from_secs(5);
/// Most data taken with one operation, bytes.
const MOST_DATA: u64 = 1 << 20;
/// Bytes of a file in one packet.
const PIECE: usize = 1 << 20;

/// A connection that has a number of its own.
pub(super) struct Connection<'a> {
    pub(super) shared: &'a Shared,
    pub(super) stream: TcpStream,
    pub(super) number: u32,
}

/// An operation and its number.
struct Transaction {
    number: u32,
    request: OpRequest,
}

impl Connection<'_> {
    /// Serves the connection to its end.
    pub(super) fn serve(mut self) -> Result<(), WireError> {
        self.stream.set_nodelay(true)?;
        self.stream.set_read_timeout(Some(FIRST_PACKET))?;
        let first = self.read()?;
        self.stream.set_read_timeout(None)?;
        self.wait_while_hung()?;
        match first {
            Incoming::InitCommand => {
                self.shared.take_over(self.number);
                self.send(&Outgoing::InitCommandAck { connection: self.number })?;
                self.operations()
            }
            Incoming::InitEvent => {
                self.send(&Outgoing::InitEventAck)?;
                loop {
                    self.expect_ping()?;
                }
            }
            _ => Err(WireError::OutOfOrder("the first packet opens neither a command nor an event connection")),
        }
    }

    /// The next packet. libgphoto2 sends an operation in pieces: an acknowledgement that is delayed by 40 ms would hold each of them
    /// up, which no USB does.
    fn read(&mut self) -> Result<Incoming, WireError> {
        set_tcp_quickack(&self.stream, true).map_err(io::Error::from)?;
        Incoming::read(&mut self.stream)
    }

    fn expect_ping(&mut self) -> Result<(), WireError> {
        match self.read()? {
            Incoming::Ping => self.send(&Outgoing::Pong),
            _ => Err(WireError::OutOfOrder("nothing but a ping may come on an event connection")),
        }
    }

    fn operations(&mut self) -> Result<(), WireError> {
        loop {
            let transaction = self.next_operation()?;
            let request = &transaction.request;
            let releases = self.shared.faults.releases();
            let fault =
                self.shared.faults.take(|fault| fault.link_moment().is_some_and(|moment| moment.covers(request)));
            if matches!(fault, Some(Fault::Hang(_))) {
                self.wait_for_release(releases);
                return Ok(());
            }
            self.wait_while_hung()?;
            if let Some(Fault::Slow(_, by)) = fault {
                self.shared.pause(by);
            }
            let response = self.shared.body().handle(request);
            match fault {
                Some(Fault::Silent(_)) => self.wait_for_release(releases),
                Some(Fault::LinkDrop(_)) => return self.break_off(&transaction, &response),
                Some(Fault::ChangedPort(_)) => {
                    self.shared.change_port();
                    return self.break_off(&transaction, &response);
                }
                _ => {}
            }
            self.answer(&transaction, &response)?;
        }
    }

    fn next_operation(&mut self) -> Result<Transaction, WireError> {
        loop {
            match self.read()? {
                Incoming::Ping => self.send(&Outgoing::Pong)?,
                Incoming::Operation { sends_data, code, transaction, params } => {
                    let data = if sends_data { self.data()? } else { Vec::new() };
                    return Ok(Transaction { number: transaction, request: OpRequest { code, params, data } });
                }
                _ => return Err(WireError::OutOfOrder("data came without an operation")),
            }
        }
    }

    fn data(&mut self) -> Result<Vec<u8>, WireError> {
        let Incoming::StartData { total: 0..=MOST_DATA } = self.read()? else {
            return Err(WireError::OutOfOrder("an operation's data must begin with their size, at most 1 MiB"));
        };
        let mut data = Vec::new();
        loop {
            let (bytes, last) = match self.read()? {
                Incoming::Data(bytes) => (bytes, false),
                Incoming::EndData(bytes) => (bytes, true),
                _ => return Err(WireError::OutOfOrder("something else came amid an operation's data")),
            };
            data.extend(bytes);
            if data.len() as u64 > MOST_DATA {
                return Err(WireError::OutOfOrder("an operation's data are more than 1 MiB"));
            }
            if last {
                return Ok(data);
            }
        }
    }

    fn answer(&mut self, transaction: &Transaction, response: &OpResponse) -> Result<(), WireError> {
        let number = transaction.number;
        if let Some(data) = &response.data {
            self.send(&Outgoing::StartData { transaction: number, total: data.len() as u64 })?;
            let mut rest = data.as_slice();
            while let Some((piece, after)) = rest.split_at_checked(PIECE).filter(|(_, after)| !after.is_empty()) {
                self.send(&Outgoing::Data { transaction: number, bytes: piece })?;
                rest = after;
            }
            self.send(&Outgoing::EndData { transaction: number, bytes: rest })?;
        }
        self.send(&Outgoing::Response { code: response.code, transaction: number, params: &response.params })
    }

    /// Ends the connection without an answer, amid the data if there are any.
    fn break_off(&mut self, transaction: &Transaction, response: &OpResponse) -> Result<(), WireError> {
        if let Some(data) = &response.data {
            self.send(&Outgoing::StartData { transaction: transaction.number, total: data.len() as u64 })?;
            let half = data.get(..data.len() / 2).unwrap_or_default();
            self.send(&Outgoing::Data { transaction: transaction.number, bytes: half })?;
        }
        Ok(())
    }

    /// While the body hangs nothing is answered; switching it off and on ends the connection.
    fn wait_while_hung(&self) -> Result<(), WireError> {
        let releases = self.shared.faults.releases();
        if !self.shared.faults.is_hung() {
            return Ok(());
        }
        self.wait_for_release(releases);
        Err(WireError::OutOfOrder("the body hung and was switched off and on"))
    }

    fn wait_for_release(&self, releases: u64) {
        self.shared.faults.wait_for_release(releases, || !self.shared.is_open(self.number));
    }

    fn send(&mut self, packet: &Outgoing<'_>) -> Result<(), WireError> {
        Ok(self.stream.write_all(&packet.bytes())?)
    }
}
