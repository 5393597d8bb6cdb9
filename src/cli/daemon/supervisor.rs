//! What systemd is told: ready, ending, and alive for as long as neither the engine nor the HTTP runtime hangs. Says nothing where
//! nobody asked for it (no `NOTIFY_SOCKET`, no `WATCHDOG_USEC`).

use crate::session::handle::EngineHandle;
use sd_notify::NotifyState;
use std::ffi::OsStr;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

/// The daemon serves; from now on it pings the watchdog, if there is one.
pub fn started(url: &str, engine: &EngineHandle) {
    tell(&[NotifyState::Ready, NotifyState::Status(&format!("listening on {url}"))]);
    let Some(limit) = sd_notify::watchdog_enabled() else { return };
    let engine = engine.clone();
    // A task of the HTTP runtime: when that hangs, so does this.
    tokio::spawn(async move {
        let (mut looks, mut seen) = (tokio::time::interval(limit / 4), None);
        loop {
            looks.tick().await;
            let beats = engine.beats();
            if seen != Some(beats) {
                tell(&[NotifyState::Watchdog]);
                seen = Some(beats);
            }
        }
    });
}

/// The daemon ends: the clean-up may take its time.
pub fn ending() {
    tell(&[NotifyState::Stopping]);
}

fn tell(what: &[NotifyState]) {
    let Some(manager) = std::env::var_os("NOTIFY_SOCKET") else { return };
    if let Err(error) = send(&manager, what) {
        tracing::warn!(%error, "systemd is not told {what:?}");
    }
}

/// Never waits, as `sd_notify::notify` does where the manager does not read: a manager that hangs must hold up neither Stop nor the lamp.
fn send(manager: &OsStr, what: &[NotifyState]) -> io::Result<()> {
    let address = match manager.as_bytes() {
        [b'@', name @ ..] => SocketAddr::from_abstract_name(name)?,
        path => SocketAddr::from_pathname(OsStr::from_bytes(path))?,
    };
    let socket = UnixDatagram::unbound()?;
    socket.set_nonblocking(true)?;
    let lines: String = what.iter().map(|state| format!("{state}\n")).collect();
    socket.send_to_addr(lines.as_bytes(), &address).map(drop)
}
