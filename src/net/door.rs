//! A TCP listener with a bounded number of connections, none of which may be silent for long.
//! A TLS handshake is among what has to be done in that time.
//!
//! Whoever connects and says nothing, speaks one byte a minute, or takes no answer costs a
//! place for seconds, not for ever: a connection has [`FIRST_WORDS`] to begin and [`QUIET`]
//! from one answer to the next. Keeping alive what is idle is the business of the protocol
//! above (HTTP/2 pings are answers, too). Where places run out, a newcomer takes that of one who
//! never said anything, or of the neighbourhood that holds most of them ([`gives_way`]), or
//! waits. Where file descriptors run out, the listener sleeps; it never spins.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

use rustix::process::{Resource, getrlimit};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpListener;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc, oneshot};
use tokio::time::{Instant, Sleep};
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::server::Connected;

use super::line::{Line, Security};
use super::neighbours::{gives_way, neighbourhood};

/// Most connections at a time: more than people, dashboards and scripts of one laboratory.
const MOST: u64 = 128;

/// Fewest, however few files this process may have open.
const FEWEST: u64 = 4;

/// Files that the rest of the daemon needs: sockets, timers, the scene on its way to disk.
const OTHER_FILES: u64 = 40;

/// Time for the first byte.
const FIRST_WORDS: Duration = Duration::from_secs(3);

/// Time from one answer to the next; twice what a scraper usually waits between two looks.
const QUIET: Duration = Duration::from_secs(30);

/// Pause after the system had no connection to give (too many open files, no memory).
const RECOVERY: Duration = Duration::from_millis(100);

/// Between two complaints about the same.
const COMPLAINTS: Duration = Duration::from_secs(10);

/// The listener.
#[derive(Debug)]
pub struct Door {
    listener: TcpListener,
    security: Security,
    places: Arc<Semaphore>,
    /// Those inside, the oldest first, and some who have left meanwhile.
    inside: Vec<Inside>,
    complained: Option<Instant>,
}

/// Somebody inside, as the door knows it.
#[derive(Debug)]
struct Inside {
    from: IpAddr,
    /// It has said something.
    spoke: Arc<AtomicBool>,
    /// Sends it away.
    away: oneshot::Sender<()>,
}

impl Door {
    /// A bound listener, inside a runtime.
    pub fn new(listener: std::net::TcpListener, security: Security) -> io::Result<Self> {
        Self::with(listener, security, most(getrlimit(Resource::Nofile).current))
    }

    fn with(listener: std::net::TcpListener, security: Security, most: usize) -> io::Result<Self> {
        listener.set_nonblocking(true)?;
        Ok(Self {
            listener: TcpListener::from_std(listener)?,
            security,
            places: Arc::new(Semaphore::new(most)),
            inside: Vec::new(),
            complained: None,
        })
    }

    /// The next connection, once there is a place for it. Cancelled, it may lose one that
    /// waits for its place.
    pub async fn accept(&mut self) -> (Visitor, SocketAddr) {
        loop {
            match self.listener.accept().await {
                Ok((stream, address)) => {
                    let from = neighbourhood(address.ip());
                    let place = self.place(from).await;
                    let (away, leave) = oneshot::channel();
                    let spoke = Arc::<AtomicBool>::default();
                    self.inside.push(Inside { from, spoke: Arc::clone(&spoke), away });
                    // Answers are small; one that waits to be joined by another only comes late.
                    let _ = stream.set_nodelay(true);
                    let line = Line::new(stream, &self.security);
                    return (Visitor::new(line, address, place, (spoke, leave)), address);
                }
                // That client has gone again.
                Err(error) if error.kind() == io::ErrorKind::ConnectionAborted => {}
                Err(error) => {
                    if self.may_complain() {
                        tracing::warn!(%error, "cannot accept a connection");
                    }
                    tokio::time::sleep(RECOVERY).await;
                }
            }
        }
    }

    async fn place(&mut self, newcomer: IpAddr) -> OwnedSemaphorePermit {
        self.inside.retain(|inside| !inside.away.is_closed());
        if let Ok(place) = Arc::clone(&self.places).try_acquire_owned() {
            return place;
        }
        let sent_away = self.leaves_for(newcomer).is_some_and(|away| away.send(()).is_ok());
        if !sent_away && self.may_complain() {
            tracing::warn!("every connection is in use, another one has to wait");
        }
        Arc::clone(&self.places).acquire_owned().await.expect("the semaphore is never closed")
    }

