//! Sessions: start, list, look at, and ask something of them.

use super::extract::{Json, Query, SessionId, header, is_uuid};
use super::problem::Problem;
use super::{HttpState, ask};
use crate::session::handle::SessionSnapshot;
use crate::session::plan::{CapturePlan, StartRequest};
use crate::session::state::Verb;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header as names};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

/// Longest Idempotency-Key, characters.
const LONGEST_KEY: usize = 200;

#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct StartOptions {
    /// True: only answers with the plan, nothing moves.
    #[serde(default)]
    dry_run: bool,
}

/// Start a session, or see its plan
///
/// Everything the body leaves out comes from the rig file: `{}` starts the rig's own plan. The answer comes before anything
/// moves; follow the session at its Location.
#[utoipa::path(post, path = "/v1/sessions", tag = "sessions", request_body = StartRequest,
    params(StartOptions, ("Idempotency-Key" = Option<String>, Header, nullable = false, min_length = 1, max_length = 200, pattern = "^[!-~]+$",
        description = "The same key with the same body answers with the same session instead of starting another.")),
    responses(
        (status = 202, body = SessionSnapshot, description = "Accepted; an earlier session if the Idempotency-Key was used before.",
            headers(("Location" = String, description = "Path of the session."))),
        (status = 200, body = CapturePlan, description = "The plan (dry run)."),
        (status = 400, description = "No JSON, or a wrong query or header."),
        (status = 409, description = "Another session holds the rig; `running` names it."),
        (status = 413, description = "The body is too large."),
        (status = 415, description = "The body is not sent as application/json."),
        (status = 422, description = "The plan is refused, `reasons` lists why; or the key was used with another body."),
        (status = 507, description = "Not enough disk space for the plan."),
    ))]
pub(super) async fn start(
    State(state): State<HttpState>,
    Query(options): Query<StartOptions>,
    headers: HeaderMap,
    Json(request): Json<StartRequest>,
) -> Result<Response, Problem> {
    let key = header(&headers, "idempotency-key", LONGEST_KEY).map_err(Problem::bad_request)?.map(str::to_owned);
    if options.dry_run {
        let plan = ask(&state, move |engine| engine.plan(&request)).await?;
        return Ok(axum::Json(plan).into_response());
    }
    let started = ask(&state, move |engine| engine.start(&request, key.as_deref())).await?;
    let location = format!("/v1/sessions/{}", started.snapshot.id);
    Ok((StatusCode::ACCEPTED, [(names::LOCATION, location)], axum::Json(started.snapshot)).into_response())
}

#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct Page {
    /// `next_page_token` of the page before.
    #[param(
        pattern = "^[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}$",
        required = false,
        nullable = false
    )]
    page_token: Option<String>,
    /// Most sessions in the answer; 50 if left out.
    #[param(minimum = 1, maximum = 1000, required = false, nullable = false)]
    max_page_size: Option<u32>,
}

/// One page of sessions.
#[derive(Serialize, Deserialize, ToSchema)]
pub(super) struct SessionList {
    /// Newest first.
    sessions: Vec<SessionSnapshot>,
    /// Ask with it for the next page; absent on the last.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    next_page_token: Option<String>,
}

/// List sessions, newest first
#[utoipa::path(get, path = "/v1/sessions", tag = "sessions", params(Page), responses(
    (status = 200, body = SessionList, description = "One page."),
    (status = 400, description = "A wrong query."),
))]
pub(super) async fn list(
    State(state): State<HttpState>,
    Query(page): Query<Page>,
) -> Result<axum::Json<SessionList>, Problem> {
    let size = page.max_page_size.unwrap_or(50) as usize;
    if !(1..=1000).contains(&size) {
        return Err(Problem::bad_request("max_page_size: write 1 to 1000"));
    }
    if page.page_token.as_deref().is_some_and(|token| !is_uuid(token)) {
        return Err(Problem::bad_request(
            "page_token: write the next_page_token of an earlier answer, or leave it out",
        ));
    }
    let all = ask(&state, |engine| Ok(engine.sessions())).await?;
    Ok(axum::Json(cut(all, page.page_token.as_deref(), size)))
}

/// The `size` newest sessions older than `token`. Ids are UUIDs of version 7, so their order is that of their starts, and a
/// session that ends or starts between two pages shifts nothing.
fn cut(mut all: Vec<SessionSnapshot>, token: Option<&str>, size: usize) -> SessionList {
    all.sort_by(|a, b| b.id.cmp(&a.id));
    let mut rest = all.into_iter().filter(|s| token.is_none_or(|t| s.id.as_str() < t));
    let sessions: Vec<_> = rest.by_ref().take(size).collect();
    let next_page_token = rest.next().and(sessions.last()).map(|s| s.id.clone());
    SessionList { sessions, next_page_token }
}

