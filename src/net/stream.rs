//! The stream thread: clients in and out of the devices' sessions.
//!
//! One thread, one runtime, no lock: connections on the QUIC port, the socket of sealed UDP, the
//! doorbells of the real-time threads and the timer are tasks that take turns on the same
//! [`Hub`]. A datagram becomes a setpoint, and
//! a report becomes datagrams, without waiting for anything else.

use std::cell::RefCell;
use std::collections::HashMap;
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::OwnedFd;
use std::rc::Rc;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use quinn::crypto::rustls::QuicServerConfig;
use quinn::{Endpoint, EndpointConfig, ServerConfig, VarInt};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;
use tokio::sync::oneshot;

use super::browser::{BrowserIdentity, ByProtocol};
use super::calls::SessionCalls;
use super::connection::{FAREWELL, attend};
use super::handshakes::{Admitted, Handshakes, Verdict};
use super::hub::{Hub, Shared, StreamDevice};
use super::sealed_udp::{self, SealedUdp};
use super::{Access, Gate, Identity};
use crate::clock::now_ns;
use crate::quic;
use crate::sealed::Secret;
use crate::session::SessionId;
use crate::telemetry::TurnedAway;

/// Between two looks at each session: at what was refused, for a log line at most, and at
/// whether its credential still counts.
const LOOKS: Duration = Duration::from_secs(1);

/// Time for a handshake, on a path that loses half of everything too.
const HANDSHAKE: Duration = Duration::from_secs(10);

/// The timer's pace: pings are due every 100 ms, silence is judged in seconds.
const TIMER: Duration = Duration::from_millis(10);

/// Everything the thread is given.
pub struct StreamParts {
    /// QUIC and WebTransport. Bound already, so that a port in use is known at once.
    pub socket: UdpSocket,
    /// Sealed UDP.
    pub sealed: UdpSocket,
    /// The server's certificate.
    pub identity: Identity,
    /// Those that browsers take.
    pub browser: Arc<BrowserIdentity>,
    /// Whose pages may come.
    pub access: Access,
    /// Who may come.
    pub gate: Arc<Gate>,
    /// What is served; at least one.
    pub devices: Vec<StreamDevice>,
    /// Where calls come from.
    pub calls: SessionCalls,
    /// Run first by the new thread: to raise its priority.
    pub on_start: Box<dyn Fn() + Send>,
}

