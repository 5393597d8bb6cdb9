//! The body on USB, asked as the driver in `iolib/` asks: containers written by hand.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod support;

use simulated_eos::{Body, BodyOptions, Fault, Moment, PictureKind, UsbBus};
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use support::{TextSensor, expected};
use tempfile::TempDir;

const FIND: i32 = 2;
const OPEN: i32 = 3;
const CLOSE: i32 = 4;
const WRITE: i32 = 5;
const READ: i32 = 6;
const CLEAR_HALT: i32 = 8;

fn bus(bodies: usize) -> (UsbBus, TempDir) {
    let directory = tempfile::tempdir().unwrap();
    let body = || Body::new(Box::new(TextSensor), BodyOptions::default()).unwrap();
    let bodies = std::iter::repeat_with(body).take(bodies).collect();
    (UsbBus::start(&directory.path().join("bus"), bodies).unwrap(), directory)
}

struct Host {
    stream: UnixStream,
    transaction: u32,
}

impl Host {
    fn new(directory: &TempDir) -> Self {
        Self { stream: UnixStream::connect(directory.path().join("bus")).unwrap(), transaction: 0 }
    }

    /// Result and bytes of a call; reads time out after 50 ms.
    fn call(&mut self, call: i32, wanted: i32, bytes: &[u8]) -> (i32, Vec<u8>) {
        let header = [call, 50, wanted, i32::try_from(bytes.len()).unwrap()].map(i32::to_ne_bytes);
        self.stream.write_all(&[header.as_flattened(), bytes].concat()).unwrap();
        let mut answer = [[0; 4]; 2];
        self.stream.read_exact(answer.as_flattened_mut()).unwrap();
        let [result, size] = answer.map(i32::from_ne_bytes);
        let mut bytes = vec![0; usize::try_from(size).unwrap()];
        self.stream.read_exact(&mut bytes).unwrap();
        (result, bytes)
    }

    fn open(&mut self, port: &str) -> i32 {
        self.call(OPEN, 0, port.as_bytes()).0
    }

    fn read(&mut self, wanted: i32) -> (i32, Vec<u8>) {
        self.call(READ, wanted, &[])
    }

    /// Writes a command container; the result of the write.
    fn command(&mut self, code: u16, params: &[u32]) -> i32 {
        self.transaction += 1;
        let length = 12 + 4 * u32::try_from(params.len()).unwrap();
        let params: Vec<u8> = params.iter().flat_map(|param| param.to_le_bytes()).collect();
        let header = [&length.to_le_bytes()[..], &[1, 0], &code.to_le_bytes(), &self.transaction.to_le_bytes()];
        self.call(WRITE, 0, &[&header.concat()[..], &params].concat()).0
    }

    /// Takes the response to the last command: its code.
    fn response(&mut self) -> u16 {
        let (size, bytes) = self.read(512);
        assert_eq!((size, &bytes[4..6], &bytes[8..12]), (12, &[3, 0][..], &self.transaction.to_le_bytes()[..]));
        u16::from_le_bytes([bytes[6], bytes[7]])
    }

    /// Data of a command, and that its response is OK.
    fn data(&mut self, code: u16, params: &[u32]) -> Vec<u8> {
        assert!(self.command(code, params) > 0);
        let (_, whole) = self.read(1 << 20);
        assert_eq!(&whole[..4], u32::try_from(whole.len()).unwrap().to_le_bytes());
        assert_eq!((&whole[4..6], &whole[6..8]), (&[2, 0][..], &code.to_le_bytes()[..]));
        self.read(512);
        whole[12..].to_vec()
    }

    /// Opens a session, takes a picture, and says which handle it has.
    fn picture(&mut self) -> u32 {
        for (code, param) in [(0x1002, 1), (0x9114, 1), (0x9115, 1), (0x9128, 2)] {
            assert_eq!(self.command(code, &[param]), 16);
            assert_eq!(self.response(), 0x2001, "{code:x}");
        }
        loop {
            let handles = self.data(0x1007, &[u32::MAX, 0x3801, 0]);
            if handles[0] == 1 {
                return u32::from_le_bytes(handles[4..8].try_into().unwrap());
            }
            self.data(0x9116, &[]);
        }
    }
}

