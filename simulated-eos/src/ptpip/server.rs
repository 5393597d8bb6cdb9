//! The body on a loopback port: one thread that accepts, one for each connection.

use super::connection::Connection;
use crate::body::Body;
use crate::faults::{Faults, after};
use std::io;
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU16, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How often the accepting thread looks up.
const LOOK: Duration = Duration::from_millis(5);
/// Connections at one time; a host needs two.
const MOST_CONNECTIONS: usize = 32;

/// A body that listens on a loopback port until it is dropped. Command and event connections use the same port, as with real
/// bodies; a new command connection ends the former one.
#[derive(Debug)]
pub struct Server {
    shared: Arc<Shared>,
    accepting: Option<JoinHandle<()>>,
}

#[derive(Debug)]
pub(super) struct Shared {
    pub(super) faults: Faults,
    body: Mutex<Body>,
    links: Mutex<Links>,
    port: AtomicU16,
    stopping: AtomicBool,
    port_must_change: AtomicBool,
}

#[derive(Debug, Default)]
struct Links {
    last_number: u32,
    /// The connection whose operations the body does.
    command: Option<u32>,
    open: Vec<(u32, TcpStream)>,
}

impl Server {
    /// Puts `body` on `port`, 0 for any.
    pub fn start(body: Body, port: u16) -> io::Result<Self> {
        let (listener, port) = listen(port)?;
        let shared = Arc::new(Shared {
            faults: body.faults(),
            body: Mutex::new(body),
            links: Mutex::default(),
            port: AtomicU16::new(port),
            stopping: AtomicBool::new(false),
            port_must_change: AtomicBool::new(false),
        });
        let accept = Arc::clone(&shared);
        let accepting = std::thread::Builder::new().name("eos".into()).spawn(move || accept.run(listener))?;
        Ok(Self { shared, accepting: Some(accepting) })
    }

    /// The port it listens on now; a fault may change it.
    pub fn port(&self) -> u16 {
        self.shared.port.load(Ordering::SeqCst)
    }

    /// The port as libgphoto2 spells it, with the event port.
    pub fn gphoto2_port(&self) -> String {
        let port = self.port();
        format!("ptpip:127.0.0.1:{port}:{port}")
    }

    /// Presses the button on the body itself. Returns whether the shutter opened.
    pub fn press_shutter(&self) -> bool {
        self.shared.body().press_shutter()
    }

    /// Handle on the body's faults.
    pub fn faults(&self) -> Faults {
        self.shared.faults.clone()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.stopping.store(true, Ordering::SeqCst);
        self.shared.close_all();
        if let Some(accepting) = self.accepting.take() {
            // A panic there has been reported already.
            let _ = accepting.join();
        }
    }
}

impl Shared {
    fn run(self: Arc<Self>, mut listener: TcpListener) {
        let mut threads: Vec<JoinHandle<()>> = Vec::new();
        while !self.stopping.load(Ordering::SeqCst) {
            if self.port_must_change.swap(false, Ordering::SeqCst) {
                // The new port is taken before the old one is free, so that it is another.
                if let Ok((new, port)) = listen(0) {
                    self.close_all();
                    listener = new;
                    self.port.store(port, Ordering::SeqCst);
                }
            }
            threads.retain(|thread| !thread.is_finished());
            match listener.accept() {
                Ok((stream, _)) if threads.len() < MOST_CONNECTIONS => threads.extend(Self::connect(&self, stream)),
                Ok(_) => {}
                Err(_) => std::thread::sleep(LOOK),
            }
        }
        self.close_all();
        for thread in threads {
            let _ = thread.join();
        }
    }

    /// A thread for the connection, unless the system has none.
    fn connect(self: &Arc<Self>, stream: TcpStream) -> Option<JoinHandle<()>> {
        stream.set_nonblocking(false).ok()?;
        let number = self.links().add(stream.try_clone().ok()?);
        let shared = Arc::clone(self);
        let serve = move || {
            // Whatever a host sends ends its connection at worst.
            let _ = Connection { shared: &shared, stream, number }.serve();
            shared.links().close(number);
        };
        std::thread::Builder::new().name("eos connection".into()).spawn(serve).ok()
    }

    pub(super) fn body(&self) -> MutexGuard<'_, Body> {
        self.body.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// From now on the body listens to this connection.
    pub(super) fn take_over(&self, number: u32) {
        let former = self.links().command.replace(number);
        if let Some(former) = former {
            self.links().close(former);
        }
        self.body().connect();
    }

    /// Whether the connection is still wanted.
    pub(super) fn is_open(&self, number: u32) -> bool {
        self.links().open.iter().any(|(open, _)| *open == number)
    }

    /// Makes the server come up elsewhere, without its connections.
    pub(super) fn change_port(&self) {
        self.port_must_change.store(true, Ordering::SeqCst);
    }

    /// Waits, unless the server is to stop.
    pub(super) fn pause(&self, by: Duration) {
        let end = after(Instant::now(), by);
        while Instant::now() < end && !self.stopping.load(Ordering::SeqCst) {
            std::thread::sleep(LOOK.min(end.saturating_duration_since(Instant::now())));
        }
    }

    fn close_all(&self) {
        for (_, stream) in self.links().open.drain(..) {
            // It may be closed already.
            let _ = stream.shutdown(Shutdown::Both);
        }
    }

    fn links(&self) -> MutexGuard<'_, Links> {
        self.links.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Links {
    fn add(&mut self, stream: TcpStream) -> u32 {
        self.last_number = self.last_number.wrapping_add(1);
        self.open.push((self.last_number, stream));
        self.last_number
    }

    fn close(&mut self, number: u32) {
        for (_, stream) in self.open.extract_if(.., |(open, _)| *open == number) {
            // It may be closed already.
            let _ = stream.shutdown(Shutdown::Both);
        }
    }
}

fn listen(port: u16) -> io::Result<(TcpListener, u16)> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
    listener.set_nonblocking(true)?;
    let port = listener.local_addr()?.port();
    Ok((listener, port))
}