/// Look at a session
#[utoipa::path(get, path = "/v1/sessions/{id}", tag = "sessions", params(("id" = String, Path, description = "Session id.")),
    responses(
        (status = 200, body = SessionSnapshot, description = "The session as it stands."),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such session."),
    ))]
pub(super) async fn show(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
) -> Result<axum::Json<SessionSnapshot>, Problem> {
    ask(&state, move |engine| engine.session(&id)).await.map(axum::Json)
}

/// The plan of a session
///
/// As its dry run answered when it was started: angles of the stations in shooting order, exposures, estimates.
#[utoipa::path(get, path = "/v1/sessions/{id}/plan", tag = "sessions", params(("id" = String, Path, description = "Session id.")),
    responses(
        (status = 200, body = CapturePlan, description = "The plan."),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such session."),
    ))]
pub(super) async fn plan(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
) -> Result<axum::Json<CapturePlan>, Problem> {
    ask(&state, move |engine| engine.session_plan(&id)).await.map(axum::Json)
}

/// Declares one verb's route: they differ in nothing else.
macro_rules! verb {
    ($name:ident, $path:literal, $verb:expr, $summary:literal, $description:literal) => {
        #[doc = $summary]
        #[doc = ""]
        #[doc = $description]
        #[utoipa::path(post, path = $path, tag = "sessions", params(("id" = String, Path, description = "Session id.")), responses(
            (status = 202, body = SessionSnapshot, description = "Taken; the session as it stands."),
            (status = 400, description = "The path is no UTF-8."),
            (status = 404, description = "No such session."),
            (status = 409, description = "Not possible in `current_state`; `allowed` lists what is."),
        ))]
        pub(super) async fn $name(
            State(state): State<HttpState>,
            SessionId(id): SessionId,
        ) -> Result<(StatusCode, axum::Json<SessionSnapshot>), Problem> {
            let snapshot = ask(&state, move |engine| engine.command(&id, $verb)).await?;
            Ok((StatusCode::ACCEPTED, axum::Json(snapshot)))
        }
    };
}

verb!(
    pause,
    "/v1/sessions/{id}/pause",
    Verb::Pause,
    "Pause a session",
    "At the next safe point: before a frame, motor standing."
);
verb!(
    resume,
    "/v1/sessions/{id}/resume",
    Verb::Resume,
    "Resume a session",
    "After a pause, once the cause of a suspension is gone, or after an interruption: then stations whose bracket is whole are kept."
);
verb!(
    stop,
    "/v1/sessions/{id}/stop",
    Verb::Stop,
    "Stop a session",
    "Ends early, cleans up, keeps and fits what is there."
);
verb!(abort, "/v1/sessions/{id}/abort", Verb::Abort, "Abort a session", "Ends now, cleans up, fits nothing.");

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::state::SessionState;

    fn session(id: u128) -> SessionSnapshot {
        SessionSnapshot {
            id: uuid::Uuid::from_u128(id).to_string(),
            name: String::new(),
            state: SessionState::Completed,
            reason: None,
            simulated: true,
            started: String::new(),
            ended: None,
            stations: 1,
            exposures: 1,
            station: 0,
            frames_committed: 1,
            frames_planned: 1,
            saved: None,
            stations_developed: 1,
            remaining_s: None,
            calibration: None,
            warnings: Vec::new(),
            refused: 0,
            last_refusal: None,
            interruptions: 0,
            mean_relative_error: None,
            weak_parameters: 0,
            time_budget: None,
            lamp_drift: None,
            last_seq: 1,
        }
    }

    /// Walking the pages meets every session once, newest first, also when one vanishes and one appears on the way.
    #[test]
    fn pages_meet_every_session_once() {
        for size in 1..=8 {
            let mut all: Vec<_> = (1..=7).map(session).collect();
            let (mut seen, mut token, mut pages) = (Vec::new(), None, 0);
            loop {
                let page = cut(all.clone(), token.as_deref(), size);
                assert!(page.sessions.len() <= size);
                seen.extend(page.sessions.into_iter().map(|s| s.id));
                pages += 1;
                if pages == 1 {
                    all.push(session(99));
                    all.retain(|s| Some(&s.id) != page.next_page_token.as_ref());
                }
                token = page.next_page_token;
                if token.is_none() {
                    break;
                }
            }
            let want: Vec<_> = (1..=7).rev().map(|i| session(i).id).collect();
            assert_eq!(seen, want, "page size {size}");
            assert_eq!(pages, 7_usize.div_ceil(size));
        }
    }
}
