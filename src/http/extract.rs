//! Extractors whose refusals are problems, and the session id in a path.

use super::problem::Problem;
use crate::session::handle::EngineError;
use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::HeaderMap;
use axum::http::request::Parts;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::time::Duration;

/// Longest time a body may take to come.
const BODY: Duration = Duration::from_secs(10);

/// A JSON object as the body. Serde alone would also take an array for a struct, and refuse 2.0 for 2; JSON Schema, which
/// the OpenAPI document speaks, sees both the other way round.
pub(super) struct Json<T>(pub T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequest<S> for Json<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let read = tokio::time::timeout(BODY, axum::Json::<Value>::from_request(request, state)).await;
        let axum::Json(mut value) = read.map_err(|_| Problem::too_slow())??;
        if !value.is_object() {
            return Err(Problem::wrong_body("the body is no JSON object: write {...}"));
        }
        integers(&mut value);
        let axum::Json(body) = axum::Json::from_bytes(value.to_string().as_bytes())?;
        Ok(Self(body))
    }
}

/// Writes whole numbers as integers.
fn integers(value: &mut Value) {
    /// Largest magnitude at which every whole f64 is exact.
    const EXACT: f64 = 9_007_199_254_740_991.0;
    match value {
        Value::Array(items) => items.iter_mut().for_each(integers),
        Value::Object(fields) => fields.values_mut().for_each(integers),
        Value::Number(number) => {
            if let Some(x) = number.as_f64().filter(|x| number.is_f64() && x.fract() == 0.0 && x.abs() <= EXACT) {
                *number = (x as i64).into();
            }
        }
        _ => {}
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

/// The same of a calibration.
pub(super) struct CalibrationId(pub String);

/// No query at all: one that is not understood must not be passed over, it may have meant that nothing moves.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NoQuery {}

/// The same of an entry of the queue.
pub(super) struct EntryId(pub String);

#[derive(Deserialize)]
struct IdInPath {
    id: String,
}

impl<S: Send + Sync> FromRequestParts<S> for SessionId {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        uuid_in(parts, state).await?.map(Self).map_err(|id| EngineError::UnknownSession { id }.into())
    }
}

impl<S: Send + Sync> FromRequestParts<S> for CalibrationId {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        uuid_in(parts, state).await?.map(Self).map_err(|id| EngineError::UnknownCalibration { id }.into())
    }
}

impl<S: Send + Sync> FromRequestParts<S> for EntryId {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        uuid_in(parts, state).await?.map(Self).map_err(|id| EngineError::UnknownEntry { id }.into())
    }
}

/// The id in the path; the inner error is one that has not the form of a UUID, cut short.
async fn uuid_in<S: Send + Sync>(parts: &mut Parts, state: &S) -> Result<Result<String, String>, Problem> {
    let Path(IdInPath { id }) = Path::<IdInPath>::from_request_parts(parts, state).await?;
    Ok(if is_uuid(&id) { Ok(id) } else { Err(id.chars().take(80).collect()) })
}

/// True for a lower-case hyphenated UUID.
pub(super) fn is_uuid(id: &str) -> bool {
    uuid::Uuid::try_parse(id).is_ok_and(|parsed| parsed.hyphenated().to_string() == id)
}

/// A request header as text.
///
/// # Errors
/// The header is there twice, or not visible ASCII of 1 to `longest` characters; the text says so.
pub(super) fn header<'a>(headers: &'a HeaderMap, name: &str, longest: usize) -> Result<Option<&'a str>, String> {
    let mut values = headers.get_all(name).iter();
    let Some(value) = values.next() else { return Ok(None) };
    match value.to_str() {
        _ if values.next().is_some() => Err(format!("header {name}: it is there twice: send one")),
        Ok(text) if (1..=longest).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_graphic()) => Ok(Some(text)),
        _ => Err(format!("header {name}: write 1 to {longest} visible ASCII characters, no blanks")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_become_integers() {
        let mut value = serde_json::json!({"a": [2.0, 2.5, -0.0, 1.0e300], "b": "3.0"});
        integers(&mut value);
        assert_eq!(value, serde_json::json!({"a": [2, 2.5, 0, 1.0e300], "b": "3.0"}));
    }

    #[test]
    fn only_the_form_of_a_uuid_passes() {
        assert!(is_uuid("01a208e9-cbda-76fb-b465-63318274b666"));
        for bad in ["", "none", "..", "01A208E9-CBDA-76FB-B465-63318274B666", "01a208e9cbda76fbb46563318274b666"] {
            assert!(!is_uuid(bad), "{bad}");
        }
    }
}
