//! What carries a client's session: datagrams and a reliable stream over QUIC, over
//! WebTransport, or over sealed UDP.

use std::time::{Duration, Instant};

use quinn::{Endpoint, VarInt};
use web_transport_quinn::{ReadError, RecvStream, SendStream, Session, SessionError};

use super::sealed::SealedStream;
use super::{ClientError, ConnectString, Transport, dial};
use crate::proto::stream_message::Body as Message;
use crate::proto::{Hello, StreamMessage};
use crate::wire::{FrameDecoder, encode_frame};

/// Read at a time from the reliable stream.
const CHUNK_BYTES: usize = 64 * 1024;

/// Time for a farewell to be heard.
const FAREWELL: Duration = Duration::from_millis(500);

/// A server that was silent for this long is gone: it sends pings, if nothing else.
const SILENCE: Duration = Duration::from_secs(3);

/// One thing that came.
#[derive(Debug)]
pub(super) enum Heard {
    Datagram(bytes::Bytes),
    Message(Message),
}

/// Either kind.
#[derive(Debug)]
pub(super) enum Carrier {
    Stream(Box<Stream>),
    Sealed(Box<SealedStream>),
}

impl Carrier {
    /// Connects over this transport and says Hello; what comes next is the server's answer.
    pub async fn open(
        target: &ConnectString,
        transport: Transport,
        hello: Hello,
    ) -> Result<Self, ClientError> {
        match transport {
            Transport::Udp => Ok(Self::Sealed(Box::new(SealedStream::open(target, hello).await?))),
            Transport::Quic | Transport::WebTransport => {
                let (session, endpoint) = dial::dial(target, transport).await?;
                let (mut send, receive) = session.open_bi().await.map_err(lost)?;
                let hello = StreamMessage { body: Some(Message::Hello(hello)) };
                send.write_all(&encode_frame(&hello)).await?;
                let (frames, chunk) = (FrameDecoder::default(), bytes::Bytes::new());
                let stream =
                    Stream { session, endpoint, send, receive, frames, chunk, heard: None };
                Ok(Self::Stream(Box::new(stream)))
            }
        }
    }

    /// The next thing that comes. Cancel safe.
    pub async fn hear(&mut self) -> Result<Heard, ClientError> {
        match self {
            Self::Stream(stream) => {
                let heard = stream.hear().await?;
                stream.heard = Some(Instant::now());
                Ok(heard)
            }
            Self::Sealed(sealed) => sealed.hear().await,
        }
    }

    /// What has come already.
    pub async fn hear_now(&mut self) -> Option<Result<Heard, ClientError>> {
        tokio::select! {
            biased;
            heard = self.hear() => Some(heard),
            () = std::future::ready(()) => None,
        }
    }

    /// Sends a datagram, or loses it: it never waits.
    pub fn send(&mut self, bytes: Vec<u8>) -> Result<(), ClientError> {
        match self {
            Self::Stream(stream) => match stream.session.send_datagram(bytes.into()) {
                Err(SessionError::SendDatagramError(error)) => Err(error.into()),
                sent => sent.map_err(lost),
            },
            Self::Sealed(sealed) => sealed.send(&bytes),
        }
    }

    /// Says the last word and waits until the server has it.
    pub async fn close(self, bye: StreamMessage) {
        match self {
            Self::Stream(stream) => stream.close(bye).await,
            // A server that is gone already needs no farewell.
            Self::Sealed(sealed) => {
                let _ = tokio::time::timeout(FAREWELL, sealed.close(bye)).await;
            }
        }
    }
}

/// A QUIC connection or a WebTransport session with its one reliable stream.
#[derive(Debug)]
pub(super) struct Stream {
    session: Session,
    // Drives the connection; its socket closes when it goes.
    endpoint: Endpoint,
    send: SendStream,
    receive: RecvStream,
    frames: FrameDecoder,
    /// Bytes read and not yet decoded.
    chunk: bytes::Bytes,
    /// When something came last; `None` until there is an answer to Hello.
    heard: Option<Instant>,
}

impl Stream {
    async fn hear(&mut self) -> Result<Heard, ClientError> {
        let ended = tokio::select! {
            biased;
            datagram = self.session.read_datagram() => match datagram {
                Ok(datagram) => return Ok(Heard::Datagram(datagram)),
                Err(ended) => lost(ended),
            },
            message = next_message(&mut self.receive, &mut self.frames, &mut self.chunk) => {
                match message {
                    Err(ClientError::Lost(ended)) => ClientError::Lost(ended),
                    message => return message.map(Heard::Message),
                }
            }
            () = silence(self.heard) => {
                let said = format!("nothing came for {} s", SILENCE.as_secs());
                return Err(ClientError::Lost(said));
            }
        };
        // What the server still said on the reliable stream before the connection ended, and
        // then why it ended.
        match next_message(&mut self.receive, &mut self.frames, &mut self.chunk).await {
            Ok(message) => Ok(Heard::Message(message)),
            Err(_) => Err(ended),
        }
    }

    async fn close(mut self, bye: StreamMessage) {
        // A server that is gone already needs no farewell.
        let _ = self.send.write_all(&encode_frame(&bye)).await;
        let _ = self.send.finish();
        let _ = tokio::time::timeout(FAREWELL, self.session.closed()).await;
        let connection: &quinn::Connection = &self.session;
        connection.close(VarInt::from_u32(0), b"done");
        let _ = tokio::time::timeout(FAREWELL, self.endpoint.wait_idle()).await;
    }
}

/// Until a server that has answered is silent for too long.
async fn silence(heard: Option<Instant>) {
    match heard {
        Some(heard) => tokio::time::sleep_until((heard + SILENCE).into()).await,
        None => std::future::pending().await,
    }
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
        match receive.read_chunk(CHUNK_BYTES, true).await {
            Ok(Some(read)) => *chunk = read.bytes,
            Ok(None) => return Err(ClientError::Lost("the server closed the stream".into())),
            Err(ReadError::SessionError(error)) => return Err(lost(error)),
            Err(_) => return Err(ClientError::NoWelcome),
        }
    }
}

/// Why a connection ended.
pub(super) fn lost(error: SessionError) -> ClientError {
    match error {
        SessionError::ConnectionError(error) => ClientError::Lost(error.to_string()),
        other => ClientError::Lost(other.to_string()),
    }
}