/// Why the stream cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum StreamError {
    /// The certificate does not fit.
    #[error("cannot set up TLS for the stream: {0}")]
    Tls(#[from] rustls::Error),
    /// No thread or runtime.
    #[error("cannot start the stream thread: {0}")]
    Start(#[from] io::Error),
}

/// The running thread.
#[derive(Debug)]
pub struct StreamHandle {
    /// Where it listens.
    pub address: SocketAddr,
    shutdown: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl StreamHandle {
    /// Says Bye to everyone and ends the thread.
    pub fn stop(&mut self) {
        drop(self.shutdown.take());
        if let Some(thread) = self.thread.take() {
            // A panic in there was reported by the panic hook; there is nothing to add.
            let _ = thread.join();
        }
    }
}

impl Drop for StreamHandle {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Starts the thread.
pub fn spawn(parts: StreamParts) -> Result<StreamHandle, StreamError> {
    let fastest_ns = parts.devices.iter().map(|device| device.sessions.tick_ns).min();
    let mut cookies = Secret::default();
    quic::fill_random(&mut cookies).map_err(io::Error::other)?;
    let config = server_config(&parts, 1e9 / fastest_ns.unwrap_or(u64::MAX) as f64)?;
    let address = parts.socket.local_addr()?;
    parts.socket.set_nonblocking(true)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let (shutdown, stopped) = oneshot::channel();
    let thread = std::thread::Builder::new().name("hapticd-stream".into()).spawn(move || {
        (parts.on_start)();
        let local = tokio::task::LocalSet::new();
        local.block_on(&runtime, serve(parts, config, cookies, stopped))
    })?;
    Ok(StreamHandle { address, shutdown: Some(shutdown), thread: Some(thread) })
}

fn server_config(parts: &StreamParts, states_per_s: f64) -> Result<ServerConfig, StreamError> {
    let own = Arc::new(parts.identity.certified()?);
    let resolver = ByProtocol { own, browser: Arc::clone(&parts.browser) };
    let mut tls = rustls::ServerConfig::builder_with_provider(quic::provider())
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .with_no_client_auth()
        .with_cert_resolver(Arc::new(resolver));
    tls.alpn_protocols = vec![quic::alpn(), quic::alpn_webtransport()];
    let tls = QuicServerConfig::try_from(tls)
        .map_err(|error| rustls::Error::General(error.to_string()))?;
    let mut config = ServerConfig::with_crypto(Arc::new(tls));
    config.transport_config(quic::server_transport(states_per_s));
    Ok(config)
}

async fn serve(
    parts: StreamParts,
    config: ServerConfig,
    cookies: Secret,
    stopped: oneshot::Receiver<()>,
) {
    let sealed = match SealedUdp::new(parts.sealed, &cookies) {
        Ok(sealed) => sealed,
        Err(error) => return tracing::error!(%error, "sealed UDP cannot be served"),
    };
    let gate = parts.gate;
    let (hub, doorbells) = Hub::new(parts.devices, sealed, Arc::clone(&gate));
    let hub = Rc::new(RefCell::new(hub));
    let runtime = Arc::new(quinn::TokioRuntime);
    match Endpoint::new(EndpointConfig::default(), Some(config), parts.socket, runtime) {
        Ok(endpoint) => {
            for (device, doorbell) in doorbells.into_iter().enumerate() {
                tokio::task::spawn_local(hear_doorbell(Rc::clone(&hub), device, doorbell));
            }
            tokio::task::spawn_local(sealed_udp::hear(Rc::clone(&hub)));
            tokio::task::spawn_local(keep_time(Rc::clone(&hub)));
            tokio::task::spawn_local(answer_calls(Rc::clone(&hub), parts.calls));
            tokio::task::spawn_local(tell_refusals(Rc::clone(&hub)));
            tokio::task::spawn_local(judge_again(Rc::clone(&hub)));
            tokio::select! {
                () = accept(&endpoint, &hub, parts.access, &gate) => {}
                _ = stopped => {}
            }
            end(&endpoint, &hub).await;
        }
        Err(error) => tracing::error!(%error, "the stream cannot be served"),
    }
}

async fn accept(endpoint: &Endpoint, hub: &Shared, access: Access, gate: &Gate) {
    let access = Rc::new(access);
    let handshakes = Rc::new(RefCell::new(Handshakes::new(now_ns())));
    while let Some(incoming) = endpoint.accept().await {
        let (ip, proven) = (incoming.remote_address().ip(), incoming.remote_address_validated());
        let verdict = handshakes.borrow_mut().judge(ip, proven, now_ns());
        match verdict {
            Verdict::Accept(Admitted { number, gives_way }) => {
                let (hub, access) = (Rc::clone(hub), Rc::clone(&access));
                let handshakes = Rc::clone(&handshakes);
                tokio::task::spawn_local(async move {
                    let connected = tokio::select! {
                        connected = tokio::time::timeout(HANDSHAKE, incoming) => connected,
                        _ = gives_way => return,
                    };
                    handshakes.borrow_mut().ended(number);
                    if let Ok(Ok(connection)) = connected {
                        attend(hub, connection, access).await;
                    }
                });
            }
            Verdict::Retry => {
                gate.count(TurnedAway::HandshakeRetried);
                // One that cannot be asked to try again is not worth a word.
                incoming.retry().unwrap_or_else(|error| error.into_incoming().ignore());
            }
            Verdict::Ignore => {
                gate.count(TurnedAway::HandshakeIgnored);
                incoming.ignore();
            }
        }
    }
}

/// Says Bye to everyone and lets their connections end by themselves, then ends the rest.
async fn end(endpoint: &Endpoint, hub: &Shared) {
    endpoint.set_server_config(None);
    {
        let mut hub = hub.borrow_mut();
        hub.sessions.shutdown(now_ns());
        hub.act();
    }
    let farewell = async {
        endpoint.wait_idle().await;
        while !hub.borrow().sealed.is_idle() {
            tokio::time::sleep(TIMER).await;
        }
    };
    let _ = tokio::time::timeout(2 * FAREWELL, farewell).await;
    endpoint.close(VarInt::from_u32(0), b"shutdown");
    let _ = tokio::time::timeout(FAREWELL, endpoint.wait_idle()).await;
}

/// Every tick of a device becomes State for those who want it.
async fn hear_doorbell(hub: Shared, device: usize, doorbell: OwnedFd) {
    // SAFETY: the OwnedFd is moved in, so the same open descriptor lives as long as the
    // AsyncFd and nobody else can close or replace it.
    #[allow(unsafe_code)]
    let registered = unsafe { AsyncFd::register_with_interest(doorbell, Interest::READABLE) };
    let doorbell = match registered {
        Ok(doorbell) => doorbell,
        Err(error) => return tracing::error!(%error, "cannot wait for the device"),
    };
    while let Ok(mut ready) = doorbell.readable().await {
        let mut count = [0; 8];
        // An eventfd gives its whole count at once; then it would block until the next tick.
        let _ = rustix::io::read(doorbell.get_ref(), &mut count);
        ready.clear_ready();
        let mut hub = hub.borrow_mut();
        hub.hear_reports(device);
        hub.act();
    }
}

async fn keep_time(hub: Shared) {
    let mut interval = tokio::time::interval(TIMER);
    interval.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        interval.tick().await;
        let mut hub = hub.borrow_mut();
        if hub.sessions.next_timeout().is_some_and(|due_ns| due_ns <= now_ns()) {
            hub.sessions.on_timeout(now_ns());
            hub.act();
        }
        hub.sealed.repeat();
        hub.publish();
    }
}

/// The services ask about sessions; an answer takes microseconds.
async fn answer_calls(hub: Shared, mut calls: SessionCalls) {
    while let Some(call) = calls.next().await {
        {
            let mut hub = hub.borrow_mut();
            call(&mut hub, now_ns());
            hub.act();
        }
        // Datagrams and ticks first, however many calls wait.
        tokio::task::yield_now().await;
    }
}

/// Credentials are revoked, and expire.
async fn judge_again(hub: Shared) {
    loop {
        tokio::time::sleep(LOOKS).await;
        let sessions = hub.borrow().guests.sessions();
        for session in sessions {
            hub.borrow_mut().judge_again(session);
            // A judgement takes tens of microseconds; whatever waits has its turn in between.
            tokio::task::yield_now().await;
        }
    }
}

/// Datagrams are never answered, so whoever writes a client finds in the log what is wrong
/// with its commands.
async fn tell_refusals(hub: Shared) {
    let mut told: HashMap<SessionId, String> = HashMap::new();
    loop {
        tokio::time::sleep(LOOKS).await;
        let hub = hub.borrow();
        told.retain(|id, _| hub.peers.contains_key(id));
        for session in hub.sessions.list(now_ns()) {
            let Some(refusal) = session.last_refusal.map(ToString::to_string) else { continue };
            if told.get(&session.id) != Some(&refusal) {
                tracing::warn!(session = %session.id, client = session.client_name, refusal, "commands are refused");
                told.insert(session.id, refusal);
            }
        }
    }
}
