//! Connections within bounds: clients that hang must not take the file handles that frames are written with.

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, Sleep, sleep};

/// Connections at a time; further ones wait. Half of the file handles a process usually may have.
const CONNECTIONS: usize = 512;
/// With fewer places than this left, connections end with their first answer: clients that hold theirs leave room for Stop.
const KEPT_FREE: usize = CONNECTIONS / 4;
/// A connection on which nothing moves for so long is closed. An event stream that is read moves every 15 s.
const SILENCE: Duration = Duration::from_secs(60);

/// A TCP listener that takes a bounded number of connections and closes silent ones.
pub(super) struct Bounded {
    listener: TcpListener,
    free: Arc<Semaphore>,
    silence: Duration,
}

impl Bounded {
    pub(super) fn new(listener: TcpListener) -> Self {
        Self::with_limits(listener, CONNECTIONS, SILENCE)
    }

    fn with_limits(listener: TcpListener, connections: usize, silence: Duration) -> Self {
        Self { listener, free: Arc::new(Semaphore::new(connections)), silence }
    }
}

impl axum::serve::Listener for Bounded {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        let permit = Arc::clone(&self.free).acquire_owned().await.ok();
        let crowded = self.free.available_permits() < KEPT_FREE;
        let (stream, address) = axum::serve::Listener::accept(&mut self.listener).await;
        let end = Box::pin(sleep(self.silence));
        (Connection { stream, silence: self.silence, end, crowded, _permit: permit }, address)
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// A connection that fails with `TimedOut` once nothing has moved on it for too long.
pub(super) struct Connection {
    stream: TcpStream,
    silence: Duration,
    end: Pin<Box<Sleep>>,
    crowded: bool,
    _permit: Option<OwnedSemaphorePermit>,
}

impl Connection {
    /// Whether it came when few places were left.
    pub(super) fn is_crowded(&self) -> bool {
        self.crowded
    }

    /// Passes on what the socket says; while it says nothing, the time runs.
    fn watch<T>(&mut self, context: &mut Context<'_>, polled: Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        if polled.is_ready() {
            self.end.as_mut().reset(Instant::now() + self.silence);
            return polled;
        }
        ready!(self.end.as_mut().poll(context));
        Poll::Ready(Err(io::ErrorKind::TimedOut.into()))
    }
}

impl AsyncRead for Connection {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let polled = Pin::new(&mut self.stream).poll_read(cx, buffer);
        self.watch(cx, polled)
    }
}

impl AsyncWrite for Connection {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let polled = Pin::new(&mut self.stream).poll_write(cx, bytes);
        self.watch(cx, polled)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let polled = Pin::new(&mut self.stream).poll_write_vectored(cx, slices);
        self.watch(cx, polled)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;
    use axum::serve::Listener;
    use std::future::{Future, poll_fn};
    use std::io::Write;

    async fn bounded(connections: usize, silence: Duration) -> (Bounded, SocketAddr) {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        (Bounded::with_limits(listener, connections, silence), address)
    }

    #[tokio::test]
    async fn one_connection_too_many_waits_for_the_end_of_another() {
        let (mut listener, address) = bounded(2, SILENCE).await;
        let _clients = [TcpStream::connect(address).await, TcpStream::connect(address).await];
        let (first, _) = listener.accept().await;
        let (_second, _) = listener.accept().await;
        let _third = TcpStream::connect(address).await.unwrap();
        let mut accepted = Box::pin(listener.accept());
        assert!(poll_fn(|cx| Poll::Ready(accepted.as_mut().poll(cx).is_pending())).await);
        drop(first);
        accepted.await;
    }

    #[tokio::test]
    async fn a_silent_connection_times_out_and_what_came_before_was_heard() {
        let (mut listener, address) = bounded(1, Duration::from_millis(30)).await;
        let mut client = std::net::TcpStream::connect(address).unwrap();
        client.write_all(b"GET /livez HT").unwrap();
        let (mut connection, _) = listener.accept().await;
        let mut bytes = [0; 64];
        let mut buffer = ReadBuf::new(&mut bytes);
        let error = loop {
            match poll_fn(|cx| Pin::new(&mut connection).poll_read(cx, &mut buffer)).await {
                Ok(()) => assert!(!buffer.filled().is_empty(), "the client is still there"),
                Err(error) => break error,
            }
        };
        assert_eq!((error.kind(), buffer.filled()), (io::ErrorKind::TimedOut, &b"GET /livez HT"[..]));
    }
}
