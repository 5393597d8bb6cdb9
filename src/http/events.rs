//! The journal of a session as server-sent events: the id is the journal's sequence number, so a client that reconnects with
//! Last-Event-ID is told exactly what it missed.

use super::extract::{CalibrationId, Query, SessionId};
use super::problem::Problem;
use super::{HttpState, ask};
use crate::session::handle::{EngineError, EngineHandle};
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::Value;
use std::convert::Infallible;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use utoipa::{IntoParams, ToSchema};

/// Events on their way to one client; a slow one makes its own stream wait and nobody else's.
const IN_FLIGHT: usize = 64;

/// Largest sequence number asked for: beyond it JSON readers lose digits.
pub(super) const LARGEST_SEQ: u64 = 9_007_199_254_740_991;

/// One event as it is sent.
#[derive(ToSchema)]
#[allow(dead_code, reason = "only its schema is used")]
struct SentEvent {
    /// Sequence number of the journal record.
    id: String,
    /// Type of the record: `session.state`, `frame.committed`, ...
    event: String,
    /// The record, JSON.
    data: String,
}

#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct After {
    /// Send only events with a sequence number above this; Last-Event-ID wins over it.
    #[param(minimum = 0, maximum = 9_007_199_254_740_991_u64, required = false, nullable = false)]
    after: Option<u64>,
}

/// Follow a session
///
/// One event a journal record: `id` its sequence number, `event` its type, `data` the record as JSON. Clients ignore types
/// they do not know. Events of the type `fit.live` are no records, have no id and are not sent again: they say that GET .../fit has
/// something new, at most some ten times a second. The stream ends after the session's last event, and that of a refit. Once nothing will follow, a further request is
/// answered 204, which tells a browser's EventSource to stop.
#[utoipa::path(get, path = "/v1/sessions/{id}/events", tag = "sessions",
    params(("id" = String, Path, description = "Session id."), After,
        ("Last-Event-ID" = Option<u64>, Header, nullable = false, minimum = 0, maximum = 9_007_199_254_740_991_u64, description = "Id of the last event received.")),
    responses(
        (status = 200, body = SentEvent, content_type = "text/event-stream", description = "The events."),
        (status = 204, description = "The session has ended and nothing follows."),
        (status = 400, description = "Last-Event-ID or `after` is no sequence number."),
        (status = 404, description = "No such session."),
    ))]
pub(super) async fn events(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
    Query(query): Query<After>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    stream(state, id, session_standing, query, &headers).await
}

/// Follow a calibration
///
/// As the events of a session; `step.asked`, `step.accepted` and `step.refused` are its own.
#[utoipa::path(get, path = "/v1/calibrations/{id}/events", tag = "calibrations",
    params(("id" = String, Path, description = "Calibration id."), After,
        ("Last-Event-ID" = Option<u64>, Header, nullable = false, minimum = 0, maximum = 9_007_199_254_740_991_u64, description = "Id of the last event received.")),
    responses(
        (status = 200, body = SentEvent, content_type = "text/event-stream", description = "The events."),
        (status = 204, description = "The calibration has ended and nothing follows."),
        (status = 400, description = "Last-Event-ID or `after` is no sequence number."),
        (status = 404, description = "No such calibration."),
    ))]
pub(super) async fn calibration_events(
    State(state): State<HttpState>,
    CalibrationId(id): CalibrationId,
    Query(query): Query<After>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    stream(state, id, calibration_standing, query, &headers).await
}

/// How a run stands.
struct Standing {
    /// Nothing more will happen to it.
    over: bool,
    /// Sequence number of its last record.
    last_seq: u64,
    /// Revision of its fit; 0 where nobody can watch one.
    fit: u64,
}

type LookAt = fn(&EngineHandle, &str) -> Result<Standing, EngineError>;

fn session_standing(engine: &EngineHandle, id: &str) -> Result<Standing, EngineError> {
    // The mark first: what was journalled of a refit that has ended since is then sent as well.
    let mark = engine.fit_mark(id);
    let session = engine.session(id)?;
    Ok(Standing { over: session.state.is_final() && !mark.refitting, last_seq: session.last_seq, fit: mark.revision })
}

fn calibration_standing(engine: &EngineHandle, id: &str) -> Result<Standing, EngineError> {
    let run = engine.calibration(id)?;
    Ok(Standing { over: run.state.is_final(), last_seq: run.last_seq, fit: 0 })
}

async fn stream(
    state: HttpState,
    id: String,
    standing: LookAt,
    query: After,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    let refuse = || {
        Problem::bad_request("Last-Event-ID or after is no sequence number: send the id of an event of this session")
    };
    let in_query = query.after.unwrap_or(0);
    let after = match headers.get("last-event-id") {
        Some(value) => value.to_str().ok().and_then(|text| text.parse().ok()).ok_or_else(refuse)?,
        None => in_query,
    };
    if after.max(in_query) > LARGEST_SEQ {
        return Err(refuse());
    }
    let asked = id.clone();
    let stands = ask(&state, move |engine| standing(engine, &asked)).await?;
    if stands.over && stands.last_seq <= after {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let (sender, receiver) = mpsc::channel(IN_FLIGHT);
    tokio::spawn(follow(state, id, standing, after, sender));
    Ok(Sse::new(ReceiverStream::new(receiver)).keep_alive(KeepAlive::default()).into_response())
}

/// Sends records as they come, until the session has ended, the client is gone, or the daemon ends.
async fn follow(
    state: HttpState,
    id: String,
    standing: LookAt,
    mut after: u64,
    sender: mpsc::Sender<Result<Event, Infallible>>,
) {
    let (mut changes, mut fit_told) = (state.engine.changes(), 0);
    let shutdown = state.shutdown.clone();
    loop {
        changes.mark_unchanged();
        let asked = id.clone();
        let Ok(stands) = ask(&state, move |engine| standing(engine, &asked)).await else { return };
        if stands.last_seq > after {
            let asked = id.clone();
            let Ok(events) = ask(&state, move |engine| Ok(next_events(&engine.events_after(&asked, after)?))).await
            else {
                return;
            };
            let more = events.len() == IN_FLIGHT;
            for (seq, event) in events {
                if sender.send(Ok(event)).await.is_err() {
                    return;
                }
                after = after.max(seq);
            }
            if more {
                continue;
            }
        }
        if stands.fit > fit_told {
            fit_told = stands.fit;
            if sender.send(Ok(fit_event(fit_told))).await.is_err() {
                return;
            }
        }
        if stands.over && after >= stands.last_seq {
            return;
        }
        tokio::select! {
            changed = changes.changed() => if changed.is_err() { return },
            () = sender.closed() => return,
            () = shutdown.cancelled() => return,
        }
    }
}

/// The first events of `records`: no more than fit on their way, so that a client that does not read costs little memory.
fn next_events(records: &[Value]) -> Vec<(u64, Event)> {
    records.iter().filter_map(event).take(IN_FLIGHT).collect()
}

/// Says that the fit has moved on. It has no id: who reconnects asks for journal records only.
fn fit_event(revision: u64) -> Event {
    Event::default().event("fit.live").data(format!(r#"{{"type":"fit.live","revision":{revision}}}"#))
}

/// A journal record as an event; none if it has no sequence number.
fn event(record: &Value) -> Option<(u64, Event)> {
    let seq = record["seq"].as_u64()?;
    let plain = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
    let kind = record["type"].as_str().filter(|kind| kind.chars().all(plain)).unwrap_or("message");
    Some((seq, Event::default().id(seq.to_string()).event(kind).data(record.to_string())))
}
