//! One visitor of a [`Door`] from its first byte to its last: HTTP/1 or HTTP/2, by a router.
//!
//! Whether it may stay is judged beside the connection and not inside it, so that nothing that the
//! protocol does, or forgets to do, keeps a place.

use std::io;
use std::net::SocketAddr;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use hyper::Request;
use hyper::body::Incoming;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::sync::{OwnedSemaphorePermit, oneshot, watch};
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep_until, timeout};
use tower::ServiceExt;

use super::door::{Door, FIRST_WORDS, QUIET};
use super::line::Line;

/// HTTP/2 pings to a client that says nothing, and the time for their answer: whoever is gone
/// without a word gives its place back.
const KEEP_ALIVE: Duration = Duration::from_secs(10);

/// Calls of one connection that may be under way at a time.
const CALLS: u32 = 256;

/// Time for the answers under way when a server ends.
const FAREWELL: Duration = Duration::from_secs(5);

/// What is spoken behind a door.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Speaks {
    Http2,
    /// HTTP/2 or HTTP/1: whatever the visitor begins with.
    Either,
}

/// Where a request comes from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Peer(pub SocketAddr);

/// Somebody who came in.
#[derive(Debug)]
pub(super) struct Visit {
    pub line: Line,
    pub address: SocketAddr,
    pub presence: Arc<Presence>,
    /// Ready when its place is wanted for another.
    pub leave: oneshot::Receiver<()>,
    /// Given back when it goes.
    pub place: OwnedSemaphorePermit,
}

/// Until when a visitor may stay; written where it reads and writes.
#[derive(Debug)]
pub(super) struct Presence {
    came: Instant,
    /// When it got its last answer, or said its first word, in milliseconds since it came; 0:
    /// neither.
    spoke_ms: AtomicU64,
}

impl Presence {
    pub fn new() -> Self {
        Self { came: Instant::now(), spoke_ms: AtomicU64::new(0) }
    }

    /// Whether it has said anything.
    pub fn has_spoken(&self) -> bool {
        self.spoke_ms.load(Ordering::Relaxed) > 0
    }

    fn mark(&self) {
        let ms = u64::try_from(self.came.elapsed().as_millis()).unwrap_or(u64::MAX);
        self.spoke_ms.store(ms.max(1), Ordering::Relaxed);
    }

    fn until(&self) -> Instant {
        match self.spoke_ms.load(Ordering::Relaxed) {
            0 => self.came + FIRST_WORDS,
            ms => self.came + Duration::from_millis(ms) + QUIET,
        }
    }

    /// Until it was quiet for too long.
    async fn is_over(&self) {
        loop {
            let until = self.until();
            if Instant::now() >= until {
                return;
            }
            sleep_until(until).await;
        }
    }
}

/// Lets visitors in until `stopped` is true or its sender gone, and answers what is under way
/// then.
pub(super) async fn receive(
    mut door: Door,
    speaks: Speaks,
    router: Router,
    mut stopped: watch::Receiver<bool>,
) {
    let http = http(speaks);
    let mut visits = JoinSet::new();
    loop {
        let visit = tokio::select! {
            visit = door.accept() => visit,
            () = end(&mut stopped) => break,
        };
        visits.spawn(attend(visit, http.clone(), router.clone(), stopped.clone()));
        while visits.try_join_next().is_some() {}
    }
    // The port is free from now on.
    drop(door);
    let _ = timeout(FAREWELL, async { while visits.join_next().await.is_some() {} }).await;
}

fn http(speaks: Speaks) -> Builder<TokioExecutor> {
    let both = Builder::new(TokioExecutor::new());
    let mut http = if speaks == Speaks::Http2 { both.http2_only() } else { both };
    http.http1().timer(TokioTimer::new()).header_read_timeout(QUIET);
    http.http2()
        .timer(TokioTimer::new())
        .keep_alive_interval(KEEP_ALIVE)
        .keep_alive_timeout(KEEP_ALIVE)
        .max_concurrent_streams(CALLS);
    http
}

/// One visitor, until it goes or has to.
async fn attend(
    visit: Visit,
    http: Builder<TokioExecutor>,
    router: Router,
    mut stopped: watch::Receiver<bool>,
) {
    let Visit { line, address, presence, leave, place } = visit;
    let _place = place;
    let service = hyper::service::service_fn(|mut request: Request<Incoming>| {
        request.extensions_mut().insert(Peer(address));
        router.clone().oneshot(request.map(Body::new))
    });
    let line = Watched { line, presence: Arc::clone(&presence) };
    let mut connection = pin!(http.serve_connection(TokioIo::new(line), service));
    let mut leave = pin!(must_leave(leave, &presence));
    let mut ending = false;
    loop {
        tokio::select! {
            biased;
            () = &mut leave => return,
            () = end(&mut stopped), if !ending => {
                ending = true;
                connection.as_mut().graceful_shutdown();
                // Who has not begun to ask gets no answer.
                if !presence.has_spoken() {
                    return;
                }
            }
            // What went wrong there is nobody's business here.
            _ = &mut connection => return,
        }
    }
}

async fn must_leave(leave: oneshot::Receiver<()>, presence: &Presence) {
    tokio::select! {
        biased;
        // A door that is gone sends nobody away.
        Ok(()) = leave => {}
        () = presence.is_over() => {}
    }
}

async fn end(stopped: &mut watch::Receiver<bool>) {
    let _ = stopped.wait_for(|stopped| *stopped).await;
}

/// A line that tells when it is used.
struct Watched {
    line: Line,
    presence: Arc<Presence>,
}

impl Watched {
    fn wrote(&self, written: &Poll<io::Result<usize>>) {
        // What TLS says before the first word is no answer.
        if matches!(written, Poll::Ready(Ok(1..))) && self.presence.has_spoken() {
            self.presence.mark();
        }
    }
}

impl AsyncRead for Watched {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let read = Pin::new(&mut self.line).poll_read(cx, buffer);
        if buffer.filled().len() > before && !self.presence.has_spoken() {
            self.presence.mark();
        }
        read
    }
}

impl AsyncWrite for Watched {
    fn poll_write(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.line).poll_write(cx, bytes);
        self.wrote(&written);
        written
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.line).poll_write_vectored(cx, parts);
        self.wrote(&written);
        written
    }

    fn is_write_vectored(&self) -> bool {
        self.line.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.line).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.line).poll_shutdown(cx)
    }
}
