//! A TCP listener with a bounded number of visitors, none of which may be silent for long.
//! A TLS handshake is among what has to be done in that time.
//!
//! Whoever connects and says nothing, speaks one byte a minute, or takes no answer costs a
//! place for seconds, not for ever: a visitor has [`FIRST_WORDS`] to begin and [`QUIET`]
//! from one answer to the next. Keeping alive what is idle is the business of the protocol
//! above (HTTP/2 pings are answers, too). Where places run out, somebody gives way
//! ([`gives_way`]) or the newcomer is sent away: nobody waits at the door. Where file descriptors
//! run out, the listener sleeps; it never spins.

use std::io;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use rustix::process::{Resource, getrlimit};
use tokio::net::TcpListener;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};
use tokio::time::{Instant, timeout};

use super::line::{Line, Security};
use super::neighbours::{Holder, gives_way};
use super::visit::{Presence, Visit};

/// Most connections at a time: more than people, dashboards and scripts of one laboratory.
const MOST: u64 = 128;

/// Fewest, however few files this process may have open.
const FEWEST: u64 = 4;

/// Files that the rest of the daemon needs: sockets, timers, the scene on its way to disk.
const OTHER_FILES: u64 = 40;

/// Time for the first byte.
pub(super) const FIRST_WORDS: Duration = Duration::from_secs(3);

/// Time from one answer to the next; twice what a scraper usually waits between two looks.
pub(super) const QUIET: Duration = Duration::from_secs(30);

/// Time for one who is sent away to be gone.
const GOING: Duration = Duration::from_secs(1);

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
    presence: Arc<Presence>,
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

    /// The port that it listens on; 0 where that cannot be told.
    pub fn port(&self) -> u16 {
        self.listener.local_addr().map_or(0, |address| address.port())
    }

    /// The next visitor for whom there is a place.
    pub(super) async fn accept(&mut self) -> Visit {
        loop {
            match self.listener.accept().await {
                Ok((stream, address)) => {
                    let Some(place) = self.place(address.ip()).await else {
                        self.complain(|| {
                            tracing::warn!(%address, "every connection is in use, this one is sent away");
                        });
                        continue;
                    };
                    let presence = Arc::new(Presence::new());
                    let (away, leave) = oneshot::channel();
                    let (from, known) = (address.ip(), Arc::clone(&presence));
                    self.inside.push(Inside { from, presence: known, away });
                    // Answers are small; one that waits to be joined by another only comes late.
                    let _ = stream.set_nodelay(true);
                    let line = Line::new(stream, &self.security);
                    return Visit { line, address, presence, leave, place };
                }
                // That client has gone again.
                Err(error) if error.kind() == io::ErrorKind::ConnectionAborted => {}
                Err(error) => {
                    self.complain(|| tracing::warn!(%error, "cannot accept a connection"));
                    tokio::time::sleep(RECOVERY).await;
                }
            }
        }
    }

    async fn place(&mut self, newcomer: IpAddr) -> Option<OwnedSemaphorePermit> {
        self.inside.retain(|inside| !inside.away.is_closed());
        if let Ok(place) = Arc::clone(&self.places).try_acquire_owned() {
            return Some(place);
        }
        let holder = |inside: &Inside| {
            let (from, silent) = (inside.from, !inside.presence.has_spoken());
            Holder { from, silent }
        };
        let holders: Vec<_> = self.inside.iter().map(holder).collect();
        let gives_way = self.inside.remove(gives_way(&holders, newcomer)?);
        // Gone already is as good.
        let _ = gives_way.away.send(());
        timeout(GOING, Arc::clone(&self.places).acquire_owned()).await.ok()?.ok()
    }

    fn complain(&mut self, tell: impl FnOnce()) {
        let now = Instant::now();
        if self.complained.is_none_or(|last| now - last >= COMPLAINTS) {
            self.complained = Some(now);
            tell();
        }
    }
}

/// Connections for one of up to three listeners, of the files that may be open.
fn most(files: Option<u64>) -> usize {
    let spare = files.unwrap_or(u64::MAX).saturating_sub(OTHER_FILES);
    (spare / 3).clamp(FEWEST, MOST) as usize
}

#[cfg(test)]
mod tests {
    use std::net::SocketAddr;

    use axum::Router;
    use axum::routing::get;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::{TcpSocket, TcpStream};
    use tokio::sync::watch;

    use super::super::visit::{Speaks, receive};
    use super::*;

