//! Following a session to its end, over lost connections.

use super::client::{Client, ClientError};
use crate::session::handle::SessionSnapshot;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::Write;
use std::time::Duration;

/// Pause before another attempt to connect.
const RETRY: Duration = Duration::from_millis(500);
/// Attempts in a row before giving up: a daemon that restarts takes a few seconds.
const ATTEMPTS: u32 = 60;

/// Follows session `id` of the client's daemon to its end, showing progress on stderr, and returns it as it ended.
/// A lost connection is taken up again where it broke.
///
/// # Errors
/// The daemon refuses (no such session), or cannot be reached for half a minute.
pub fn watch(client: &Client, id: &str) -> anyhow::Result<SessionSnapshot> {
    let mut view = View::new();
    let (mut seen, mut failures) = (0, 0);
    loop {
        match follow(client, id, &mut seen, &mut view) {
            Ok(snapshot) if snapshot.state.is_final() => {
                view.bar.finish_and_clear();
                return Ok(snapshot);
            }
            Ok(_) => failures = 0,
            Err(error @ (ClientError::Refused(_) | ClientError::Usage(_))) => return Err(error.into()),
            Err(error) if failures >= ATTEMPTS => return Err(error.into()),
            Err(_) => {
                failures += 1;
                view.bar.set_message("connection lost, trying again");
            }
        }
        std::thread::sleep(RETRY);
    }
}

/// One connection: shows the session as it changes, and returns it as it stands when the stream ends.
fn follow(client: &Client, id: &str, seen: &mut u64, view: &mut View) -> Result<SessionSnapshot, ClientError> {
    let mut snapshot = client.session(id)?;
    view.show(&snapshot);
    if snapshot.state.is_final() {
        return Ok(snapshot);
    }
    for seq in client.events(id, *seen)? {
        *seen = seq;
        // What a replay tells is in the snapshot already.
        if seq > snapshot.last_seq {
            snapshot = client.session(id)?;
            view.show(&snapshot);
        }
    }
    client.session(id)
}

/// A bar on a terminal, a line a change anywhere else.
struct View {
    bar: ProgressBar,
    last_line: String,
}

impl View {
    fn new() -> Self {
        let bar = ProgressBar::new(0);
        if let Ok(style) = ProgressStyle::with_template("[{bar:30}] {pos}/{len} frames  {msg}") {
            bar.set_style(style.progress_chars("=> "));
        }
        Self { bar, last_line: String::new() }
    }

    fn show(&mut self, s: &SessionSnapshot) {
        let station = format!("station {} of {}", (s.station + 1).min(s.stations), s.stations);
        let reason = s.reason.as_ref().map(|r| format!(" ({r})")).unwrap_or_default();
        let line = format!("{}{reason}, {station}", s.state);
        self.bar.set_length(s.frames_planned as u64);
        self.bar.set_position(s.frames_committed as u64);
        self.bar.set_message(format!("{line}{}", left(s.remaining_s)));
        if self.bar.is_hidden() && line != self.last_line {
            // Nothing can be done about a closed stderr.
            let (done, all, left) = (s.frames_committed, s.frames_planned, left(s.remaining_s));
            let _ = writeln!(std::io::stderr(), "{done}/{all} frames  {line}{left}");
            self.last_line = line;
        }
    }
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
