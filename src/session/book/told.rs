//! What was journalled, in the daemon's log: with fields, so that a session, a station or a frame can be searched for.

use serde_json::Value;

/// Says it; what an operator wants to know of is a warning.
pub(super) fn log(session: &str, record: &Value) {
    let kind = record["type"].as_str().unwrap_or_default();
    let [seq, station, exposure] = ["seq", "station", "exposure"].map(|key| record[key].as_u64());
    let [frame, reason] = ["file", "reason"].map(|key| record[key].as_str());
    match kind {
        "frame.committed" | "bracket.resumed" | "station.developed" | "fit.finished" | "fault.cleared" => {
            tracing::info!(session, seq, station, exposure, frame, "{kind}");
        }
        "fault.raised" | "frame.rejected" | "bracket.rejected" | "frame.lost" | "ambient.failed" => {
            tracing::warn!(session, seq, station, exposure, frame, reason, "{kind}");
        }
        _ if record["warnings"].is_array() => tracing::warn!(session, seq, station, "{kind}"),
        _ => tracing::debug!(session, seq, station, exposure, frame, "{kind}"),
    }
}