    /// Who has to go, so that a newcomer has a place: one who never said anything, or else
    /// one of many.
    fn leaves_for(&mut self, newcomer: IpAddr) -> Option<oneshot::Sender<()>> {
        let is_silent = |inside: &Inside| !inside.spoke.load(Ordering::Relaxed);
        let silent = || self.inside.iter().enumerate().filter(|(_, inside)| is_silent(inside));
        let of_most = || gives_way(silent().map(|(_, inside)| inside.from), newcomer);
        let place = match silent().nth(of_most().unwrap_or(0)) {
            Some((place, _)) => place,
            None => gives_way(self.inside.iter().map(|inside| inside.from), newcomer)?,
        };
        Some(self.inside.remove(place).away)
    }

    fn may_complain(&mut self) -> bool {
        let now = Instant::now();
        let may = self.complained.is_none_or(|last| now - last >= COMPLAINTS);
        if may {
            self.complained = Some(now);
        }
        may
    }

    /// The connections as a stream, for tonic. A task of its own accepts them; it ends, and
    /// the port is free, when the stream is dropped.
    pub fn visitors(mut self) -> ReceiverStream<io::Result<Visitor>> {
        let (visitors, stream) = mpsc::channel(1);
        tokio::spawn(async move {
            while let Ok(room) = visitors.reserve().await {
                tokio::select! {
                    (visitor, _) = self.accept() => room.send(Ok(visitor)),
                    () = visitors.closed() => return,
                }
            }
        });
        ReceiverStream::new(stream)
    }
}

/// Connections for one of up to three listeners, of the files that may be open.
fn most(files: Option<u64>) -> usize {
    let spare = files.unwrap_or(u64::MAX).saturating_sub(OTHER_FILES);
    (spare / 3).clamp(FEWEST, MOST) as usize
}

impl Door {
    /// The port that it listens on; 0 where that cannot be told.
    pub fn port(&self) -> u16 {
        self.listener.local_addr().map_or(0, |address| address.port())
    }
}

impl axum::serve::Listener for Door {
    type Io = Visitor;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Visitor, SocketAddr) {
        Self::accept(self).await
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// A connection with its place; reading and writing fail once it has been quiet too long.
#[derive(Debug)]
pub struct Visitor {
    line: Line,
    address: SocketAddr,
    until: Pin<Box<Sleep>>,
    /// It has said something; the door wants to know, too.
    spoke: Arc<AtomicBool>,
    /// Ready when its place is wanted for another; `None` when nobody can want it any more.
    leave: Option<oneshot::Receiver<()>>,
    _place: OwnedSemaphorePermit,
}

impl Visitor {
    fn new(
        line: Line,
        address: SocketAddr,
        place: OwnedSemaphorePermit,
        (spoke, leave): (Arc<AtomicBool>, oneshot::Receiver<()>),
    ) -> Self {
        let until = Box::pin(tokio::time::sleep(FIRST_WORDS));
        Self { line, address, until, spoke, leave: Some(leave), _place: place }
    }

    fn spoke(&self) -> bool {
        self.spoke.load(Ordering::Relaxed)
    }

    fn extend(&mut self) {
        self.until.as_mut().reset(Instant::now() + QUIET);
    }

    /// Instead of waiting on: an error when its time is over.
    fn wait<T>(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<T>> {
        if self.is_wanted(cx) || self.until.as_mut().poll(cx).is_ready() {
            let quiet = io::Error::new(io::ErrorKind::TimedOut, "quiet for too long");
            return Poll::Ready(Err(quiet));
        }
        Poll::Pending
    }

    /// Whether its place is; once it is, it stays so.
    fn is_wanted(&mut self, cx: &mut Context<'_>) -> bool {
        let Some(leave) = &mut self.leave else { return false };
        match Pin::new(leave).poll(cx) {
            Poll::Pending => false,
            Poll::Ready(wanted) => {
                self.leave = None;
                if wanted.is_ok() {
                    self.until.as_mut().reset(Instant::now());
                }
                wanted.is_ok()
            }
        }
    }

    fn written(
        &mut self,
        cx: &mut Context<'_>,
        written: Poll<io::Result<usize>>,
    ) -> Poll<io::Result<usize>> {
        match written {
            Poll::Pending => self.wait(cx),
            Poll::Ready(Ok(_)) if self.spoke() => {
                self.extend();
                written
            }
            Poll::Ready(_) => written,
        }
    }
}

impl AsyncRead for Visitor {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let read = Pin::new(&mut self.line).poll_read(cx, buffer);
        if read.is_pending() {
            return self.wait(cx);
        }
        if buffer.filled().len() > before && !self.spoke.swap(true, Ordering::Relaxed) {
            self.extend();
        }
        read
    }
}

impl AsyncWrite for Visitor {
    fn poll_write(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.line).poll_write(cx, bytes);
        self.written(cx, written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.line).poll_write_vectored(cx, parts);
        self.written(cx, written)
    }

    fn is_write_vectored(&self) -> bool {
        self.line.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let flushed = Pin::new(&mut self.line).poll_flush(cx);
        if flushed.is_pending() { self.wait(cx) } else { flushed }
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let shut = Pin::new(&mut self.line).poll_shutdown(cx);
        if shut.is_pending() { self.wait(cx) } else { shut }
    }
}

