//! The queue: what waits for the rig.

use super::extract::{EntryId, Json, NoQuery, Query};
use super::problem::Problem;
use super::{HttpState, ask};
use crate::session::handle::{QueueRequest, QueueSnapshot, QueuedSession};
use axum::extract::State;
use axum::http::{StatusCode, header as names};
use axum::response::{IntoResponse, Response};

/// See the queue
///
/// In order, with the times and the disk space that are to be expected.
#[utoipa::path(get, path = "/v1/queue", tag = "queue", responses((status = 200, body = QueueSnapshot, description = "The queue.")))]
pub(super) async fn show(State(state): State<HttpState>) -> Result<axum::Json<QueueSnapshot>, Problem> {
    ask(&state, |engine| Ok(engine.queue())).await.map(axum::Json)
}

/// Queue a session
///
/// It is started when the rig is free, no earlier entry is due and its time has come; `runs` times. Its place survives the daemon.
#[utoipa::path(post, path = "/v1/queue", tag = "queue", request_body = QueueRequest, responses(
    (status = 201, body = QueuedSession, description = "At the end of the queue.", headers(("Location" = String, description = "Path of the entry."))),
    (status = 400, description = "No JSON, or a query."),
    (status = 413, description = "The body is too large."),
    (status = 415, description = "The body is not sent as application/json."),
    (status = 422, description = "The session or its times are refused, `reasons` lists why."),
    (status = 507, description = "Not enough disk space to write the queue."),
))]
pub(super) async fn add(
    State(state): State<HttpState>,
    Query(NoQuery {}): Query<NoQuery>,
    Json(request): Json<QueueRequest>,
) -> Result<Response, Problem> {
    let queued = ask(&state, move |engine| engine.enqueue(&request)).await?;
    let location = format!("/v1/queue/{}", queued.entry.id);
    Ok((StatusCode::CREATED, [(names::LOCATION, location)], axum::Json(queued)).into_response())
}

/// Take a session out of the queue
///
/// A run of it that goes on is not ended.
#[utoipa::path(delete, path = "/v1/queue/{id}", tag = "queue", params(("id" = String, Path, description = "Entry id.")), responses(
    (status = 204, description = "It is gone."),
    (status = 400, description = "The path is no UTF-8."),
    (status = 404, description = "No such entry."),
    (status = 507, description = "Not enough disk space to write the queue."),
))]
pub(super) async fn remove(State(state): State<HttpState>, EntryId(id): EntryId) -> Result<StatusCode, Problem> {
    ask(&state, move |engine| engine.dequeue(&id)).await.map(|()| StatusCode::NO_CONTENT)
}

/// Make an entry the next one
///
/// One that could not be started is tried again.
#[utoipa::path(post, path = "/v1/queue/{id}/first", tag = "queue", params(("id" = String, Path, description = "Entry id.")), responses(
    (status = 200, body = QueueSnapshot, description = "The queue."),
    (status = 400, description = "The path is no UTF-8."),
    (status = 404, description = "No such entry."),
    (status = 507, description = "Not enough disk space to write the queue."),
))]
pub(super) async fn first(
    State(state): State<HttpState>,
    EntryId(id): EntryId,
) -> Result<axum::Json<QueueSnapshot>, Problem> {
    ask(&state, move |engine| engine.queue_first(&id)).await.map(axum::Json)
}

/// Hold the queue
///
/// Nothing more of it is started; the session that is running goes on.
#[utoipa::path(post, path = "/v1/queue/hold", tag = "queue", responses(
    (status = 200, body = QueueSnapshot, description = "The queue."),
    (status = 507, description = "Not enough disk space to write the queue."),
))]
pub(super) async fn hold(State(state): State<HttpState>) -> Result<axum::Json<QueueSnapshot>, Problem> {
    ask(&state, |engine| engine.hold_queue(true)).await.map(axum::Json)
}

/// Let the queue go on
#[utoipa::path(post, path = "/v1/queue/release", tag = "queue", responses(
    (status = 200, body = QueueSnapshot, description = "The queue."),
    (status = 507, description = "Not enough disk space to write the queue."),
))]
pub(super) async fn release(State(state): State<HttpState>) -> Result<axum::Json<QueueSnapshot>, Problem> {
    ask(&state, |engine| engine.hold_queue(false)).await.map(axum::Json)
}
