//! A board that speaks GRBL.

use super::Board;
use std::sync::{Arc, Mutex};

/// What the GRBL board did so far.
#[derive(Default)]
pub struct Seen {
    pub moves: u32,
    pub lamp_on: bool,
    pub told_off: bool,
    pub reports: u32,
}

/// Lines obeyed at once and answered as GRBL 1.1h does; then `lie` spoils the report.
pub struct Grbl<L> {
    settings: Vec<(u16, String)>,
    position: f64,
    locked: bool,
    at_switch: bool,
    /// Its outputs stay on.
    pub stuck: bool,
    /// The `ok` of its next homing is lost.
    pub lost_ok: bool,
    seen: Seen,
    line: Vec<u8>,
    heard: Arc<Mutex<Vec<String>>>,
    lie: L,
}

impl<L: FnMut(&Seen, String) -> String> Grbl<L> {
    pub fn new(heard: Arc<Mutex<Vec<String>>>, settings: &[(u16, &str)], lie: L) -> Self {
        let usual =
            "1=255 10=1 13=0 20=0 21=0 22=1 23=0 25=900 27=3 30=1000 32=0 100=44.444 110=60000 120=10000 130=200";
        let usual = usual.split(' ').map(|line| line.split_once('=').unwrap());
        let value = |number: u16, usual: &str| {
            settings
                .iter()
                .find(|(other, _)| *other == number)
                .map_or(usual.to_owned(), |(_, value)| (*value).to_owned())
        };
        let settings = usual.map(|(n, v)| (n.parse().unwrap(), v)).map(|(n, v)| (n, value(n, v))).collect();
        let (line, seen) = (Vec::new(), Seen::default());
        Self {
            settings,
            position: 0.0,
            locked: true,
            at_switch: false,
            stuck: false,
            lost_ok: false,
            seen,
            line,
            heard,
            lie,
        }
    }

    fn off(&mut self) {
        self.seen.told_off |= self.seen.lamp_on;
        self.seen.lamp_on &= self.stuck;
    }

    fn report(&mut self) -> String {
        self.seen.reports += 1;
        let state = if self.locked { "Alarm" } else { "Idle" };
        let (speed, on) = if self.seen.lamp_on { (800, "|A:SF") } else { (0, "") };
        let pins = if self.at_switch { "|Pn:X" } else { "" };
        let report = format!("<{state}|MPos:{:.3},0.000,0.000|FS:0,{speed}{pins}|Ov:100,100,100{on}>", self.position);
        (self.lie)(&self.seen, report) + "\r\n"
    }

    fn obey(&mut self, line: &str) -> String {
        self.heard.lock().unwrap().push(line.to_owned());
        let mut said = String::new();
        match line {
            "$I" => said += "[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\n",
            "$$" => said.extend(self.settings.iter().map(|(number, value)| format!("${number}={value}\r\n"))),
            "$H" => {
                let pull_off = self.settings.iter().find(|(number, _)| *number == 27).unwrap().1.parse::<f64>();
                (self.position, self.locked, self.at_switch) = (-pull_off.unwrap(), false, false);
            }
            "M5" | "M9" => self.off(),
            "M8" => self.seen.lamp_on = true,
            _ if line.starts_with("M3") => self.seen.lamp_on = true,
            _ if line.starts_with("$J") => (self.position, self.at_switch) = (0.0, true),
            _ if line.contains("G0X") => {
                self.seen.moves += 1;
                self.position = target(line);
            }
            _ => {}
        }
        if line == "$H" && std::mem::take(&mut self.lost_ok) {
            return said;
        }
        said + "ok\r\n"
    }
}

/// The machine position that a line asks for.
pub fn target(line: &str) -> f64 {
    let x = line.split_once('X').unwrap().1;
    x.split(|c: char| c.is_ascii_alphabetic()).next().unwrap().parse().unwrap()
}

impl<L: FnMut(&Seen, String) -> String + Send> Board for Grbl<L> {
    fn hear(&mut self, byte: u8) -> Vec<u8> {
        let said = match byte {
            b'?' => self.report(),
            0x18 => {
                self.line.clear();
                self.off();
                self.locked = true;
                "\r\nGrbl 1.1h ['$' for help]\r\n".into()
            }
            b'\n' => {
                let line = String::from_utf8(std::mem::take(&mut self.line)).unwrap();
                self.obey(line.trim())
            }
            b'!' | 0x85 => String::new(),
            _ => {
                self.line.push(byte);
                String::new()
            }
        };
        said.into_bytes()
    }
}
