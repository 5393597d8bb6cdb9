//! What a GRBL 1.1h controller does with the lines it gets, and what its motor, switch and lamp then truly do. Replies and their order
//! are those recorded from the real firmware.

use crate::sim::arm::motion::Profile;
use crate::sim::pose::Pose;
use std::collections::{BTreeMap, VecDeque};

/// Lines the planner takes before the next one waits (`$I`: 15 blocks).
const PLANNER: usize = 15;
/// Receive ring, bytes; what does not fit is lost without a word.
const RING: usize = 128;
/// Reports between two that state overrides and outputs.
const OUTPUT_REPORTS: u32 = 10;
/// What it says while it is locked.
const LOCKED: &str = "[MSG:'$H'|'$X' to unlock]";

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Move,
    Jog,
    Home,
    /// Feed hold: slows down, then holds.
    Hold,
}

#[derive(Clone, Copy, Debug)]
struct Motion {
    profile: Profile,
    kind: Kind,
    along_s: f64,
}

/// Why the next line is not read yet.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Waiting {
    Nothing,
    /// `G4`: until the planner is empty.
    Fence,
    /// `$H`.
    Homing,
}

/// The controller and its mechanics. Machine degrees; the switch is at 0, its upper end.
#[derive(Clone, Debug)]
pub struct Machine {
    settings: BTreeMap<u16, f64>,
    ring: VecDeque<u8>,
    planned: VecDeque<(f64, f64, Kind)>,
    motion: Option<Motion>,
    waiting: Waiting,
    counted_deg: f64,
    /// True less counted angle.
    slip_deg: f64,
    held: bool,
    locked: bool,
    /// Silent until it is reset.
    stopped: bool,
    stalled: bool,
    spindle: f64,
    flood: bool,
    overrides: [u16; 3],
    reports: u32,
    out: Vec<u8>,
}

impl Machine {
    /// A controller just powered, whose arm rests somewhere.
    pub fn new(settings: BTreeMap<u16, f64>) -> Self {
        let rest_deg = -0.37 * settings.get(&130).copied().unwrap_or(0.0);
        let mut machine = Self {
            settings,
            ring: VecDeque::new(),
            planned: VecDeque::new(),
            motion: None,
            waiting: Waiting::Nothing,
            counted_deg: 0.0,
            slip_deg: rest_deg,
            held: false,
            locked: true,
            stopped: false,
            stalled: false,
            spindle: 0.0,
            flood: false,
            overrides: [100; 3],
            reports: 0,
            out: Vec::new(),
        };
        machine.banner();
        machine
    }

    fn setting(&self, number: u16) -> f64 {
        self.settings.get(&number).copied().unwrap_or(0.0)
    }

    /// The physical truth, with the arm's angle at machine position 0.
    pub fn pose(&self, zero_deg: f64) -> Pose {
        let spindle = (1000.0 * self.spindle / self.setting(30).max(1.0)).round() as u16;
        let lamp_permille = if self.flood { 1000 } else { spindle };
        Pose { angle_deg: zero_deg + self.true_deg(), lamp_permille }
    }

