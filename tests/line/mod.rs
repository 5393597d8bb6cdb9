//! A serial line between a driver and a simulated device that does what bad lines do: noise, frames dropped and doubled, hang-ups, another
//! name after the return. The driver knows it by a link that stays, as under /dev/serial/by-id.
#![allow(dead_code, clippy::unwrap_used)]

pub mod arms;

use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use serialport::{SerialPort, TTYPort};
use std::collections::VecDeque;
use std::fs;
use std::io::{Read, Write};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Name of the line's own thread, for those who measure the others.
pub const THREAD: &str = "line";
/// Bytes per second at 115200 baud.
const BABBLE: f64 = 11_520.0;

/// Time that a simulated board is given to start anew, out of its boot loader's.
const START: Duration = Duration::from_millis(150);

/// What happens to frames, each with a probability, and to the gaps between them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Weather {
    pub drop: f64,
    pub double: f64,
    /// Random bytes before a frame of the device: up to so many.
    pub noise: usize,
    /// Random bytes all the time, as fast as 115200 baud lets through.
    pub babble: bool,
}

#[derive(Default)]
struct Shared {
    weather: Weather,
    noise_sent: usize,
    hang_up: bool,
    /// Come back, deaf for this long after the first byte as behind a boot loader.
    come_back: Option<Duration>,
    /// Called for the board to start anew.
    boot: Option<Box<dyn FnMut() + Send>>,
}

pub struct Line {
    folder: tempfile::TempDir,
    shared: Arc<Mutex<Shared>>,
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Line {
    /// A line to the device at `device`, whose frames end with `end`.
    pub fn new(device: &Path, end: u8, seed: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let shared = Arc::new(Mutex::new(Shared::default()));
        let over = Arc::new(AtomicBool::new(false));
        let device = serialport::new(device.to_str().unwrap(), 115_200).timeout(Duration::from_millis(1));
        let pump = Pump {
            host: Some(appear(&folder.path().join("arm"))),
            device: device.open_native().unwrap(),
            link: folder.path().join("arm"),
            end,
            rng: Xoshiro256PlusPlus::seed_from_u64(seed),
            from_host: Vec::new(),
            from_device: Vec::new(),
            to_host: VecDeque::new(),
            deaf: None,
            babbled: Instant::now(),
            shared: shared.clone(),
        };
        let stop = over.clone();
        let thread = thread::Builder::new().name(THREAD.into()).spawn(move || pump.run(&stop));
        let thread = Some(thread.unwrap());
        Self { folder, shared, end: over, thread }
    }

    /// The name that stays.
    pub fn port(&self) -> PathBuf {
        self.folder.path().join("arm")
    }

    /// The name behind it, another one after every return.
    pub fn node(&self) -> PathBuf {
        fs::read_link(self.port()).unwrap()
    }

    pub fn weather(&self, weather: Weather) {
        self.shared().weather = weather;
    }

    /// Random bytes sent to the driver so far.
    pub fn noise_sent(&self) -> usize {
        self.shared().noise_sent
    }

    /// Pulls the cable; the name is gone as well.
    pub fn hang_up(&self) {
        self.shared().hang_up = true;
        self.until(|| fs::symlink_metadata(self.port()).is_err());
    }

    /// Plugs it in again; returns when the name is there. Opening it starts the board anew when a boot loader's time is given: `boot` is
    /// called in time for it to have started by the end.
    pub fn come_back(&self, boot_loader: Duration, boot: impl FnMut() + Send + 'static) -> Instant {
        let mut shared = self.shared();
        shared.boot = Some(Box::new(boot));
        shared.come_back = Some(boot_loader);
        drop(shared);
        self.until(|| self.port().exists());
        Instant::now()
    }

    fn until(&self, condition: impl Fn() -> bool) {
        let started = Instant::now();
        while !condition() {
            assert!(started.elapsed() < Duration::from_secs(20), "the line does not follow");
            thread::sleep(Duration::from_millis(1));
        }
    }

    fn shared(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().unwrap()
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.end.store(true, Ordering::SeqCst);
        let _ = self.thread.take().unwrap().join();
    }
}

/// A port that nobody answers on yet, with a link to it.
pub fn appear(link: &Path) -> TTYPort {
    let (mut master, slave) = TTYPort::pair().unwrap();
    master.set_timeout(Duration::from_millis(1)).unwrap();
    symlink(slave.name().unwrap(), link).unwrap();
    master
}

struct BootLoader {
    time: Duration,
    began: Option<Instant>,
    /// The board's own program has started: what it says counts again.
    left: bool,
}

struct Pump {
    host: Option<TTYPort>,
    device: TTYPort,
    link: PathBuf,
    end: u8,
    rng: Xoshiro256PlusPlus,
    from_host: Vec<u8>,
    from_device: Vec<u8>,
    to_host: VecDeque<u8>,
    /// While the board is in its boot loader.
    deaf: Option<BootLoader>,
    babbled: Instant,
    shared: Arc<Mutex<Shared>>,
}

impl Pump {
    fn run(mut self, stop: &AtomicBool) {
        let mut old = Vec::new();
        while !stop.load(Ordering::SeqCst) {
            self.plug(&mut old);
            let weather = self.shared.lock().unwrap().weather;
            self.host_to_device(weather);
            self.device_to_host(weather);
            self.babble(weather);
            self.deliver();
        }
    }

