//! The real-time stream from a client's side: State in, Commands out.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use quinn::crypto::rustls::QuicClientConfig;
use quinn::{Connection, Endpoint, RecvStream, SendStream};
use tokio::time::{Interval, MissedTickBehavior};

use super::verify::ByFingerprint;
use super::{ClientError, ConnectString};
use crate::proto::stream_message::Body as Message;
use crate::proto::{
    Bye, ByeReason, Command, Contact, Contacts, Event, Hello, Ping, Pong, Role, State,
    StreamMessage, Welcome, command, datagram::Body,
};
use crate::quic;
use crate::wire::{self, FrameDecoder, PROTOCOL, encode_frame};

/// Pings of a client: often enough for a fresh figure, too few to matter.
const PING_INTERVAL: Duration = Duration::from_millis(100);

/// TLS alert 49, `access_denied` (RFC 8446, section 6): a certificate that the application
/// does not accept.
const ACCESS_DENIED_ALERT: u8 = 49;

/// How a session is asked for.
#[derive(Clone, Debug)]
pub struct Options {
    /// Shown in lists and refusals.
    pub client_name: String,
    /// Observer or controller.
    pub role: Role,
    /// `devices/NAME`; empty where the server has one device.
    pub device: String,
    /// How often commands will be sent.
    pub command_interval: Duration,
    /// How often State is wanted; zero: every tick.
    pub state_interval: Duration,
}

impl Options {
    /// Every tick's State, and commands as often.
    pub fn new(client_name: impl Into<String>, role: Role) -> Self {
        Self {
            client_name: client_name.into(),
            role,
            device: String::new(),
            command_interval: Duration::from_millis(1),
            state_interval: Duration::ZERO,
        }
    }

    fn hello(&self) -> Hello {
        let us = |duration: Duration| u32::try_from(duration.as_micros()).unwrap_or(u32::MAX);
        Hello {
            versions: vec![PROTOCOL.to_owned()],
            client_name: self.client_name.clone(),
            device: self.device.clone(),
            role: self.role.into(),
            command_interval_us: us(self.command_interval),
            state_interval_us: us(self.state_interval),
            max_datagram_bytes: 0,
        }
    }
}

/// Something that came from the server.
#[derive(Clone, Debug, PartialEq)]
pub enum Incoming {
    /// A tick's State.
    State(Box<State>),
    /// Something happened.
    Event(Event),
    /// A Ping came back; the time it took.
    RoundTrip(Duration),
}

/// An open session.
#[derive(Debug)]
pub struct Client {
    connection: Connection,
    // Drives the connection; its socket closes when it goes.
    endpoint: Endpoint,
    send: SendStream,
    receive: RecvStream,
    frames: FrameDecoder,
    /// Bytes read and not yet decoded.
    chunk: bytes::Bytes,
    welcome: Welcome,
    ping: Interval,
    started: Instant,
    command_seq: u64,
    ping_seq: u64,
}

impl Client {
    /// Connects, says Hello and waits for the server's answer.
    pub async fn connect(target: &ConnectString, options: Options) -> Result<Self, ClientError> {
        let address = resolve(target).await?;
        let endpoint = endpoint(target, address)?;
        let connecting = endpoint
            .connect(address, "hapticd")
            .map_err(|source| ClientError::Address { address, source })?;
        let connection = connecting.await.map_err(|source| connect_error(address, source))?;
        let (mut send, mut receive) = connection.open_bi().await?;
        let hello = StreamMessage { body: Some(Message::Hello(options.hello())) };
        send.write_all(&encode_frame(&hello)).await?;
        let mut frames = FrameDecoder::default();
        let mut chunk = bytes::Bytes::new();
        let welcome = match next_message(&mut receive, &mut frames, &mut chunk).await? {
            Message::Welcome(welcome) => welcome,
            Message::Bye(bye) => return Err(said(&bye)),
            Message::Hello(_) | Message::Event(_) => return Err(ClientError::NoWelcome),
        };
        let mut ping = tokio::time::interval(PING_INTERVAL);
        ping.set_missed_tick_behavior(MissedTickBehavior::Delay);
        Ok(Self {
            connection,
            endpoint,
            send,
            receive,
            frames,
            chunk,
            welcome,
            ping,
            started: Instant::now(),
            command_seq: 0,
            ping_seq: 0,
        })
    }

    /// What the server answered.
    pub fn welcome(&self) -> &Welcome {
        &self.welcome
    }

    /// The next thing from the server. Answers and sends pings on the way, so it wants to be
    /// called all the time. Cancel safe.
    pub async fn next(&mut self) -> Result<Incoming, ClientError> {
        loop {
            tokio::select! {
                biased;
                datagram = self.connection.read_datagram() => {
                    if let Some(incoming) = self.on_datagram(&datagram?)? {
                        return Ok(incoming);
                    }
                }
                message = next_message(&mut self.receive, &mut self.frames, &mut self.chunk) => {
                    match message? {
                        Message::Event(event) => return Ok(Incoming::Event(event)),
                        Message::Bye(bye) => return Err(said(&bye)),
                        // A server that repeats itself does no harm.
                        Message::Hello(_) | Message::Welcome(_) => {}
                    }
                }
                _ = self.ping.tick() => self.send_ping()?,
            }
        }
    }

    /// Sends local models computed from State `state_seq`; they hold for `ttl_ms` (0: the
    /// server's default). Returns the command's number.
    pub fn send_contacts(
        &mut self,
        state_seq: u64,
        ttl_ms: u32,
        contacts: Vec<Contact>,
    ) -> Result<u64, ClientError> {
        self.command_seq += 1;
        let command = Command {
            seq: self.command_seq,
            client_time_ns: self.now_ns(),
            state_seq,
            ttl_ms,
            body: Some(command::Body::Contacts(Contacts { contacts })),
        };
        self.send(&Body::Command(command))?;
        Ok(self.command_seq)
    }