    /// What was said since the last call.
    pub fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.out)
    }

    /// Blocks or frees the motor.
    pub fn stall(&mut self, stalled: bool) {
        self.stalled = stalled;
    }

    /// Turns the arm without the controller counting.
    pub fn slip(&mut self, degrees: f64) {
        self.slip_deg += degrees;
    }

    /// Loss and return of power.
    pub fn power_cycle(&mut self) {
        let (true_deg, stalled, settings) = (self.true_deg(), self.stalled, std::mem::take(&mut self.settings));
        *self = Self { slip_deg: true_deg, stalled, ..Self::new(settings) };
    }

    /// A limit switch hit, or noise on its cable.
    pub fn hit_limit(&mut self) {
        self.say("ALARM:1");
        self.say("[MSG:Reset to continue]");
        self.quiet_down();
        self.stopped = true;
    }

    fn true_deg(&self) -> f64 {
        self.counted_deg + self.slip_deg
    }

    fn at_switch(&self) -> bool {
        self.true_deg() >= 0.0
    }

    fn say(&mut self, line: &str) {
        self.out.extend_from_slice(line.as_bytes());
        self.out.extend_from_slice(b"\r\n");
    }

    fn banner(&mut self) {
        self.say("");
        self.say("Grbl 1.1h ['$' for help]");
        if self.locked {
            self.say(LOCKED);
        }
    }

    fn quiet_down(&mut self) {
        self.motion = None;
        self.planned.clear();
        self.ring.clear();
        self.waiting = Waiting::Nothing;
        (self.spindle, self.flood, self.held) = (0.0, false, false);
    }

    /// Takes bytes from the wire.
    pub fn hear(&mut self, bytes: &[u8]) {
        for byte in bytes {
            match byte {
                0x18 => self.reset(),
                _ if self.stopped => {}
                b'?' => self.report(),
                b'!' => self.hold(),
                b'~' => self.held = false,
                0x85 => self.end_jog(),
                0x91 => self.overrides[0] = (self.overrides[0] + 10).min(200),
                0xa0 => self.flood = !self.flood,
                0x80..=0xff => {}
                _ if self.ring.len() < RING => self.ring.push_back(*byte),
                _ => {}
            }
        }
        self.work();
    }

    fn reset(&mut self) {
        let homing = self.waiting == Waiting::Homing;
        if self.stopped {
            self.say("ok");
        } else if homing || self.motion.is_some() {
            self.locked = true;
            self.say(if homing { "ALARM:6" } else { "ALARM:3" });
        }
        self.locked |= self.stopped;
        self.quiet_down();
        self.stopped = false;
        self.overrides = [100; 3];
        self.banner();
    }

    fn hold(&mut self) {
        if let Some(motion) = self.motion.filter(|motion| motion.kind != Kind::Home) {
            let (at, velocity) = motion.profile.at(motion.along_s);
            let profile = Profile::stopping(at, velocity, self.setting(120));
            self.motion = Some(Motion { profile, kind: Kind::Hold, along_s: 0.0 });
            self.planned.clear();
        }
    }

    fn end_jog(&mut self) {
        if self.motion.is_some_and(|motion| motion.kind == Kind::Jog) {
            self.motion = None;
        }
    }

    fn report(&mut self) {
        self.reports += 1;
        let state = match self.motion.map(|motion| motion.kind) {
            Some(Kind::Hold) => "Hold:1",
            Some(Kind::Home) => "Home",
            Some(Kind::Jog) => "Jog",
            Some(Kind::Move) => "Run",
            None if self.held => "Hold:0",
            None if self.locked => "Alarm",
            None => "Idle",
        };
        let step = self.setting(100);
        let mut line =
            format!("<{state}|MPos:{:.3},0.000,0.000|FS:0,{}", (self.counted_deg * step).round() / step, self.spindle);
        if self.at_switch() {
            line += "|Pn:X";
        }
        match self.reports % OUTPUT_REPORTS {
            0 => line += "|WCO:0.000,0.000,0.000",
            1 => {
                let [feed, rapid, spindle] = self.overrides;
                line += &format!("|Ov:{feed},{rapid},{spindle}");
                let on: String =
                    [(self.spindle > 0.0, 'S'), (self.flood, 'F')].iter().filter(|o| o.0).map(|o| o.1).collect();
                if !on.is_empty() {
                    line += &format!("|A:{on}");
                }
            }
            _ => {}
        }
        self.say(&format!("{line}>"));
    }

    /// Lets time pass for the motor.
    pub fn advance(&mut self, dt_s: f64) {
        if let Some(mut motion) = self.motion.take() {
            if !self.stalled {
                motion.along_s += dt_s;
                self.counted_deg = motion.profile.at(motion.along_s).0;
            } else if motion.kind == Kind::Home {
                // The search ends when its counted travel is over, however little the arm turned.
                let before = self.counted_deg;
                motion.along_s += dt_s;
                self.counted_deg = motion.profile.at(motion.along_s).0;
                self.slip_deg -= self.counted_deg - before;
            }
            let over = motion.along_s >= motion.profile.duration_s();
            match motion.kind {
                Kind::Home if self.at_switch() => {
                    self.counted_deg = -self.setting(27);
                    (self.slip_deg, self.locked, self.waiting) = (0.0, false, Waiting::Nothing);
                    self.say("ok");
                }
                Kind::Home if over => {
                    self.waiting = Waiting::Nothing;
                    self.locked = true;
                    self.say("ALARM:9");
                    self.say("ok");
                    self.quiet_down();
                    self.banner();
                }
                Kind::Hold if over => self.held = true,
                _ if over => {}
                _ => self.motion = Some(motion),
            }
        }
        if self.motion.is_none() && !self.held {
            self.start_next();
        }
        self.work();
    }

    fn start_next(&mut self) {
        if let Some((to, speed, kind)) = self.planned.pop_front() {
            let profile = Profile::between(self.counted_deg, to, speed, self.setting(120));
            self.motion = Some(Motion { profile, kind, along_s: 0.0 });
        }
    }

    /// Reads lines until one has to wait.
    fn work(&mut self) {
        loop {
            match self.waiting {
                Waiting::Homing => return,
                Waiting::Fence if self.motion.is_some() || !self.planned.is_empty() || self.held => return,
                Waiting::Fence => {
                    self.waiting = Waiting::Nothing;
                    self.say("ok");
                }
                Waiting::Nothing => {}
            }
            if self.planned.len() >= PLANNER || self.stopped {
                return;
            }
            let Some(end) = self.ring.iter().position(|byte| *byte == b'\n') else { return };
            let bytes: Vec<u8> = self.ring.drain(..=end).collect();
            let line: String = String::from_utf8_lossy(&bytes).chars().filter(|c| !c.is_whitespace()).collect();
            self.carry_out(&line.to_uppercase());
        }
    }

    fn carry_out(&mut self, line: &str) {
        let answer = match line {
            "" => Ok(()),
            "$I" => {
                self.say("[VER:1.1h.20190830:]");
                self.say("[OPT:V,15,128]");
                Ok(())
            }
            "$$" => {
                let lines: Vec<String> = self.settings.iter().map(|(n, v)| format!("${n}={v}")).collect();
                lines.iter().for_each(|line| self.say(line));
                Ok(())
            }
            "$X" => {
                self.locked = false;
                Ok(())
            }
            "$H" if self.motion.is_some() => Err(8),
            "$H" => {
                let travel = 1.5 * self.setting(130);
                let speed = self.setting(25) / 60.0;
                let profile = Profile::between(self.counted_deg, self.counted_deg + travel, speed, self.setting(120));
                self.motion = Some(Motion { profile, kind: Kind::Home, along_s: 0.0 });
                self.waiting = Waiting::Homing;
                return;
            }
            _ if line.starts_with('$') && !line.starts_with("$J=") => Err(3),
            _ if self.locked => Err(9),
            _ => self.block(line),
        };
        match answer {
            Ok(()) if self.waiting == Waiting::Fence => {}
            Ok(()) => self.say("ok"),
            Err(code) => self.say(&format!("error:{code}")),
        }
    }

    /// A block of G-code, or a jog.
    fn block(&mut self, line: &str) -> Result<(), u8> {
        let words = words(line.strip_prefix("$J=").unwrap_or(line))?;
        let jog = line.starts_with("$J=");
        let value = |letter: char| words.iter().find(|(l, _)| *l == letter).map(|(_, v)| *v);
        let has = |letter: char, number: f64| words.contains(&(letter, number));
        if has('G', 4.0) {
            self.waiting = Waiting::Fence;
            return Ok(());
        }
        if let Some(to) = value('X') {
            if !jog && !has('G', 0.0) {
                return Err(22);
            }
            let speed = if jog { value('F').ok_or(22)? / 60.0 } else { self.setting(110) / 60.0 };
            // Step resolution: where the motor can really stand.
            let step = self.setting(100);
            self.planned.push_back(((to * step).round() / step, speed, if jog { Kind::Jog } else { Kind::Move }));
            return Ok(());
        }
        for (letter, number) in &words {
            match (letter, *number as i64) {
                ('M', 3) => self.spindle = value('S').ok_or(2)?.clamp(0.0, self.setting(30)),
                ('M', 5) => self.spindle = 0.0,
                ('M', 8) => self.flood = true,
                ('M', 9) => self.flood = false,
                ('S', _) | ('G', 21 | 90 | 53) => {}
                _ => return Err(20),
            }
        }
        Ok(())
    }
}

/// Letter and number, over and over; GRBL's errors 1 and 2 otherwise.
fn words(line: &str) -> Result<Vec<(char, f64)>, u8> {
    let mut rest = line;
    let mut words = Vec::new();
    while let Some(letter) = rest.chars().next() {
        if !letter.is_ascii_uppercase() {
            return Err(1);
        }
        rest = &rest[1..];
        let end = rest.find(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-')).unwrap_or(rest.len());
        words.push((letter, rest[..end].parse().map_err(|_| 2)?));
        rest = &rest[end..];
    }
    Ok(words)
}
