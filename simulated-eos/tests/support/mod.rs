//! A host that writes its packets by hand, and a sensor whose files say how they were taken.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, dead_code, reason = "each test file uses its part")]

use simulated_eos::{Body, BodyOptions, ExposureSettings, ImageFormat, Picture, PictureKind, Sensor, Server};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// Its files are text: frame, shutter, aperture, ISO, kind; long enough for several reads of a socket.
pub struct TextSensor;

impl Sensor for TextSensor {
    fn expose(&mut self, settings: &ExposureSettings) -> Vec<Picture> {
        let kinds: &[PictureKind] = match settings.format {
            ImageFormat::Jpeg => &[PictureKind::Jpeg],
            ImageFormat::Raw => &[PictureKind::Raw],
            ImageFormat::RawAndJpeg => &[PictureKind::Raw, PictureKind::Jpeg],
        };
        kinds.iter().map(|kind| Picture { bytes: text(settings, *kind).into_bytes(), kind: *kind }).collect()
    }
}

fn text(settings: &ExposureSettings, kind: PictureKind) -> String {
    expected(settings.frame, settings.shutter.label, settings.aperture.label, settings.iso.speed, kind)
}

/// The file of a frame taken so.
pub fn expected(frame: u32, shutter: &str, aperture: &str, iso: u32, kind: PictureKind) -> String {
    let line = format!("frame {frame} shutter {shutter} aperture {aperture} iso {iso} {kind:?}\n");
    line.repeat(5000)
}

/// A body with the text sensor on a free port.
pub fn server(options: BodyOptions) -> Server {
    Server::start(Body::new(Box::new(TextSensor), options).unwrap(), 0).unwrap()
}

/// Answer to an operation: code, parameters, data.
pub type Answer = (u16, Vec<u32>, Vec<u8>);

/// A host on a command connection.
pub struct Host {
    pub stream: TcpStream,
    transaction: u32,
}

impl Host {
    /// Connects, without opening a session.
    pub fn connect(server: &Server) -> Self {
        let mut stream = TcpStream::connect(("127.0.0.1", server.port())).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        stream.write_all(&packet(1, &[&[0xaa; 16], &b"h\0\0\0"[..], &[0, 0, 1, 0]].concat())).unwrap();
        let (kind, _) = read_packet(&mut stream).unwrap();
        assert_eq!(kind, 2, "no acknowledgement");
        Self { stream, transaction: 0 }
    }

    /// Connects, opens a session and listens to events.
    pub fn open(server: &Server) -> Self {
        let mut host = Self::connect(server);
        for (code, param) in [(0x1002, 1), (0x9114, 1), (0x9115, 1)] {
            assert_eq!(host.operation(code, &[param]).0, 0x2001, "{code:x}");
        }
        host
    }

    pub fn send(&mut self, code: u16, params: &[u32]) {
        self.transaction += 1;
        let params: Vec<u8> = params.iter().flat_map(|param| param.to_le_bytes()).collect();
        let request =
            [&1_u32.to_le_bytes()[..], &code.to_le_bytes(), &self.transaction.to_le_bytes(), &params].concat();
        self.stream.write_all(&packet(6, &request)).unwrap();
    }

    /// The answer, or none if the connection ended first.
    pub fn answer(&mut self) -> Option<Answer> {
        let mut data = Vec::new();
        loop {
            let (kind, payload) = read_packet(&mut self.stream)?;
            match kind {
                9 => {}
                10 | 12 => data.extend(&payload[4..]),
                7 => {
                    assert_eq!(u32_at(&payload, 2), self.transaction);
                    let params = (0..(payload.len() - 6) / 4).map(|index| u32_at(&payload, 6 + 4 * index)).collect();
                    return Some((u16::from_le_bytes([payload[0], payload[1]]), params, data));
                }
                _ => panic!("packet type {kind}"),
            }
        }
    }

    pub fn operation(&mut self, code: u16, params: &[u32]) -> Answer {
        self.send(code, params);
        self.answer().expect("the connection ended")
    }