#[test]
fn transfers_end_with_a_short_packet() {
    let (_bus, directory) = bus(1);
    let mut host = Host::new(&directory);
    assert_eq!(host.open("usb:001,005"), 0);
    let picture = host.picture();
    let file = expected(1, "1/100", "5.6", 100, PictureKind::Jpeg).into_bytes();
    let part = |host: &mut Host, size: u32| host.command(0x101b, &[picture, 0, size]);
    // With its header one packet: read with a packet's room the transfer ends with an empty one, with more room it does not.
    assert_eq!(part(&mut host, 500), 24);
    let (size, bytes) = host.read(512);
    assert_eq!((size, &bytes[12..]), (512, &file[..500]));
    assert_eq!(host.read(512), (0, vec![]));
    assert_eq!(host.read(512).0, 16);
    part(&mut host, 500);
    assert_eq!(host.read(1024).0, 512);
    assert_eq!(host.read(512).0, 16);
    // Of a longer one every read gets its share.
    part(&mut host, 1000);
    let (first, second) = (host.read(512).1, host.read(4096).1);
    assert_eq!([&first[12..], &second].concat(), file[..1000]);
    assert_eq!(host.read(512).0, 16);
    assert_eq!(host.read(512).0, -10, "there is no more");
}

#[test]
fn one_host_at_a_time_has_a_body() {
    let (bus, directory) = bus(2);
    let (mut first, mut second) = (Host::new(&directory), Host::new(&directory));
    assert_eq!(second.call(1, 1000, &[]).1, b"usb:001,005\nusb:001,006");
    assert_eq!(first.open("usb:001,005"), 0);
    assert_eq!(second.open("usb:001,005"), -53);
    assert_eq!(second.open("usb:001,006"), 0);
    assert_eq!(second.open("usb:001,007"), -52);
    assert_eq!(second.command(0x1001, &[]), -2, "it has no body now");
    assert_eq!(first.call(CLOSE, 0, &[]).0, 0);
    assert_eq!(second.open("usb:001,005"), 0);
    drop(second);
    while first.open("usb:001,005") == -53 {}
    bus.unplug(0);
    assert_eq!(first.command(0x1001, &[]), -52);
    assert_eq!(first.call(FIND, 0, b"usb:001,005").0, -52);
    // Plugged in again it is another claim's.
    bus.plug(0, 9);
    assert_eq!((first.command(0x1001, &[]), bus.port(0).as_deref()), (-52, Some("usb:001,009")));
    assert_eq!(first.open("usb:001,009"), 0);
    bus.plug(1, 9);
    assert_eq!((bus.port(0), bus.port(1).as_deref()), (None, Some("usb:001,009")));
    assert_eq!(first.command(0x1001, &[]), -52, "another body has the number now");
}

#[test]
fn faults_strike_where_they_are_asked_for() {
    let (bus, directory) = bus(1);
    let mut host = Host::new(&directory);
    assert_eq!(host.open("usb:001,005"), 0);
    let mut info = |fault: Option<Fault>| {
        fault.into_iter().for_each(|fault| bus.faults(0).unwrap().inject(fault, 1));
        let written = host.command(0x1001, &[]);
        let reads = [0; 3].map(|_| host.read(4096).0);
        host.call(CLEAR_HALT, 0, &[]);
        (written, reads, host.read(4096).0)
    };
    let any = Moment::Any;
    let (12, [size, 12, -10], -10) = info(None) else { panic!("no device info") };
    assert_eq!(info(Some(Fault::UsbWrite(any, -35))), (-35, [-10; 3], -10));
    assert_eq!(info(Some(Fault::UsbRead(any, -7))), (12, [-7, size, 12], -10));
    assert_eq!(info(Some(Fault::UsbHalt(any))), (12, [-34; 3], size));
    assert_eq!(info(Some(Fault::UsbShortResponse(any))), (12, [size, 8, -10], -10));
    assert_eq!(info(Some(Fault::Slow(any, std::time::Duration::from_millis(60)))), (12, [-10, size, 12], -10));
    assert_eq!(info(Some(Fault::ChangedPort(any))), (12, [-52; 3], -52));
    assert_eq!(info(None), (-52, [-52; 3], -52));
    assert_eq!(host.open("usb:001,006"), 0);
    bus.faults(0).unwrap().inject(Fault::LinkDrop(any), 1);
    assert_eq!((host.command(0x1001, &[]), host.read(4096).0, host.read(4096).0), (12, size, -7));
    assert_eq!(host.command(0x1001, &[]), -7, "it must be opened anew");
    assert_eq!((host.open("usb:001,006"), host.command(0x1001, &[])), (0, 12));
}