    fn plug(&mut self, old: &mut Vec<TTYPort>) {
        let mut shared = self.shared.lock().unwrap();
        if std::mem::take(&mut shared.hang_up) && self.host.take().is_some() {
            fs::remove_file(&self.link).unwrap();
            self.to_host.clear();
        }
        if let Some(boot_loader) = shared.come_back.take() {
            // Held open, so that the system cannot give the old number again.
            old.push(TTYPort::pair().unwrap().0);
            self.deaf = (!boot_loader.is_zero()).then_some(BootLoader { time: boot_loader, began: None, left: false });
            self.host = Some(appear(&self.link));
        }
    }

    fn host_to_device(&mut self, weather: Weather) {
        let mut buffer = [0; 4096];
        let Some(host) = &mut self.host else { return };
        let count = match host.read(&mut buffer) {
            Ok(count) => count,
            Err(error) if error.kind() == std::io::ErrorKind::TimedOut => 0,
            Err(_) => {
                // Nobody has it open: that returns at once.
                thread::sleep(Duration::from_millis(2));
                0
            }
        };
        if self.is_deaf(count > 0) {
            return;
        }
        self.from_host.extend_from_slice(&buffer[..count]);
        for frame in frames(&mut self.from_host, self.end) {
            for _ in 0..self.copies(weather) {
                let _ = self.device.write_all(&frame);
            }
        }
    }

    fn device_to_host(&mut self, weather: Weather) {
        let mut buffer = [0; 4096];
        let count = self.device.read(&mut buffer).unwrap_or(0);
        if self.host.is_none() || self.deaf.as_ref().is_some_and(|boot| !boot.left) {
            return;
        }
        self.from_device.extend_from_slice(&buffer[..count]);
        if self.deaf.is_some() {
            return;
        }
        for frame in frames(&mut self.from_device, self.end) {
            let noise = if weather.noise > 0 { self.rng.random_range(0..=weather.noise) } else { 0 };
            for _ in 0..noise {
                self.to_host.push_back(self.rng.random());
            }
            // Else the noise spoils the frame behind it.
            if noise > 0 && self.rng.random_bool(0.97) {
                self.to_host.push_back(self.end);
            }
            self.shared.lock().unwrap().noise_sent += noise;
            for _ in 0..self.copies(weather) {
                self.to_host.extend(&frame);
            }
        }
    }

    fn babble(&mut self, weather: Weather) {
        let due = (self.babbled.elapsed().as_secs_f64() * BABBLE) as usize;
        if due == 0 {
            return;
        }
        self.babbled = Instant::now();
        if weather.babble {
            let bytes: Vec<u8> = (0..due).map(|_| self.rng.random()).collect();
            self.to_host.extend(bytes);
            self.shared.lock().unwrap().noise_sent += due;
        }
    }

    /// Sends what the driver takes now.
    fn deliver(&mut self) {
        let Some(host) = &mut self.host else { return };
        while !self.to_host.is_empty() {
            let (bytes, _) = self.to_host.as_slices();
            match host.write(&bytes[..bytes.len().min(1024)]) {
                Ok(sent) => drop(self.to_host.drain(..sent)),
                Err(_) => return,
            }
        }
    }

    fn copies(&mut self, weather: Weather) -> usize {
        if self.rng.random_bool(weather.drop) { 0 } else { 1 + usize::from(self.rng.random_bool(weather.double)) }
    }

    /// True while the board is in its boot loader, which the first byte after the opening starts.
    fn is_deaf(&mut self, heard: bool) -> bool {
        let Some(boot) = &mut self.deaf else { return false };
        if boot.began.is_none() && heard {
            boot.began = Some(Instant::now());
        }
        let along = boot.began.map_or(Duration::ZERO, |began| began.elapsed());
        if along + START >= boot.time && !std::mem::replace(&mut boot.left, true) {
            self.from_device.clear();
            if let Some(restart) = &mut self.shared.lock().unwrap().boot {
                restart();
            }
        }
        if along >= boot.time {
            self.deaf = None;
        }
        self.deaf.is_some()
    }
}

/// Whole frames off the front of `bytes`, with their ends. GRBL's commands of a single byte come without one.
fn frames(bytes: &mut Vec<u8>, end: u8) -> Vec<Vec<u8>> {
    let mut found = Vec::new();
    loop {
        let single = end == b'\n' && matches!(bytes.first(), Some(b'?' | b'!' | 0x18 | 0x85));
        let at = if single { Some(0) } else { bytes.iter().position(|byte| *byte == end) };
        let Some(at) = at else { return found };
        found.push(bytes.drain(..=at).collect());
    }
}
