//! Problem details (RFC 9457): the one place where errors become HTTP statuses.

use crate::session::handle::EngineError;
use crate::session::state::{SessionState, Verb};
use axum::Json;
use axum::extract::rejection::{JsonRejection, PathRejection, QueryRejection};
use axum::http::{StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use std::any::Any;
use std::fmt;
use utoipa::ToSchema;

/// The body of every answer that is no success; content type `application/problem+json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// What kind of problem: `urn:rigd:problem:` and a fixed word.
    #[serde(rename = "type")]
    pub kind: String,
    /// The kind in words.
    pub title: String,
    /// The HTTP status.
    #[schema(minimum = 400, maximum = 599)]
    pub status: u16,
    /// What is wrong here, and what to do.
    pub detail: String,
    /// Path of the request.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub instance: Option<String>,
    /// State of the session in question.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub current_state: Option<SessionState>,
    /// What can be asked of the session instead.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub allowed: Option<Vec<Verb>>,
    /// Id of the session that holds the rig.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub running: Option<String>,
    /// Every single reason, where there can be more than one.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub reasons: Option<Vec<String>>,
}

impl Problem {
    fn new(status: StatusCode, kind: &str, title: &str, detail: impl fmt::Display) -> Self {
        Self {
            kind: format!("urn:rigd:problem:{kind}"),
            title: title.into(),
            status: status.as_u16(),
            detail: detail.to_string(),
            instance: None,
            current_state: None,
            allowed: None,
            running: None,
            reasons: None,
        }
    }

    /// A request that cannot be understood.
    pub(super) fn bad_request(detail: impl fmt::Display) -> Self {
        Self::new(StatusCode::BAD_REQUEST, "bad-request", "The request cannot be understood", detail)
    }

    /// A body that is JSON but not what is asked for.
    pub(super) fn wrong_body(detail: &str) -> Self {
        let problem = Self::new(StatusCode::UNPROCESSABLE_ENTITY, "wrong-body", "The body is refused", detail);
        Self { reasons: Some(vec![detail.into()]), ..problem }
    }

    /// Something a session does not have in its present state.
    pub(super) fn not_yet(state: SessionState, detail: impl fmt::Display) -> Self {
        let problem = Self::new(StatusCode::CONFLICT, "not-yet", "Not there in this state", detail);
        Self { current_state: Some(state), ..problem }
    }

    /// Nothing there.
    pub(super) fn not_found(detail: impl fmt::Display) -> Self {
        Self::new(StatusCode::NOT_FOUND, "not-found", "Not found", detail)
    }

    /// No token, or none that is known.
    pub(super) fn unauthorized(detail: &str) -> Self {
        Self::new(StatusCode::UNAUTHORIZED, "unauthorized", "A token is needed", detail)
    }

    /// Something this client may not do.
    pub(super) fn forbidden(detail: &str) -> Self {
        Self::new(StatusCode::FORBIDDEN, "forbidden", "Not allowed", detail)
    }

    /// A body that does not come.
    pub(super) fn too_slow() -> Self {
        let detail = "the body did not come in time: send the request again";
        Self::new(StatusCode::REQUEST_TIMEOUT, "too-slow", "Request timeout", detail)
    }

    /// A body of a type that is not taken.
    pub(super) fn wrong_type(detail: &str) -> Self {
        Self::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "wrong-type", "Unsupported content type", detail)
    }

    /// A body that is too large.
    pub(super) fn too_large(most: usize) -> Self {
        let detail = format!("the body is larger than {most} bytes");
        Self::new(StatusCode::PAYLOAD_TOO_LARGE, "too-large", "Body too large", detail)
    }

    /// The daemon cannot work now.
    pub(super) fn not_ready(reasons: Vec<String>) -> Self {
        let detail = format!("no session can start: {}", reasons.join("; "));
        let problem = Self::new(StatusCode::SERVICE_UNAVAILABLE, "not-ready", "Not ready", detail);
        Self { reasons: Some(reasons), ..problem }
    }

    /// A Host header that is not this machine's.
    pub(super) fn misdirected() -> Self {
        let detail = "the Host header names no loopback address: ask for 127.0.0.1, [::1] or localhost";
        Self::new(StatusCode::MISDIRECTED_REQUEST, "misdirected", "Not served under this name", detail)
    }

    /// A fault of ours.
    pub(super) fn internal() -> Self {
        let detail = "the daemon failed on this request: its log says where; please report it";
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, "internal", "Internal error", detail)
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let mut response = (status, [(header::CONTENT_TYPE, "application/problem+json")], Json(&self)).into_response();
        // The middleware that knows the path fills in `instance`.
        response.extensions_mut().insert(self);
        response
    }
}

