//! A full disk holds a session up, whether it shoots or fits; nothing that was committed is lost.

use super::book::{Book, Entry, Inner};
use super::plan::processing_bytes;
use super::state::{Event, SessionState};
use crate::store::StoreError;
use crate::store::sessions::FrameWriter;
use rig_config::Rig;
use serde_json::json;
use std::time::Duration;

/// Time between two looks at a full disk, seconds of the rig's time.
const RECHECK_S: f64 = 3.0;
/// A look that would be later than this is made now and then all the same.
const LONG: Duration = Duration::from_secs(3600);

/// Suspends the session until `bytes` and the reserve fit on the disk, or until a user or the daemon's end decides otherwise.
pub fn wait_for(book: &Book, id: &str, writer: &FrameWriter, bytes: u64, reason: &str, speed: f64) {
    book.note(id, "fault.raised", json!({"device": "disk", "reason": reason}));
    // Refused only when a user ended the session meanwhile: whoever called sees it at the next safe point.
    let _ = book.happen(id, Event::ConditionLost, Some(reason));
    let recheck = Duration::try_from_secs_f64(RECHECK_S / speed).unwrap_or(LONG);
    let suspended = |inner: &Inner| inner.entry(id).map(Entry::state) == Ok(SessionState::Suspended);
    let go_on = |inner: &mut Inner| (inner.shutdown || !suspended(inner)).then_some(());
    while book.wait(book.clock.rest(recheck), go_on).is_none() {
        if writer.check_space(bytes).is_ok() {
            let _ = book.happen(id, Event::ConditionBack, None);
            book.note(id, "fault.cleared", json!({"device": "disk"}));
        }
    }
}

/// Room that was missing when a step failed.
pub struct Lack {
    /// What is needed and what there is, in words.
    pub error: StoreError,
    /// Bytes that the steps still to come need.
    pub bytes: u64,
}

/// Whether a develop step or a fit that has just failed may have failed for lack of room. Asked at once: a minute later the disk
/// may have been cleared.
pub fn lack(book: &Book, id: &str, rig: &Rig) -> Option<Lack> {
    let (undeveloped, calibrated) = book.look(id, |e| {
        let undeveloped = e.work.stations().saturating_sub(e.ledger.snapshot.stations_developed);
        (undeveloped, e.work.capture().is_none_or(|plan| plan.calibration.is_some()))
    })?;
    let (bytes, writer) = (processing_bytes(rig, undeveloped, calibrated), book.frame_writer(id)?);
    if writer.fits(bytes) {
        return None;
    }
    Some(Lack { error: writer.check_space(bytes).err()?, bytes })
}
