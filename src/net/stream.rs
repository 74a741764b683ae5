//! The stream thread: QUIC connections in and out of the devices' sessions.
//!
//! One thread, one runtime, no lock: connections, the doorbells of the real-time threads and
//! the timer are tasks that take turns on the same [`Hub`]. A datagram becomes a setpoint, and
//! a report becomes datagrams, without waiting for anything else.

use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::OwnedFd;
use std::rc::Rc;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use quinn::crypto::rustls::QuicServerConfig;
use quinn::{Connection, Endpoint, EndpointConfig, Incoming, ServerConfig, VarInt};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;
use tokio::sync::{mpsc, oneshot};

use super::Identity;
use super::calls::SessionCalls;
use super::hub::{Hub, Peer, StreamDevice};
use crate::clock::now_ns;
use crate::proto::StreamMessage;
use crate::quic;
use crate::session::{SessionId, Transport};
use crate::wire::{FrameDecoder, encode_frame};

/// Messages that may wait on a reliable stream; a client that reads nothing loses it.
const WAITING_MESSAGES: usize = 256;

/// Time for a message to be taken by a client that is slow to read.
const PATIENCE: Duration = Duration::from_secs(1);

/// Between two looks at what was refused: a log line, at most, for each session.
const REFUSALS: Duration = Duration::from_secs(1);

/// Time for a Bye to reach its client before the connection is closed.
const FAREWELL: Duration = Duration::from_millis(250);

/// The timer's pace: pings are due every 100 ms, silence is judged in seconds.
const TIMER: Duration = Duration::from_millis(10);

/// Everything the thread is given.
pub struct StreamParts {
    /// Bound already, so that a port in use is known at once.
    pub socket: UdpSocket,
    /// The server's certificate.
    pub identity: Identity,
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
    let config = server_config(&parts.identity, 1e9 / fastest_ns.unwrap_or(u64::MAX) as f64)?;
    let address = parts.socket.local_addr()?;
    parts.socket.set_nonblocking(true)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let (shutdown, stopped) = oneshot::channel();
    let thread = std::thread::Builder::new().name("hapticd-stream".into()).spawn(move || {
        (parts.on_start)();
        let local = tokio::task::LocalSet::new();
        local.block_on(&runtime, serve(parts, config, stopped))
    })?;
    Ok(StreamHandle { address, shutdown: Some(shutdown), thread: Some(thread) })
}

fn server_config(identity: &Identity, states_per_s: f64) -> Result<ServerConfig, StreamError> {
    let chain = vec![identity.certificate.clone()];
    let mut tls = rustls::ServerConfig::builder_with_provider(quic::provider())
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .with_no_client_auth()
        .with_single_cert(chain, identity.key.clone_key())?;
    tls.alpn_protocols = vec![quic::alpn()];
    let tls = QuicServerConfig::try_from(tls)
        .map_err(|error| rustls::Error::General(error.to_string()))?;
    let mut config = ServerConfig::with_crypto(Arc::new(tls));
    config.transport_config(quic::server_transport(states_per_s));
    Ok(config)
}

type Shared = Rc<RefCell<Hub>>;

async fn serve(parts: StreamParts, config: ServerConfig, stopped: oneshot::Receiver<()>) {
    let (hub, doorbells) = Hub::new(parts.devices);
    let hub = Rc::new(RefCell::new(hub));
    let runtime = Arc::new(quinn::TokioRuntime);
    match Endpoint::new(EndpointConfig::default(), Some(config), parts.socket, runtime) {
        Ok(endpoint) => {
            for (device, doorbell) in doorbells.into_iter().enumerate() {
                tokio::task::spawn_local(hear_doorbell(Rc::clone(&hub), device, doorbell));
            }
            tokio::task::spawn_local(keep_time(Rc::clone(&hub)));
            tokio::task::spawn_local(answer_calls(Rc::clone(&hub), parts.calls));
            tokio::task::spawn_local(tell_refusals(Rc::clone(&hub)));
            tokio::select! {
                () = accept(&endpoint, &hub) => {}
                _ = stopped => {}
            }
            end(&endpoint, &hub).await;
        }
        Err(error) => tracing::error!(%error, "the stream cannot be served"),
    }
}

