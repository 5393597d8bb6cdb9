//! What systemd is told: ready, ending, and alive for as long as neither the engine nor the HTTP runtime hangs. Says nothing where
//! nobody asked for it (no `NOTIFY_SOCKET`, no `WATCHDOG_USEC`).

use crate::session::handle::EngineHandle;
use sd_notify::NotifyState;

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
    if let Err(error) = sd_notify::notify(what) {
        tracing::warn!(%error, "systemd is not told {what:?}");
    }
}
