//! What can go wrong between a client and a server.

use std::net::SocketAddr;

use super::ServicesError;
use crate::proto::ByeReason;
use crate::sealed::MAX_BODY_BYTES;
use crate::wire::FrameError;

/// Why a client stops.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The host has no address.
    #[error("cannot find host {host}: {source}")]
    Resolve { host: String, source: std::io::Error },
    /// A server elsewhere can only be known by its certificate's hash.
    #[error(
        "{host} is not this machine: use the whole connect string that the server prints (with sha256=...)"
    )]
    HashNeeded { host: String },
    /// The certificates cannot be set up.
    #[error("cannot set up TLS: {0}")]
    Tls(#[from] rustls::Error),
    /// No local socket.
    #[error("cannot open a UDP socket: {0}")]
    Socket(std::io::Error),
    /// The connection was never made.
    #[error("cannot connect to {address}: {source}")]
    Connect { address: SocketAddr, source: quinn::ConnectionError },
    /// Another server than the one in the connect string.
    #[error(
        "the server at {address} is not the one in the connect string: its certificate has another sha256"
    )]
    WrongServer { address: SocketAddr },
    /// The address cannot be connected to at all.
    #[error("cannot connect to {address}: {source}")]
    Address { address: SocketAddr, source: quinn::ConnectError },
    /// The connection broke.
    #[error("the connection to the server was lost: {0}")]
    Lost(String),
    /// The server takes no WebTransport session.
    #[error("{address} takes no WebTransport session: {source}")]
    WebTransport { address: SocketAddr, source: web_transport_quinn::ClientError },
    /// The services, which open a session over sealed UDP, are not there.
    #[error(transparent)]
    Services(#[from] Box<ServicesError>),
    /// A call was refused.
    #[error("the server refused: {0}")]
    Call(String),
    /// Longer than any datagram can be.
    #[error("cannot send a datagram of {bytes} bytes: at most {MAX_BODY_BYTES} fit")]
    TooLong { bytes: usize },
    /// The server said Bye.
    #[error("the server ended the session ({}): {detail}", reason.as_str_name())]
    Bye { reason: ByeReason, detail: String },
    /// The server does not speak the protocol.
    #[error("the server's stream makes no sense: {0}")]
    Frame(#[from] FrameError),
    /// The server answered Hello with something else.
    #[error("the server did not answer Hello")]
    NoWelcome,
    /// A command is too large or datagrams are not possible.
    #[error("cannot send a datagram: {0}")]
    Send(#[from] quinn::SendDatagramError),
    /// The reliable stream broke.
    #[error("cannot write to the server: {0}")]
    Write(#[from] web_transport_quinn::WriteError),
}