impl From<EngineError> for Problem {
    fn from(error: EngineError) -> Self {
        let detail = error.to_string();
        let of = |status, kind, title| Self::new(status, kind, title, &detail);
        match error {
            EngineError::UnknownSession { .. }
            | EngineError::UnknownCalibration { .. }
            | EngineError::UnknownLight { .. }
            | EngineError::UnknownEntry { .. } => Self::not_found(detail),
            EngineError::Unshown { .. } => of(StatusCode::UNPROCESSABLE_ENTITY, "not-shown", "It cannot be shown"),
            EngineError::DamagedCalibration { .. } => {
                of(StatusCode::CONFLICT, "calibration-damaged", "The calibration is damaged")
            }
            EngineError::DamagedSession { .. } => of(StatusCode::CONFLICT, "session-damaged", "The session is damaged"),
            EngineError::Plan(plan) => {
                let problem = of(StatusCode::UNPROCESSABLE_ENTITY, "plan-refused", "The plan is refused");
                Self { reasons: Some(plan.reasons), ..problem }
            }
            EngineError::Busy { running, state } => Self {
                running: Some(running),
                current_state: Some(state),
                ..of(StatusCode::CONFLICT, "busy", "The rig is busy")
            },
            EngineError::WrongState { state, allowed, .. } => Self {
                current_state: Some(state),
                allowed: Some(allowed),
                ..of(StatusCode::CONFLICT, "wrong-state", "Not possible in this state")
            },
            EngineError::Verifying { .. } => of(StatusCode::CONFLICT, "verifying", "Another session is being verified"),
            EngineError::RigChanged { .. } => of(StatusCode::CONFLICT, "rig-changed", "Begun with another rig file"),
            EngineError::KeyReused => of(StatusCode::UNPROCESSABLE_ENTITY, "key-reused", "Idempotency-Key used before"),
            EngineError::NoSpace { .. } => of(StatusCode::INSUFFICIENT_STORAGE, "no-space", "Not enough disk space"),
            EngineError::Storage(_) => of(StatusCode::INTERNAL_SERVER_ERROR, "storage", "Storage failed"),
            EngineError::Gone => of(StatusCode::SERVICE_UNAVAILABLE, "engine-gone", "The engine has ended"),
        }
    }
}

impl From<JsonRejection> for Problem {
    fn from(rejection: JsonRejection) -> Self {
        let detail = rejection.body_text();
        match rejection.status() {
            StatusCode::UNSUPPORTED_MEDIA_TYPE => {
                let detail = "send the body as JSON with `Content-Type: application/json`";
                Self::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "no-json", "Unsupported content type", detail)
            }
            StatusCode::PAYLOAD_TOO_LARGE => Self::too_large(super::LARGEST_BODY),
            // The line and column would be those of our own normal form of the body, not of the client's text.
            StatusCode::UNPROCESSABLE_ENTITY => {
                let detail = detail
                    .strip_prefix("Failed to deserialize the JSON body into the target type: ")
                    .unwrap_or(&detail);
                Self::wrong_body(detail.rsplit_once(" at line ").map_or(detail, |(what, _)| what))
            }
            _ => Self::bad_request(detail),
        }
    }
}

impl From<QueryRejection> for Problem {
    fn from(rejection: QueryRejection) -> Self {
        Self::bad_request(rejection.body_text())
    }
}

impl From<PathRejection> for Problem {
    fn from(rejection: PathRejection) -> Self {
        Self::bad_request(rejection.body_text())
    }
}

/// Answer to a path that is none of ours.
pub(super) async fn no_route(uri: Uri) -> Problem {
    Problem::not_found(format!("nothing is served at {}: see /openapi.json", uri.path()))
}

/// Answer to a method the path does not take; the router adds `Allow`.
pub(super) async fn wrong_method() -> Problem {
    let detail = "this path takes other methods only: see the Allow header";
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, "wrong-method", "Method not allowed", detail)
}

/// Answer to a handler that panicked; the text went to the log by the panic hook.
pub(super) fn panicked(_: Box<dyn Any + Send>) -> Response {
    Problem::internal().into_response()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::plan::PlanError;

    #[test]
    fn every_engine_error_has_its_status_and_extensions() {
        let reasons = vec!["stations_deg[0]: outside".to_owned(), "name: empty".to_owned()];
        let plan = Problem::from(EngineError::Plan(PlanError { reasons: reasons.clone() }));
        assert_eq!((plan.status, plan.reasons), (422, Some(reasons)));
        let busy = Problem::from(EngineError::Busy { running: "abc".into(), state: SessionState::Running });
        assert_eq!((busy.status, busy.running.as_deref()), (409, Some("abc")));
        assert!(busy.detail.contains("abc"), "{}", busy.detail);
        let state = SessionState::Completed;
        let wrong = Problem::from(EngineError::WrongState { verb: Verb::Pause, state, allowed: vec![] });
        assert_eq!((wrong.status, wrong.current_state, wrong.allowed), (409, Some(state), Some(vec![])));
        for (error, status) in [
            (EngineError::UnknownSession { id: "x".into() }, 404),
            (EngineError::DamagedSession { id: "x".into(), reason: "y".into() }, 409),
            (EngineError::KeyReused, 422),
            (EngineError::NoSpace { needed: 2, free: 1, path: "/data".into() }, 507),
            (EngineError::Storage("full".into()), 500),
            (EngineError::Gone, 503),
        ] {
            assert_eq!(Problem::from(error.clone()).status, status, "{error}");
        }
    }
}
