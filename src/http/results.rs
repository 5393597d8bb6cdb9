//! What a session left behind: frames, material, result files; and the refit.

use super::extract::{Json, Path, SessionId};
use super::problem::Problem;
use super::{HttpState, ask};
use crate::session::handle::{FitRequest, SessionSnapshot};
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fs::File;
use std::io::Read;
use std::path::PathBuf;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use utoipa::ToSchema;

/// Frames of a session.
#[derive(Serialize, Deserialize, ToSchema)]
pub(super) struct FrameList {
    /// In the order they were committed: `station`, `exposure`, `file`, `blake3`, `bytes`, `shutter`, `state`.
    #[schema(value_type = Vec<Object>)]
    frames: Vec<Value>,
}

/// List the frames of a session
#[utoipa::path(get, path = "/v1/sessions/{id}/frames", tag = "results", params(("id" = String, Path, description = "Session id.")),
    responses(
        (status = 200, body = FrameList, description = "Every frame committed so far."),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such session."),
    ))]
pub(super) async fn frames(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
) -> Result<axum::Json<FrameList>, Problem> {
    let frames = ask(&state, move |engine| engine.frames(&id)).await?;
    Ok(axum::Json(FrameList { frames }))
}

#[derive(Deserialize)]
pub(super) struct FramePath {
    file: String,
}

/// A frame
///
/// The file as the camera made it, also of a frame that was shot again since.
#[utoipa::path(get, path = "/v1/sessions/{id}/frames/{file}", tag = "results",
    params(("id" = String, Path, description = "Session id."), ("file" = String, Path, description = "`file` of a frame in the list.")),
    responses(
        (status = 200, description = "The frame.", content((Binary = "image/jpeg"))),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such session, or no frame of that name."),
    ))]
pub(super) async fn frame(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
    Path(FramePath { file }): Path<FramePath>,
) -> Result<Response, Problem> {
    match ask(&state, move |engine| engine.frame_file(&id, &file)).await? {
        Some(path) => send(path, "image/jpeg").await,
        None => Err(Problem::not_found("no frame of that name: GET .../frames lists those there are")),
    }
}

/// The fitted material
///
/// `material.json` and `report.json` of the session: parameters with standard errors and flags, and the errors of the fit.
#[utoipa::path(get, path = "/v1/sessions/{id}/material", tag = "results", params(("id" = String, Path, description = "Session id.")),
    responses(
        (status = 200, body = Object, description = "Material and report."),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such session."),
        (status = 409, description = "No material in `current_state`."),
    ))]
pub(super) async fn material(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
) -> Result<axum::Json<Value>, Problem> {
    let asked = id.clone();
    match ask(&state, move |engine| engine.material(&asked)).await? {
        Some(material) => Ok(axum::Json(material)),
        None => Err(nothing_yet(&state, id, "material").await),
    }
}

/// Files of a result directory that are served, with their content types.
const FILES: &[(&str, &str)] = &[
    ("report.json", "application/json"),
    ("material.json", "application/json"),
    ("weights.exr", "image/x-exr"),
    ("weights_sigma.exr", "image/x-exr"),
    ("residual.exr", "image/x-exr"),
    ("valid.png", "image/png"),
    ("preview.png", "image/png"),
];

/// Name of a result file.
#[derive(ToSchema)]
#[allow(dead_code, reason = "only its schema is used: the enum of FILES for the OpenAPI document")]
enum ResultName {
    #[schema(rename = "report.json")]
    Report,
    #[schema(rename = "material.json")]
    Material,
    #[schema(rename = "weights.exr")]
    Weights,
    #[schema(rename = "weights_sigma.exr")]
    WeightsSigma,
    #[schema(rename = "residual.exr")]
    Residual,
    #[schema(rename = "valid.png")]
    Valid,
    #[schema(rename = "preview.png")]
    Preview,
}

/// Bytes of an image.
#[derive(ToSchema)]
#[schema(value_type = String, format = Binary)]
#[allow(dead_code, reason = "only its schema is used")]
pub(super) struct Binary(Vec<u8>);

#[derive(Deserialize)]
pub(super) struct FilePath {
    name: String,
}