    /// This client's clock, as it stands in `Command.client_time_ns`.
    pub fn now_ns(&self) -> u64 {
        u64::try_from(self.started.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    /// Says Bye and waits until the server has it.
    pub async fn close(mut self) {
        let bye = Bye { reason: ByeReason::Done.into(), detail: String::new() };
        let bye = StreamMessage { body: Some(Message::Bye(bye)) };
        // A server that is gone already needs no farewell.
        let _ = self.send.write_all(&encode_frame(&bye)).await;
        let _ = self.send.finish();
        let _ = tokio::time::timeout(Duration::from_millis(500), self.connection.closed()).await;
        self.connection.close(0u32.into(), b"done");
        let _ = tokio::time::timeout(Duration::from_millis(500), self.endpoint.wait_idle()).await;
    }

    fn on_datagram(&mut self, bytes: &[u8]) -> Result<Option<Incoming>, ClientError> {
        match wire::decode(bytes) {
            Ok(Body::State(state)) => Ok(Some(Incoming::State(Box::new(state)))),
            Ok(Body::Ping(ping)) => {
                let now_ns = self.now_ns();
                let Ping { seq, sent_ns } = ping;
                self.send(&Body::Pong(Pong {
                    seq,
                    sent_ns,
                    received_ns: now_ns,
                    returned_ns: now_ns,
                }))?;
                Ok(None)
            }
            Ok(Body::Pong(pong)) => {
                let round_trip_ns = self.now_ns().saturating_sub(pong.sent_ns);
                Ok(Some(Incoming::RoundTrip(Duration::from_nanos(round_trip_ns))))
            }
            // The newest wins: what cannot be read is as good as lost.
            Ok(Body::Command(_)) | Err(_) => Ok(None),
        }
    }

    /// Sends a Ping now; its round trip comes from [`Client::next`].
    pub fn send_ping(&mut self) -> Result<(), ClientError> {
        self.ping_seq += 1;
        let ping = Ping { seq: self.ping_seq, sent_ns: self.now_ns() };
        self.send(&Body::Ping(ping))
    }

    fn send(&self, body: &Body) -> Result<(), ClientError> {
        match self.connection.send_datagram(wire::encode(body).into()) {
            Err(quinn::SendDatagramError::ConnectionLost(error)) => Err(error.into()),
            other => Ok(other?),
        }
    }
}

fn said(bye: &Bye) -> ClientError {
    ClientError::Bye { reason: bye.reason(), detail: bye.detail.clone() }
}

/// The verifier's refusal comes back as a transport error of its certificate alert.
fn connect_error(address: SocketAddr, source: quinn::ConnectionError) -> ClientError {
    let refused = quinn::TransportErrorCode::crypto(ACCESS_DENIED_ALERT);
    match &source {
        quinn::ConnectionError::TransportError(error) if error.code == refused => {
            ClientError::WrongServer { address }
        }
        _ => ClientError::Connect { address, source },
    }
}

async fn resolve(target: &ConnectString) -> Result<SocketAddr, ClientError> {
    let host = || target.host.clone();
    if target.sha256.is_none() && !target.is_loopback() {
        return Err(ClientError::HashNeeded { host: host() });
    }
    let mut found = tokio::net::lookup_host((target.host.as_str(), target.stream_port))
        .await
        .map_err(|source| ClientError::Resolve { host: host(), source })?;
    let missing = || std::io::Error::new(std::io::ErrorKind::NotFound, "it has no address");
    found.next().ok_or_else(|| ClientError::Resolve { host: host(), source: missing() })
}

fn endpoint(target: &ConnectString, address: SocketAddr) -> Result<Endpoint, ClientError> {
    let provider = quic::provider();
    let verifier = ByFingerprint { sha256: target.sha256, provider: Arc::clone(&provider) };
    let mut tls = rustls::ClientConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .dangerous() // the hash decides, not a chain of signatures
        .with_custom_certificate_verifier(Arc::new(verifier))
        .with_no_client_auth();
    tls.alpn_protocols = vec![quic::alpn()];
    let tls = QuicClientConfig::try_from(tls)
        .map_err(|error| ClientError::Tls(rustls::Error::General(error.to_string())))?;
    let mut config = quinn::ClientConfig::new(Arc::new(tls));
    config.transport_config(quic::client_transport());
    let any: SocketAddr =
        if address.is_ipv4() { ([0, 0, 0, 0], 0).into() } else { ([0u16; 8], 0).into() };
    let mut endpoint = Endpoint::client(any).map_err(ClientError::Socket)?;
    endpoint.set_default_client_config(config);
    Ok(endpoint)
}

/// The next whole message of the reliable stream. Cancel safe: what was read is kept.
async fn next_message(
    receive: &mut RecvStream,
    frames: &mut FrameDecoder,
    chunk: &mut bytes::Bytes,
) -> Result<Message, ClientError> {
    loop {
        let mut rest: &[u8] = chunk;
        let message = frames.next(&mut rest)?;
        let used = chunk.len() - rest.len();
        let _ = chunk.split_to(used);
        if let Some(body) = message.and_then(|message| message.body) {
            return Ok(body);
        }
        if !chunk.is_empty() {
            continue;
        }
        match receive.read_chunk(64 * 1024, true).await {
            Ok(Some(read)) => *chunk = read.bytes,
            Ok(None) => return Err(ClientError::Lost(quinn::ConnectionError::LocallyClosed)),
            Err(quinn::ReadError::ConnectionLost(error)) => return Err(error.into()),
            Err(_) => return Err(ClientError::NoWelcome),
        }
    }
}
