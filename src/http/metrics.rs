//! Metrics in the OpenMetrics text format. Nothing is counted here: each scrape reads sessions and notifications as they stand.

use super::problem::Problem;
use super::{HttpState, ask};
use crate::notify::Count;
use crate::session::handle::{EngineHandle, LampStatus, SessionSnapshot};
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::info::Info;
use prometheus_client::registry::Registry;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

/// Metrics
#[utoipa::path(get, path = "/metrics", tag = "health", responses(
    (status = 200, body = String, content_type = "application/openmetrics-text; version=1.0.0; charset=utf-8", description = "OpenMetrics text."),
))]
pub(super) async fn metrics(State(state): State<HttpState>) -> Result<Response, Problem> {
    let look = |engine: &EngineHandle| Ok((engine.sessions(), engine.lamp(), engine.index_fault()));
    let (sessions, lamp, index_fault) = ask(&state, look).await?;
    let text = text(&sessions, &lamp, index_fault, &state.notifications).map_err(|_| Problem::internal())?;
    Ok(([(header::CONTENT_TYPE, "application/openmetrics-text; version=1.0.0; charset=utf-8")], text).into_response())
}

fn text(
    sessions: &[SessionSnapshot],
    lamp: &LampStatus,
    index_fault: bool,
    notifications: &[Arc<Count>],
) -> Result<String, std::fmt::Error> {
    let mut registry = Registry::with_prefix("rigd");
    registry.register("build", "The daemon", Info::new(vec![("version", env!("CARGO_PKG_VERSION"))]));
    let ended = Family::<Vec<(&str, String)>, Counter>::default();
    for session in sessions.iter().filter(|s| s.state.is_final()) {
        // The state's name on the wire, so that queries and REST agree.
        let state = serde_json::to_value(session.state).map_err(|_| std::fmt::Error)?;
        ended.get_or_create(&vec![("state", state.as_str().unwrap_or_default().to_owned())]).inc();
    }
    registry.register("sessions", "Sessions kept, by final state", ended);
    let frames = Counter::<u64>::default();
    frames.inc_by(sessions.iter().map(|s| s.frames_committed as u64).sum());
    registry.register("frames_committed", "Frames committed to disk in all sessions kept", frames);
    let hours = Gauge::<f64, AtomicU64>::default();
    hours.set(lamp.hours);
    registry.register("lamp_hours", "Hours the lamp was lit", hours);
    let faulty = Gauge::<i64>::default();
    faulty.set(i64::from(index_fault));
    registry.register("index_fault", "1 while the index cannot be written; sessions go on without it", faulty);
    if let Some(remaining) = sessions.iter().filter(|s| !s.state.is_final()).find_map(|s| s.remaining_s) {
        let gauge = Gauge::<f64, AtomicU64>::default();
        gauge.set(remaining);
        registry.register("session_remaining_seconds", "Estimated time left of the running session", gauge);
    }
    let [sent, failed] = [(); 2].map(|()| Family::<Vec<(&str, &str)>, Counter>::default());
    for count in notifications {
        let label = vec![("target", count.target)];
        sent.get_or_create(&label).inc_by(count.sent());
        failed.get_or_create(&label).inc_by(count.failed());
    }
    registry.register("notifications_sent", "Messages that somebody took since the daemon started", sent);
    registry.register("notifications_failed", "Messages that were given up since the daemon started", failed);
    let mut text = String::new();
    encode(&mut text, &registry)?;
    Ok(text)
}
