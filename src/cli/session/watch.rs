//! Following a session to its end, over lost connections.

use super::client::Client;
use super::failure::ClientError;
use crate::cli::progress::Progress;
use crate::session::handle::SessionSnapshot;
use std::time::Duration;

/// Pause before another attempt to connect.
const RETRY: Duration = Duration::from_millis(500);
/// Attempts in a row before giving up: a daemon that restarts takes a few seconds.
const ATTEMPTS: u32 = 60;

/// Follows session `id` of the client's daemon to its end, showing its `progress`, and returns it as it ended.
/// A lost connection is taken up again where it broke.
///
/// # Errors
/// The daemon refuses (no such session), or cannot be reached for half a minute.
pub fn watch(client: &Client, id: &str, progress: &Progress) -> anyhow::Result<SessionSnapshot> {
    let (mut seen, mut failures) = (0, 0);
    loop {
        match follow(client, id, &mut seen, progress) {
            Ok(snapshot) if snapshot.state.is_final() => {
                progress.end();
                return Ok(snapshot);
            }
            Ok(_) => failures = 0,
            Err(error @ (ClientError::Refused(_) | ClientError::Usage(_))) => return Err(error.into()),
            Err(error) if failures >= ATTEMPTS => return Err(error.into()),
            Err(_) => {
                failures += 1;
                progress.stage("connection lost, trying again");
            }
        }
        std::thread::sleep(RETRY);
    }
}

/// One connection: shows the session as it changes, and returns it as it stands when the stream ends.
fn follow(client: &Client, id: &str, seen: &mut u64, progress: &Progress) -> Result<SessionSnapshot, ClientError> {
    let mut snapshot = client.session(id)?;
    show(progress, &snapshot);
    if snapshot.state.is_final() {
        return Ok(snapshot);
    }
    for seq in client.events(id, *seen)? {
        *seen = seq;
        // What a replay tells is in the snapshot already.
        if seq > snapshot.last_seq {
            snapshot = client.session(id)?;
            show(progress, &snapshot);
        }
    }
    client.session(id)
}

fn show(progress: &Progress, s: &SessionSnapshot) {
    let station = format!("station {} of {}", (s.station + 1).min(s.stations), s.stations);
    let reason = s.reason.as_ref().map(|r| format!(" ({r})")).unwrap_or_default();
    let now = format!("{}{reason}, {station}", s.state);
    progress.counts((s.frames_committed, s.frames_planned), &now, &left(s.remaining_s));
}

/// Time left as `, 2:05 left`; empty when unknown.
fn left(seconds: Option<f64>) -> String {
    let Some(seconds) = seconds.filter(|s| s.is_finite() && *s >= 0.0) else { return String::new() };
    let whole = seconds.round() as u64;
    let (hours, minutes, seconds) = (whole / 3600, whole / 60 % 60, whole % 60);
    if hours > 0 {
        format!(", {hours}:{minutes:02}:{seconds:02} left")
    } else {
        format!(", {minutes}:{seconds:02} left")
    }
}

#[cfg(test)]
mod tests {
    use super::left;

    #[test]
    fn time_left_is_written_as_a_clock() {
        let cases = [(Some(0.4), ", 0:00 left"), (Some(125.0), ", 2:05 left"), (Some(7322.0), ", 2:02:02 left")];
        for (seconds, text) in cases {
            assert_eq!(left(seconds), text);
        }
        for unknown in [None, Some(f64::NAN), Some(f64::INFINITY), Some(-1.0)] {
            assert_eq!(left(unknown), "");
        }
    }
}
