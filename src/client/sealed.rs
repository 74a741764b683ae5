//! A session over sealed UDP: opened by a call, joined by a cookie.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use tokio::net::UdpSocket;
use tokio::time::{Interval, MissedTickBehavior};

use super::carrier::Heard;
use super::services::{services_at, told};
use super::{ClientError, ConnectString};
use crate::proto::{Hello, OpenSessionRequest, StreamMessage, Transport};
use crate::sealed::{Direction, Kind, MAX_PACKET_BYTES, Messages, Opener, Sealer, ends};
use crate::wire::{FrameDecoder, encode_frame};

/// How often it says that it is here until the server streams, and what was not taken again.
const AGAIN: Duration = Duration::from_millis(20);

/// A server that is silent for this long is gone: it pings ten times a second.
const SILENCE: Duration = Duration::from_secs(3);

/// A server that pings ten times a second is not silent for so long, unless it speaks to where
/// this client was.
const QUIET: Duration = Duration::from_millis(300);

/// Datagrams that wait to be asked for, as in QUIC.
const NEWEST: usize = 2;

/// The client's end of an association.
#[derive(Debug)]
pub(super) struct SealedStream {
    socket: UdpSocket,
    server: SocketAddr,
    sealer: Sealer,
    opener: Opener,
    messages: Messages,
    /// What it shows until the server streams, and where it hears nothing any more.
    cookie: Vec<u8>,
    streaming: bool,
    /// What came and was not asked for yet.
    waiting: VecDeque<Heard>,
    again: Interval,
    started: Instant,
    heard: Instant,
    buffer: Box<[u8; MAX_PACKET_BYTES + 1]>,
}

impl SealedStream {
    /// Opens a session by a call and knocks at the port that it names.
    pub async fn open(target: &ConnectString, hello: Hello) -> Result<Self, ClientError> {
        let (mut services, mut server) = services_at(target).await.map_err(Box::new)?;
        // The call has shown it.
        let hello = Hello { token: String::new(), ..hello };
        let transport = Transport::SealedUdp.into();
        let request = OpenSessionRequest { hello: Some(hello), transport };
        let opened = services.sessions.open_session(request).await;
        let opened = opened.map_err(|status| ClientError::Call(told(&status)))?;
        let sealed = opened.into_inner().sealed_udp.ok_or(ClientError::NoWelcome)?;
        let port = u16::try_from(sealed.port).map_err(|_| ClientError::NoWelcome)?;
        let association = sealed.association.try_into().map_err(|_| ClientError::NoWelcome)?;
        let secret = sealed.secret.try_into().map_err(|_| ClientError::NoWelcome)?;
        // Of all addresses that a name may have, it is the one that has answered.
        server.set_port(target.udp_port.unwrap_or(port));
        let any: SocketAddr =
            if server.is_ipv4() { ([0, 0, 0, 0], 0).into() } else { ([0_u16; 8], 0).into() };
        let socket = UdpSocket::bind(any).await.map_err(ClientError::Socket)?;
        socket.connect(server).await.map_err(ClientError::Socket)?;
        let (sealer, opener) = ends(&secret, association, Direction::Up);
        let mut again = tokio::time::interval(AGAIN);
        again.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let now = Instant::now();
        Ok(Self {
            socket,
            server,
            sealer,
            opener,
            messages: Messages::default(),
            cookie: vec![0; 32],
            streaming: false,
            waiting: VecDeque::new(),
            again,
            started: now,
            heard: now,
            buffer: Box::new([0; MAX_PACKET_BYTES + 1]),
        })
    }

    /// The next thing that comes. Cancel safe.
    pub async fn hear(&mut self) -> Result<Heard, ClientError> {
        loop {
            if let Some(heard) = self.waiting.pop_front() {
                return Ok(heard);
            }
            tokio::select! {
                biased;
                ready = self.socket.readable() => {
                    ready.map_err(ClientError::Socket)?;
                    self.drain()?;
                }
                _ = self.again.tick() => self.say_again(),
            }
            if self.heard.elapsed() > SILENCE {
                let silent = format!("{} does not answer (sealed UDP)", self.server);
                return Err(ClientError::Lost(silent));
            }
        }
    }

    /// Takes all that has come, and of datagrams only the newest: a late one is worth less than
    /// a lost one. A port that is closed for a moment says so by an error; only silence ends a
    /// session.
    fn drain(&mut self) -> Result<(), ClientError> {
        while let Ok(length) = self.socket.try_recv(&mut self.buffer[..]) {
            let heard = self.take(length)?;
            self.waiting.extend(heard);
            let is_datagram = |heard: &Heard| matches!(heard, Heard::Datagram(_));
            let datagrams = self.waiting.iter().filter(|heard| is_datagram(heard)).count();
            if datagrams > NEWEST
                && let Some(oldest) = self.waiting.iter().position(is_datagram)
            {
                self.waiting.remove(oldest);
            }
        }
        Ok(())
    }

    fn take(&mut self, length: usize) -> Result<Option<Heard>, ClientError> {
        let packet = &mut self.buffer[..length.min(MAX_PACKET_BYTES + 1)];
        let Ok((kind, body)) = self.opener.open(packet) else { return Ok(None) };
        self.heard = Instant::now();
        match kind {
            Kind::Challenge => {
                self.cookie = body.to_vec();
                let shows = self.sealer.seal(Kind::Here, &self.cookie);
                post(&self.socket, shows);
                Ok(None)
            }
            Kind::Datagram => {
                self.streaming = true;
                Ok(Some(Heard::Datagram(bytes::Bytes::copy_from_slice(body))))
            }
            Kind::Message => {
                self.streaming = true;
                let (taken, frame) = self.messages.on_message(body);
                let mut frames = FrameDecoder::default();
                let message = match frame {
                    Some(mut frame) => frames.next(&mut frame)?,
                    None => None,
                };
                let answer = self.sealer.seal(Kind::Taken, &taken);
                post(&self.socket, answer);
                Ok(message.and_then(|message| message.body).map(Heard::Message))
            }
            Kind::Taken => {
                self.messages.on_taken(body);
                Ok(None)
            }
            Kind::Here => Ok(None),
        }
    }

    /// Sends a datagram, or loses it.
    pub fn send(&mut self, bytes: &[u8]) -> Result<(), ClientError> {
        let packet = self.sealer.seal(Kind::Datagram, bytes);
        let too_long = || ClientError::TooLong { bytes: bytes.len() };
        post(&self.socket, Some(packet.ok_or_else(too_long)?));
        Ok(())
    }

    /// Says the last word until the server has it; the caller's patience ends it.
    pub async fn close(mut self, bye: StreamMessage) {
        self.messages.say(&encode_frame(&bye));
        while !self.messages.is_done() {
            self.say_again();
            if self.hear().await.is_err() {
                return;
            }
        }
    }

    fn say_again(&mut self) {
        let now_ns = u64::try_from(self.started.elapsed().as_nanos()).unwrap_or(u64::MAX);
        // Whose address has changed is streamed to at the old one until it knocks again.
        if !self.streaming || self.heard.elapsed() > QUIET {
            post(&self.socket, self.sealer.seal(Kind::Here, &self.cookie));
        }
        for body in self.messages.due(now_ns) {
            post(&self.socket, self.sealer.seal(Kind::Message, body));
        }
    }
}

/// What the socket does not take is lost, as on any network.
fn post(socket: &UdpSocket, packet: Option<Vec<u8>>) {
    if let Some(packet) = packet {
        let _ = socket.try_send(&packet);
    }
}