    /// A server with so many places, and where it is.
    fn serve(most: usize) -> (SocketAddr, watch::Sender<bool>) {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let door = Door::with(listener, Security::Plain, most).unwrap();
        let (stop, stopped) = watch::channel(false);
        let router = Router::new().route("/", get(|| async { "here" })).route(
            "/never",
            get(|| async {
                let never = tokio_stream::pending::<Result<String, io::Error>>();
                axum::body::Body::from_stream(never)
            }),
        );
        tokio::spawn(receive(door, Speaks::Either, router, stopped));
        (address, stop)
    }

    fn run(test: impl Future<Output = ()>) {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let bounded = async { timeout(Duration::from_secs(20), test).await };
        runtime.block_on(bounded).expect("it does not happen");
    }

    /// From one of the addresses of this machine.
    async fn come(from: u8, to: SocketAddr) -> TcpStream {
        let socket = TcpSocket::new_v4().unwrap();
        socket.bind(([127, 0, 0, from], 0).into()).unwrap();
        socket.connect(to).await.unwrap()
    }

    async fn ask(stream: &mut TcpStream, path: &str) -> bool {
        let request = format!("GET {path} HTTP/1.1\r\nHost: x\r\n\r\n");
        let mut answer = Vec::new();
        let whole = |answer: &[u8]| match path {
            "/" => answer.ends_with(b"here"),
            _ => answer.ends_with(b"\r\n\r\n"),
        };
        if stream.write_all(request.as_bytes()).await.is_err() {
            return false;
        }
        while !whole(&answer) {
            if !matches!(stream.read_buf(&mut answer).await, Ok(1..)) {
                return false;
            }
        }
        answer.starts_with(b"HTTP/1.1 200")
    }

    /// So many of one address, each of which was answered.
    async fn hold(count: usize, to: SocketAddr, path: &str) -> Vec<TcpStream> {
        let mut held = Vec::new();
        for _ in 0..count {
            let mut stream = come(2, to).await;
            assert!(ask(&mut stream, path).await);
            held.push(stream);
        }
        held
    }

    async fn is_gone(stream: &mut TcpStream) -> bool {
        let mut rest = Vec::new();
        timeout(Duration::from_millis(500), stream.read_to_end(&mut rest)).await.is_ok()
    }

    #[test]
    fn few_open_files_leave_few_places_and_never_none() {
        for (files, places) in [(None, 128), (Some(1 << 20), 128), (Some(64), 8), (Some(20), 4)] {
            assert_eq!(most(files), places, "{files:?}");
        }
    }

    #[test]
    fn a_newcomer_takes_the_place_of_a_silent_neighbour_and_not_of_one_who_speaks() {
        run(async {
            let (address, _stop) = serve(1);
            let mut silent = come(1, address).await;
            let mut second = come(1, address).await;
            assert!(ask(&mut second, "/").await);
            assert!(is_gone(&mut silent).await);
            let mut third = come(1, address).await;
            assert!(!ask(&mut third, "/").await, "nobody waits at the door");
            assert!(ask(&mut second, "/").await);
        });
    }

    #[test]
    fn who_holds_most_places_gives_them_to_others_even_while_it_asks_for_more() {
        run(async {
            let (address, _stop) = serve(3);
            let mut held = hold(3, address, "/").await;
            let _waiting = come(2, address).await;
            let mut another = come(3, address).await;
            assert!(ask(&mut another, "/").await);
            assert!(is_gone(&mut held[0]).await && !is_gone(&mut held[2]).await);
            let mut more = come(2, address).await;
            assert!(!ask(&mut more, "/").await);
            assert!(ask(&mut another, "/").await, "it stays");
        });
    }

    /// While an answer is on its way, HTTP/1 does not look at what comes.
    #[test]
    fn who_is_in_the_middle_of_an_answer_gives_way_too() {
        run(async {
            let (address, _stop) = serve(2);
            let mut held = hold(2, address, "/never").await;
            for stream in &mut held {
                stream.write_all(b"x").await.unwrap();
            }
            let mut another = come(3, address).await;
            assert!(ask(&mut another, "/").await);
            assert!(is_gone(&mut held[0]).await);
        });
    }

    #[test]
    fn a_server_that_ends_answers_and_sends_away_who_says_nothing() {
        run(async {
            let (address, stop) = serve(2);
            let mut silent = come(1, address).await;
            let mut other = come(1, address).await;
            assert!(ask(&mut other, "/").await);
            stop.send_replace(true);
            assert!(is_gone(&mut other).await && is_gone(&mut silent).await);
            tokio::time::sleep(Duration::from_millis(50)).await;
            assert!(TcpStream::connect(address).await.is_err(), "the port is free");
        });
    }
}
