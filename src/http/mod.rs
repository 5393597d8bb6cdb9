//! The REST surface: routes, JSON bodies, problem details, the event stream, metrics and the page. It knows the engine's
//! handle and nothing of devices, pipeline or disk layout.
mod auth;
mod calibrations;
mod events;
mod extract;
mod guard;
mod listener;
mod live;
mod log;
mod metrics;
mod openapi;
mod page;
mod problem;
mod queue;
mod report;
mod results;
mod rig;
mod server;
mod sessions;
mod settings;
mod tls;
mod viewer;

pub use auth::{TokenError, Tokens, is_token};
pub use log::LogTail;
pub use problem::Problem;
pub use tls::Tls;

use crate::notify::Count;
use crate::session::handle::EngineHandle;
use axum::Router;
use axum::extract::DefaultBodyLimit;
use rig_config::Rig;
use std::net::IpAddr;
use std::path::Path;
use std::sync::Arc;
use tokio_util::sync::CancellationToken;
use tower_http::catch_panic::CatchPanicLayer;

/// Largest request body, bytes: a plan of 1000 stations takes 20 000.
const LARGEST_BODY: usize = 64 << 10;

/// What every handler sees.
#[derive(Clone)]
pub struct HttpState {
    /// The engine.
    pub engine: EngineHandle,
    /// The rig it drives.
    pub rig: Arc<Rig>,
    /// Its file; none where the program brought it along.
    pub rig_file: Option<Arc<Path>>,
    /// The last log lines.
    pub log: Arc<LogTail>,
    /// Who may ask.
    pub tokens: Arc<Tokens>,
    /// What became of the messages of `[notify]`.
    pub notifications: Arc<[Arc<Count>]>,
    /// Cancelled when the daemon ends: open event streams end with it.
    pub shutdown: CancellationToken,
}

/// Why the daemon cannot serve.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The listener can be reached from other machines, and anyone there could move the arm.
    #[error(
        "{0} is no loopback address, and the daemon has no tokens: name a file of them in server.tokens (docs/operations.md), or listen on 127.0.0.1"
    )]
    NotLoopback(IpAddr),
    /// The listener failed.
    #[error("cannot serve: {0}")]
    Io(#[from] std::io::Error),
}

/// All routes.
pub fn router(state: HttpState) -> Router {
    let (routes, spec) = openapi::routes().split_for_parts();
    let spec = openapi::text(spec, &state);
    routes
        .merge(page::routes())
        .route("/openapi.json", axum::routing::get(move || async move { openapi::answer(spec) }))
        .fallback(problem::no_route)
        .method_not_allowed_fallback(problem::wrong_method)
        .layer(DefaultBodyLimit::max(LARGEST_BODY))
        .layer(axum::middleware::from_fn_with_state(state.clone(), auth::authorize))
        .layer(axum::middleware::from_fn_with_state(state.clone(), guard::own_name))
        .layer(axum::middleware::from_fn(guard::instance))
        .layer(CatchPanicLayer::custom(problem::panicked))
        .with_state(state)
}

/// Serves, with TLS where there is a certificate, until `state.shutdown` is cancelled and the open requests are answered.
///
/// # Errors
/// As [`may_serve`], or the listener fails.
pub async fn serve(listener: tokio::net::TcpListener, tls: Option<Tls>, state: HttpState) -> Result<(), ServeError> {
    may_serve(listener.local_addr()?.ip(), &state.tokens)?;
    let shutdown = state.shutdown.clone();
    server::run(listener::Bounded::new(listener), tls, router(state), shutdown).await;
    Ok(())
}

/// Whether the daemon may listen there.
///
/// # Errors
/// The address is not a loopback one, and there are no tokens.
pub fn may_serve(ip: IpAddr, tokens: &Tokens) -> Result<(), ServeError> {
    if ip.is_loopback() || !tokens.is_empty() { Ok(()) } else { Err(ServeError::NotLoopback(ip)) }
}

/// Asks the engine outside the async threads: its answer may wait for the disk.
async fn ask<T: Send + 'static>(
    state: &HttpState,
    question: impl FnOnce(&EngineHandle) -> Result<T, crate::session::handle::EngineError> + Send + 'static,
) -> Result<T, Problem> {
    let engine = state.engine.clone();
    match tokio::task::spawn_blocking(move || question(&engine)).await {
        Ok(answer) => answer.map_err(Problem::from),
        Err(_) => Err(Problem::internal()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_loopback_is_served_without_tokens() {
        let tokens = Tokens::parse("read 0123456789abcdef0123456789abcdef").unwrap_or_default();
        for (ip, served) in
            [([127, 0, 0, 1], true), ([127, 1, 2, 3], true), ([0, 0, 0, 0], false), ([192, 168, 0, 2], false)]
        {
            assert_eq!(may_serve(IpAddr::from(ip), &Tokens::default()).is_ok(), served, "{ip:?}");
            assert!(may_serve(IpAddr::from(ip), &tokens).is_ok(), "{ip:?}");
        }
    }
}
