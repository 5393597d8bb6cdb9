//! The HTTP server: what one connection may cost, in time, headers and memory.

use super::listener::Bounded;
use axum::Router;
use axum::serve::Listener;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// Longest time from a connection's first moment, or its last answer, to the end of the next request's headers.
const HEAD: Duration = Duration::from_secs(20);
/// Most headers of a request, and bytes of its line and headers: browsers send a tenth.
const HEADERS: usize = 64;
const HEAD_BYTES: usize = 32 << 10;

/// Serves until `shutdown`, then until the open requests are answered.
pub(super) async fn run(mut listener: Bounded, router: Router, shutdown: CancellationToken) {
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(HEAD).max_headers(HEADERS).max_buf_size(HEAD_BYTES);
    let open = GracefulShutdown::new();
    loop {
        let stream = tokio::select! {
            (stream, _) = listener.accept() => stream,
            () = shutdown.cancelled() => break,
        };
        let connection = http.serve_connection(TokioIo::new(stream), TowerToHyperService::new(router.clone()));
        let watched = open.watch(connection);
        tokio::spawn(async move {
            // Clients that break off or speak no HTTP are everyday.
            if let Err(error) = watched.await {
                tracing::debug!(%error, "connection");
            }
        });
    }
    // Nobody new is taken while the rest is answered.
    drop(listener);
    open.shutdown().await;
}