    /// Sets a property to a number; the response code.
    pub fn set(&mut self, property: u32, value: u32) -> u16 {
        self.set_bytes(property, &value.to_le_bytes())
    }

    pub fn set_bytes(&mut self, property: u32, value: &[u8]) -> u16 {
        self.transaction += 1;
        let number = self.transaction.to_le_bytes();
        let size = u32::try_from(value.len() + 8).unwrap();
        let data = [&size.to_le_bytes()[..], &property.to_le_bytes(), value].concat();
        let request = [&2_u32.to_le_bytes()[..], &0x9110_u16.to_le_bytes(), &number].concat();
        self.stream.write_all(&packet(6, &request)).unwrap();
        let total = u64::try_from(data.len()).unwrap().to_le_bytes();
        self.stream.write_all(&packet(9, &[&number[..], &total].concat())).unwrap();
        self.stream.write_all(&packet(12, &[&number[..], &data].concat())).unwrap();
        self.answer().expect("the connection ended").0
    }

    /// Presses half and full, and lets go; the response to the full press.
    pub fn press(&mut self) -> u16 {
        self.operation(0x9128, &[1, 0]);
        let pressed = self.operation(0x9128, &[2, 0]).0;
        self.operation(0x9129, &[2]);
        self.operation(0x9129, &[1]);
        pressed
    }

    /// Records that are due now: code and payload.
    pub fn events(&mut self) -> Vec<(u32, Vec<u8>)> {
        let (code, _, data) = self.operation(0x9116, &[]);
        assert_eq!(code, 0x2001);
        let mut rest = data.as_slice();
        let mut records = Vec::new();
        while rest != [8, 0, 0, 0, 0, 0, 0, 0] {
            let (record, after) = rest.split_at(u32_at(rest, 0) as usize);
            records.push((u32_at(record, 4), record[8..].to_vec()));
            rest = after;
        }
        records
    }

    /// Asks for events until one is of `code`; all that came. Fails after 10 s.
    pub fn events_until(&mut self, code: u32) -> Vec<(u32, Vec<u8>)> {
        let mut all = Vec::new();
        for _ in 0..2000 {
            all.extend(self.events());
            if all.iter().any(|(event, _)| *event == code) {
                return all;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        panic!("no event {code:x} among {all:x?}");
    }

    /// Presses and waits for a file on the card: its handle and name.
    pub fn shoot(&mut self) -> (u32, String) {
        assert_eq!(self.press(), 0x2001);
        let events = self.events_until(0xc181);
        added(&events).remove(0)
    }
}

/// Handle and name of each file announced.
pub fn added(events: &[(u32, Vec<u8>)]) -> Vec<(u32, String)> {
    let files = events.iter().filter(|(code, _)| *code == 0xc181);
    files
        .map(|(_, payload)| {
            let name: Vec<u8> = payload[0x20..].iter().copied().take_while(|byte| *byte != 0).collect();
            (u32_at(payload, 0), String::from_utf8(name).unwrap())
        })
        .collect()
}

/// The last value told of a property.
pub fn told(events: &[(u32, Vec<u8>)], property: u32) -> Option<u32> {
    let values = events.iter().filter(|(code, payload)| *code == 0xc189 && u32_at(payload, 0) == property);
    values.map(|(_, payload)| u32_at(payload, 4)).next_back()
}

pub fn u32_at(bytes: &[u8], offset: usize) -> u32 {
    u32::from_le_bytes(bytes[offset..offset + 4].try_into().unwrap())
}

pub fn packet(kind: u32, payload: &[u8]) -> Vec<u8> {
    let length = u32::try_from(payload.len() + 8).unwrap();
    [&length.to_le_bytes()[..], &kind.to_le_bytes(), payload].concat()
}

/// Type and payload; none at the end of the stream.
pub fn read_packet(stream: &mut TcpStream) -> Option<(u32, Vec<u8>)> {
    let mut header = [0; 8];
    stream.read_exact(&mut header).ok()?;
    let mut payload = vec![0; u32_at(&header, 0) as usize - 8];
    stream.read_exact(&mut payload).ok()?;
    Some((u32_at(&header, 4), payload))
}
