//! The HTTP server: what one connection may cost, in time, headers and memory.

use super::listener::Bounded;
use super::tls::Tls;
use axum::Router;
use axum::serve::Listener;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::{GracefulShutdown, Watcher};
use hyper_util::service::TowerToHyperService;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;

/// Longest time from a connection's first moment, or its last answer, to the end of the next request's headers; and for a handshake.
const HEAD: Duration = Duration::from_secs(20);
/// Most headers of a request, and bytes of its line and headers: browsers send a tenth.
const HEADERS: usize = 64;
const HEAD_BYTES: usize = 32 << 10;

/// Serves until `shutdown`, then until the open requests are answered.
pub(super) async fn run(mut listener: Bounded, tls: Option<Tls>, router: Router, shutdown: CancellationToken) {
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(HEAD).max_headers(HEADERS).max_buf_size(HEAD_BYTES);
    let open = GracefulShutdown::new();
    loop {
        let connection = tokio::select! {
            (connection, _) = listener.accept() => connection,
            () = shutdown.cancelled() => break,
        };
        let (mut http, router, watcher) = (http.clone(), router.clone(), open.watcher());
        http.keep_alive(!connection.is_crowded());
        let Some(tls) = tls.clone() else {
            tokio::spawn(serve(http, connection, router, watcher));
            continue;
        };
        tokio::spawn(async move {
            match timeout(HEAD, tls.accept(connection)).await {
                Ok(Ok(stream)) => serve(http, stream, router, watcher).await,
                Ok(Err(error)) => tracing::debug!(%error, "TLS handshake"),
                Err(_) => tracing::debug!("TLS handshake: too slow"),
            }
        });
    }
    // Nobody new is taken while the rest is answered.
    drop(listener);
    open.shutdown().await;
}

async fn serve<S>(http: http1::Builder, stream: S, router: Router, watcher: Watcher)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let connection = http.serve_connection(TokioIo::new(stream), TowerToHyperService::new(router));
    // Clients that break off or speak no HTTP are everyday.
    if let Err(error) = watcher.watch(connection).await {
        tracing::debug!(%error, "connection");
    }
}