async fn accept(endpoint: &Endpoint, hub: &Shared) {
    while let Some(incoming) = endpoint.accept().await {
        tokio::task::spawn_local(attend(Rc::clone(hub), incoming));
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
    let _ = tokio::time::timeout(2 * FAREWELL, endpoint.wait_idle()).await;
    endpoint.close(VarInt::from_u32(0), b"shutdown");
    let _ = tokio::time::timeout(FAREWELL, endpoint.wait_idle()).await;
}

/// One client from handshake to farewell.
async fn attend(hub: Shared, incoming: Incoming) {
    let Ok(connection) = incoming.await else { return };
    let connected = hub.borrow_mut().sessions.connect(Transport::Quic, now_ns());
    let id = match connected {
        Ok(id) => id,
        Err(full) => return refuse(&connection, &full.bye()).await,
    };
    let (messages, outgoing) = mpsc::channel(WAITING_MESSAGES);
    let peer = Peer { connection: connection.clone(), messages };
    hub.borrow_mut().peers.insert(id, peer);
    tracing::debug!(session = %id, address = %connection.remote_address(), "connected");
    // It may come to join a session that waits for it.
    let id = &Cell::new(id);
    tokio::select! {
        () = hear_datagrams(&hub, id, &connection) => {}
        () = converse(&hub, id, &connection, outgoing) => {}
    }
    let (mut hub, id) = (hub.borrow_mut(), id.get());
    hub.peers.remove(&id);
    hub.sessions.disconnect(id, now_ns());
    hub.act();
    tracing::debug!(session = %id, "gone");
}

/// Tells a client for whom there is no room.
async fn refuse(connection: &Connection, bye: &StreamMessage) {
    let farewell = async {
        if let Ok((mut send, _)) = connection.accept_bi().await {
            let _ = send.write_all(&encode_frame(bye)).await;
            let _ = send.finish();
            let _ = send.stopped().await;
        }
    };
    let _ = tokio::time::timeout(FAREWELL, farewell).await;
    connection.close(VarInt::from_u32(1), b"too many sessions");
}

async fn hear_datagrams(hub: &Shared, id: &Cell<SessionId>, connection: &Connection) {
    while let Ok(bytes) = connection.read_datagram().await {
        let mut hub = hub.borrow_mut();
        hub.sessions.on_datagram(id.get(), &bytes, now_ns());
        hub.act();
    }
}

/// The reliable stream, both ways; ends when the client is to be left.
async fn converse(
    hub: &Shared,
    id: &Cell<SessionId>,
    connection: &Connection,
    mut outgoing: mpsc::Receiver<Vec<u8>>,
) {
    let opened = tokio::select! {
        opened = connection.accept_bi() => opened,
        // Over before it began: there is no stream to say Bye on.
        () = drained(&mut outgoing) => return connection.close(VarInt::from_u32(3), b"no Hello"),
    };
    let Ok((mut send, mut receive)) = opened else { return };
    let reading = async {
        let mut frames = FrameDecoder::default();
        while let Ok(Some(chunk)) = receive.read_chunk(16 * 1024, true).await {
            let mut bytes: &[u8] = &chunk.bytes;
            let mut hub = hub.borrow_mut();
            loop {
                match frames.next(&mut bytes) {
                    Ok(Some(message)) => id.set(hub.on_message(id.get(), message)),
                    Ok(None) => break,
                    Err(error) => {
                        hub.sessions.on_broken_stream(id.get(), error, now_ns());
                        break;
                    }
                }
            }
            hub.act();
        }
        // The client has closed its side; the session lives on by datagrams until it is
        // silent or says Bye.
        std::future::pending::<()>().await;
    };
    let writing = async {
        while let Some(bytes) = outgoing.recv().await {
            // A client that takes nothing would hold its connection open for ever.
            let written = tokio::time::timeout(PATIENCE, send.write_all(&bytes)).await;
            if !matches!(written, Ok(Ok(()))) {
                return connection.close(VarInt::from_u32(2), b"you do not read");
            }
        }
        // No more to say: the session is over, its Bye is written.
        let _ = send.finish();
        let _ = tokio::time::timeout(FAREWELL, send.stopped()).await;
        connection.close(VarInt::from_u32(0), b"bye");
    };
    tokio::select! {
        () = reading => {}
        () = writing => {}
    }
}

/// Done when the session wants nothing said any more, because it has ended.
async fn drained(outgoing: &mut mpsc::Receiver<Vec<u8>>) {
    while outgoing.recv().await.is_some() {}
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
        hub.publish();
    }
}

/// The services ask about sessions; an answer takes microseconds.
async fn answer_calls(hub: Shared, mut calls: SessionCalls) {
    while let Some(call) = calls.next().await {
        {
            let mut hub = hub.borrow_mut();
            call(&mut hub.sessions, now_ns());
            hub.act();
        }
        // Datagrams and ticks first, however many calls wait.
        tokio::task::yield_now().await;
    }
}

/// Datagrams are never answered, so whoever writes a client finds in the log what is wrong
/// with its commands.
async fn tell_refusals(hub: Shared) {
    let mut told: HashMap<SessionId, String> = HashMap::new();
    loop {
        tokio::time::sleep(REFUSALS).await;
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
