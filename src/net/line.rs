//! What carries the words of a TCP visitor: TLS, or TCP as it is where that will do. The first
//! byte says which (22 begins a TLS record: RFC 8446 section 5.1), so that one port takes both.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use rustls::ServerConfig;
use rustls::sign::{CertifiedKey, SingleCertAndKey};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio_rustls::server::TlsStream;
use tokio_rustls::{Accept, TlsAcceptor};

use crate::quic;

/// First byte of a TLS handshake.
const HANDSHAKE: u8 = 22;

/// What a door wants of those who come.
#[derive(Clone)]
pub enum Security {
    /// TCP as it is.
    Plain,
    /// TLS, or TCP as it is.
    Either(TlsAcceptor),
    /// TLS.
    Tls(TlsAcceptor),
}

impl Security {
    /// TLS 1.3 with this certificate, which speaks one of these protocols; `needed` or not.
    pub fn tls(
        certified: CertifiedKey,
        protocols: &[&str],
        needed: bool,
    ) -> Result<Self, rustls::Error> {
        let mut config = ServerConfig::builder_with_provider(quic::provider())
            .with_protocol_versions(&[&rustls::version::TLS13])?
            .with_no_client_auth()
            .with_cert_resolver(Arc::new(SingleCertAndKey::from(certified)));
        config.alpn_protocols = protocols.iter().map(|name| name.as_bytes().to_vec()).collect();
        let acceptor = TlsAcceptor::from(Arc::new(config));
        Ok(if needed { Self::Tls(acceptor) } else { Self::Either(acceptor) })
    }
}

impl std::fmt::Debug for Security {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Plain => "Plain",
            Self::Either(_) => "Either",
            Self::Tls(_) => "Tls",
        })
    }
}

/// One visitor's line. A handshake happens when it is first read from or written to, in the
/// task that does so: nobody else waits for it.
pub(super) enum Line {
    /// It has not said anything yet; `None` for the moment in which that is decided.
    New(Option<(TcpStream, TlsAcceptor)>, Plaintext),
    /// Keys are being agreed on.
    Handshake(Box<Accept<TcpStream>>),
    /// TCP as it is.
    Plain(TcpStream),
    /// Encrypted.
    Tls(Box<TlsStream<TcpStream>>),
}

/// What becomes of who does not begin with TLS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Plaintext {
    Taken,
    Refused,
}

impl Line {
    pub fn new(stream: TcpStream, security: &Security) -> Self {
        match security {
            Security::Plain => Self::Plain(stream),
            Security::Either(tls) => Self::New(Some((stream, tls.clone())), Plaintext::Taken),
            Security::Tls(tls) => Self::New(Some((stream, tls.clone())), Plaintext::Refused),
        }
    }

    /// Ready when there is something to read from and write to.
    fn poll_ready(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        loop {
            *self = match self {
                Self::Plain(_) | Self::Tls(_) => return Poll::Ready(Ok(())),
                Self::Handshake(accept) => Self::Tls(Box::new(ready!(Pin::new(accept).poll(cx))?)),
                Self::New(parts, plaintext) => {
                    let over = || io::Error::from(io::ErrorKind::NotConnected);
                    let (stream, _) = parts.as_ref().ok_or_else(over)?;
                    let mut byte = [0];
                    let seen = ready!(stream.poll_peek(cx, &mut ReadBuf::new(&mut byte)))?;
                    let (stream, tls) = parts.take().ok_or_else(over)?;
                    match (seen, byte[0], *plaintext) {
                        (1.., HANDSHAKE, _) => Self::Handshake(Box::new(tls.accept(stream))),
                        (0, ..) | (_, _, Plaintext::Taken) => Self::Plain(stream),
                        _ => {
                            let said = "plaintext, where only TLS is spoken";
                            return Poll::Ready(Err(io::Error::new(
                                io::ErrorKind::InvalidData,
                                said,
                            )));
                        }
                    }
                }
            };
        }
    }
}

impl std::fmt::Debug for Line {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::New(..) => "New",
            Self::Handshake(_) => "Handshake",
            Self::Plain(_) => "Plain",
            Self::Tls(_) => "Tls",
        })
    }
}

/// Does the same with either of them, once there is one.
macro_rules! on_either {
    ($line:expr, $cx:expr, $stream:ident => $what:expr) => {{
        ready!($line.poll_ready($cx))?;
        match &mut *$line {
            Line::Plain(plain) => {
                let $stream = Pin::new(plain);
                $what
            }
            Line::Tls(tls) => {
                let $stream = Pin::new(&mut **tls);
                $what
            }
            Line::New(..) | Line::Handshake(_) => Poll::Pending,
        }
    }};
}

impl AsyncRead for Line {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        on_either!(self, cx, stream => stream.poll_read(cx, buffer))
    }
}

impl AsyncWrite for Line {
    fn poll_write(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        on_either!(self, cx, stream => stream.poll_write(cx, bytes))
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        on_either!(self, cx, stream => stream.poll_write_vectored(cx, parts))
    }

    fn is_write_vectored(&self) -> bool {
        match self {
            Self::Plain(stream) => stream.is_write_vectored(),
            Self::Tls(stream) => stream.is_write_vectored(),
            Self::New(..) | Self::Handshake(_) => false,
        }
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        on_either!(self, cx, stream => stream.poll_flush(cx))
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        on_either!(self, cx, stream => stream.poll_shutdown(cx))
    }
}