/// Where a request comes from.
#[derive(Clone, Copy, Debug)]
pub struct Peer(pub SocketAddr);

impl Connected for Visitor {
    type ConnectInfo = Peer;

    fn connect_info(&self) -> Peer {
        Peer(self.address)
    }
}

impl axum::extract::connect_info::Connected<axum::serve::IncomingStream<'_, Door>> for Peer {
    fn connect_info(stream: axum::serve::IncomingStream<'_, Door>) -> Self {
        Self(*stream.remote_addr())
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::TcpStream;

    use super::*;

    #[test]
    fn few_open_files_leave_few_places_and_never_none() {
        for (files, places) in [(None, 128), (Some(1 << 20), 128), (Some(64), 8), (Some(20), 4)] {
            assert_eq!(most(files), places, "{files:?}");
        }
    }

    fn door(most: usize) -> (Door, SocketAddr) {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let door = Door::with(listener, Security::Plain, most).unwrap();
        let address = door.listener.local_addr().unwrap();
        (door, address)
    }

    fn run(test: impl Future<Output = ()>) {
        tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(test);
    }

    /// From another address of this machine.
    async fn connect_from(from: [u8; 4], to: SocketAddr) -> TcpStream {
        let socket = tokio::net::TcpSocket::new_v4().unwrap();
        socket.bind((from, 0).into()).unwrap();
        socket.connect(to).await.unwrap()
    }

    #[test]
    fn a_newcomer_takes_the_place_of_the_silent_and_waits_for_those_who_speak() {
        run(async {
            let (mut door, address) = door(1);
            let _silent = TcpStream::connect(address).await.unwrap();
            let (mut silent, _) = door.accept().await;
            let silent = tokio::spawn(async move { silent.read_u8().await });
            let mut second = TcpStream::connect(address).await.unwrap();
            let (mut inside, from) = door.accept().await;
            assert_eq!(from, second.local_addr().unwrap());
            let sent_away = silent.await.unwrap().unwrap_err();
            assert_eq!(sent_away.kind(), io::ErrorKind::TimedOut);
            second.write_all(b"x").await.unwrap();
            assert_eq!(inside.read_u8().await.unwrap(), b'x');

            let third = TcpStream::connect(address).await.unwrap();
            let waiting = tokio::spawn(async move { door.accept().await.1 });
            tokio::time::sleep(Duration::from_millis(50)).await;
            assert!(!waiting.is_finished(), "the second has spoken");
            drop(inside);
            assert_eq!(waiting.await.unwrap(), third.local_addr().unwrap());
        });
    }

    #[test]
    fn who_holds_most_places_gives_one_to_a_newcomer_from_elsewhere() {
        run(async {
            let (mut door, address) = door(3);
            let mut held = Vec::new();
            for _ in 0..3 {
                let mut outside = connect_from([127, 0, 0, 2], address).await;
                let (mut inside, _) = door.accept().await;
                outside.write_all(b"x").await.unwrap();
                inside.read_u8().await.unwrap();
                held.push((outside, tokio::spawn(async move { inside.read_u8().await })));
            }
            let mut another = connect_from([127, 0, 0, 3], address).await;
            let (mut inside, from) = door.accept().await;
            assert_eq!(from, another.local_addr().unwrap());
            let (_, oldest) = held.remove(0);
            assert_eq!(oldest.await.unwrap().unwrap_err().kind(), io::ErrorKind::TimedOut);
            assert!(held.iter().all(|(_, task)| !task.is_finished()));
            another.write_all(b"x").await.unwrap();
            assert_eq!(inside.read_u8().await.unwrap(), b'x');
        });
    }

    #[test]
    fn whoever_is_inside_stays_where_the_door_is_gone() {
        run(async {
            let (mut door, address) = door(1);
            let mut outside = TcpStream::connect(address).await.unwrap();
            let (mut inside, _) = door.accept().await;
            drop(door);
            let reading = tokio::spawn(async move {
                let first = inside.read_u8().await;
                (first, inside.read_u8().await)
            });
            tokio::time::sleep(Duration::from_millis(20)).await;
            outside.write_all(b"xy").await.unwrap();
            let (first, second) = reading.await.unwrap();
            assert_eq!((first.unwrap(), second.unwrap()), (b'x', b'y'));
        });
    }
}
