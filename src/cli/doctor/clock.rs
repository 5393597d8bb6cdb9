//! The computer's clock: sessions are named, ordered and dated by it.

use crate::devices::inspect::{Finding, Host};
use crate::session::preflight::OLDEST_S;
use jiff::Timestamp;

/// Whether the clock can be right, and whether systemd-timesyncd says that it has set it.
pub fn look(host: &Host, now: Timestamp) -> Finding {
    if now.as_second() < OLDEST_S {
        let what = format!(
            "says {now}, which is before this program was written: sessions would be ordered and dated wrongly"
        );
        return Finding::warning(
            "clock",
            what,
            "`sudo timedatectl set-ntp true`, or replace the computer's clock battery",
        );
    }
    if host.run.join("systemd/timesync/synchronized").exists() {
        return Finding::ok("clock", "is set from the network");
    }
    let what = "nothing says that it is set from the network (systemd-timesyncd)";
    Finding::warning("clock", what, "`sudo timedatectl set-ntp true`, unless another program sets it")
}
