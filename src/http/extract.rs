//! Extractors whose refusals are problems, and the session id in a path.

use super::problem::Problem;
use crate::session::handle::EngineError;
use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::request::Parts;
use serde::Deserialize;
use serde::de::DeserializeOwned;

/// A JSON body.
pub(super) struct Json<T>(pub T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequest<S> for Json<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let axum::Json(value) = axum::Json::from_request(request, state).await?;
        Ok(Self(value))
    }
}

/// The query string; unknown names are refused by its types, because a mistyped `dry_run` must not move the arm.
pub(super) struct Query<T>(pub T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequestParts<S> for Query<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let axum::extract::Query(value) = axum::extract::Query::from_request_parts(parts, state).await?;
        Ok(Self(value))
    }
}

/// Values in the path.
pub(super) struct Path<T>(pub T);

impl<T: DeserializeOwned + Send, S: Send + Sync> FromRequestParts<S> for Path<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let axum::extract::Path(value) = axum::extract::Path::from_request_parts(parts, state).await?;
        Ok(Self(value))
    }
}

/// A session id in the path. Only the form of a UUID goes further: no other text can reach the store's paths.
pub(super) struct SessionId(pub String);

#[derive(Deserialize)]
struct IdInPath {
    id: String,
}

impl<S: Send + Sync> FromRequestParts<S> for SessionId {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let Path(IdInPath { id }) = Path::<IdInPath>::from_request_parts(parts, state).await?;
        if is_uuid(&id) {
            Ok(Self(id))
        } else {
            Err(EngineError::UnknownSession { id: id.chars().take(80).collect() }.into())
        }
    }
}

/// True for a lower-case hyphenated UUID.
pub(super) fn is_uuid(id: &str) -> bool {
    uuid::Uuid::try_parse(id).is_ok_and(|parsed| parsed.hyphenated().to_string() == id)
}

/// A request header as text.
///
/// # Errors
/// The header is not visible ASCII of 1 to `longest` characters.
pub(super) fn header<'a>(
    parts: &'a axum::http::HeaderMap,
    name: &str,
    longest: usize,
) -> Result<Option<&'a str>, Problem> {
    let Some(value) = parts.get(name) else { return Ok(None) };
    match value.to_str() {
        Ok(text) if (1..=longest).contains(&text.len()) => Ok(Some(text)),
        _ => Err(Problem::bad_request(format!("header {name}: write 1 to {longest} visible ASCII characters"))),
    }
}
