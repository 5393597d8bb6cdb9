//! The report of a session, made when it is asked for.

use super::extract::SessionId;
use super::problem::Problem;
use super::results::Binary;
use super::{HttpState, ask};
use crate::session::handle::{REPORT_POLICY, ReportForm};
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use tokio::sync::Semaphore;

/// One report is made at a time: its maps take memory, and a session may be running.
static ONE: Semaphore = Semaphore::const_new(1);

/// The report of a session, for browsers
///
/// One file that loads nothing: what was captured, with what, how good it is, what went wrong, and how to verify it, as far as the session has got.
#[utoipa::path(get, path = "/v1/sessions/{id}/report", tag = "results", params(("id" = String, Path, description = "Session id.")),
    responses(
        (status = 200, description = "The report.", content((String = "text/html"))),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such session."),
        (status = 409, description = "A file of the session is damaged; the detail names it."),
    ))]
pub(super) async fn html(State(state): State<HttpState>, SessionId(id): SessionId) -> Result<Response, Problem> {
    let headers = [
        (header::CONTENT_TYPE, "text/html; charset=utf-8"),
        (header::CONTENT_SECURITY_POLICY, REPORT_POLICY),
        (header::X_FRAME_OPTIONS, "DENY"),
    ];
    Ok((headers, made(&state, id, ReportForm::Html).await?).into_response())
}

/// The report of a session, for paper
///
/// The same as PDF, A4.
#[utoipa::path(get, path = "/v1/sessions/{id}/report.pdf", tag = "results", params(("id" = String, Path, description = "Session id.")),
    responses(
        (status = 200, description = "The report.", content((Binary = "application/pdf"))),
        (status = 400, description = "The path is no UTF-8."),
        (status = 404, description = "No such session."),
        (status = 409, description = "A file of the session is damaged; the detail names it."),
    ))]
pub(super) async fn pdf(State(state): State<HttpState>, SessionId(id): SessionId) -> Result<Response, Problem> {
    let made = made(&state, id, ReportForm::Pdf).await?;
    Ok(([(header::CONTENT_TYPE, "application/pdf")], made).into_response())
}

/// Waits for its turn, which ends when the work does, not when the client goes away.
async fn made(state: &HttpState, id: String, form: ReportForm) -> Result<Vec<u8>, Problem> {
    let turn = ONE.acquire().await.map_err(|_| Problem::internal())?;
    ask(state, move |engine| {
        let made = engine.report(&id, form);
        drop(turn);
        made
    })
    .await
}