/// A result file
#[utoipa::path(get, path = "/v1/sessions/{id}/result/{name}", tag = "results",
    params(("id" = String, Path, description = "Session id."), ("name" = inline(ResultName), Path, description = "Name of the file.")),
    responses(
        (status = 200, description = "The file.", content(
            (Object = "application/json"), (Binary = "image/png"), (Binary = "image/x-exr"))),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such session, or no file of that name."),
        (status = 409, description = "No result in `current_state`."),
    ))]
pub(super) async fn file(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
    Path(FilePath { name }): Path<FilePath>,
) -> Result<Response, Problem> {
    let Some((name, kind)) = FILES.iter().find(|(known, _)| *known == name) else {
        let known: Vec<_> = FILES.iter().map(|(known, _)| *known).collect();
        return Err(Problem::not_found(format!("no result file of that name: ask for one of {}", known.join(", "))));
    };
    let asked = id.clone();
    let Some(path) = ask(&state, move |engine| engine.result_file(&asked, name)).await? else {
        return Err(nothing_yet(&state, id, name).await);
    };
    send(path, kind).await
}

async fn send(path: PathBuf, kind: &'static str) -> Result<Response, Problem> {
    let opened = tokio::task::spawn_blocking(move || File::open(path).and_then(|f| Ok((f.metadata()?.len(), f)))).await;
    let Ok(Ok((length, file))) = opened else { return Err(Problem::internal()) };
    let headers = [(header::CONTENT_TYPE, kind.to_owned()), (header::CONTENT_LENGTH, length.to_string())];
    Ok((headers, stream(file, length)).into_response())
}

/// Bytes of a piece of a file.
const PIECE: u64 = 64 << 10;

/// A file in pieces: a weight map of a full frame does not fit the daemon's memory budget. No thread waits for the client: one
/// that never reads holds up nobody else.
fn stream(file: File, length: u64) -> Body {
    let (sender, receiver) = mpsc::channel::<std::io::Result<Bytes>>(4);
    tokio::spawn(async move {
        let mut rest = file.take(length);
        while rest.limit() > 0 {
            let read = tokio::task::spawn_blocking(move || {
                let mut piece = Vec::new();
                let read = rest.by_ref().take(PIECE).read_to_end(&mut piece);
                (rest, read.map(|_| piece))
            });
            let Ok((file, piece)) = read.await else { return };
            rest = file;
            let last = piece.as_ref().map_or(true, Vec::is_empty);
            if sender.send(piece.map(Bytes::from)).await.is_err() || last {
                return;
            }
        }
    });
    Body::from_stream(ReceiverStream::new(receiver))
}

/// Fit a finished session again
///
/// Not while a session or a calibration holds the rig: its lamp would be lit for the fit.
#[utoipa::path(post, path = "/v1/sessions/{id}/fit", tag = "results", request_body = FitRequest,
    params(("id" = String, Path, description = "Session id.")),
    responses(
        (status = 202, body = SessionSnapshot, description = "Queued on the fitting worker."),
        (status = 400, description = "No JSON."),
        (status = 404, description = "No such session."),
        (status = 409, description = "Not possible in `current_state`, or another session holds the rig."),
        (status = 413, description = "The body is too large."),
        (status = 415, description = "The body is not sent as application/json."),
        (status = 422, description = "The request is refused; `reasons` lists why."),
        (status = 507, description = "Not enough disk space."),
    ))]
pub(super) async fn refit(
    State(state): State<HttpState>,
    SessionId(id): SessionId,
    Json(request): Json<FitRequest>,
) -> Result<(StatusCode, axum::Json<SessionSnapshot>), Problem> {
    let snapshot = ask(&state, move |engine| engine.refit(&id, &request)).await?;
    Ok((StatusCode::ACCEPTED, axum::Json(snapshot)))
}

/// Refusal for something a session does not have, with its state.
async fn nothing_yet(state: &HttpState, id: String, what: &str) -> Problem {
    match ask(state, move |engine| engine.session(&id)).await {
        Ok(SessionSnapshot { id, state, .. }) => {
            Problem::not_yet(state, format!("session {id} has no {what}: it is there once a fit has ended well"))
        }
        Err(problem) => problem,
    }
}
