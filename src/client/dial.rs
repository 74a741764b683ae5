//! From a connect string to a QUIC connection, or a WebTransport session over one: every address
//! of the host, one after the other.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use quinn::crypto::rustls::QuicClientConfig;
use quinn::{ConnectionError, Endpoint};
use tokio::net::UdpSocket;
use tokio::task::JoinSet;
use web_transport_quinn::proto::{self, ConnectRequest};
use web_transport_quinn::{ClientError as WebTransportError, ConnectError, Session};

use super::verify::ByFingerprint;
use super::{ClientError, ConnectString, Transport};
use crate::quic::{self, PINNED_NAME, WEBTRANSPORT_PATH};

/// TLS alert 49, `access_denied` (RFC 8446, section 6): a certificate that the application
/// does not accept.
const ACCESS_DENIED_ALERT: u8 = 49;

/// Between two attempts.
const AGAIN: Duration = Duration::from_millis(500);

/// For all of them; where nobody listens at the port, a server may be about to start.
const PATIENCE: Duration = Duration::from_secs(15);
const NOBODY_THERE: Duration = Duration::from_secs(3);

/// For the word that nobody listens.
const A_WORD: Duration = Duration::from_millis(500);

/// A connection with the endpoint that drives it. Where no address of the host answers, the
/// last one's error.
pub async fn dial(
    target: &ConnectString,
    transport: Transport,
) -> Result<(Session, Endpoint), ClientError> {
    let host = || target.host.clone();
    if target.sha256.is_none() && !target.is_loopback() {
        return Err(ClientError::HashNeeded { host: host() });
    }
    let addresses = tokio::net::lookup_host((target.host.as_str(), target.stream_port))
        .await
        .map_err(|source| ClientError::Resolve { host: host(), source })?;
    let missing = std::io::Error::new(std::io::ErrorKind::NotFound, "it has no address");
    let mut failed = ClientError::Resolve { host: host(), source: missing };
    for address in addresses {
        let insisted = tokio::select! {
            insisted = insist(target, transport, address) => insisted,
            () = patience(address) => {
                Err(ClientError::Connect { address, source: ConnectionError::TimedOut })
            }
        };
        match insisted {
            Ok(connected) => return Ok(connected),
            Err(error) => failed = error,
        }
    }
    Err(failed)
}

/// As long as it makes sense to insist.
async fn patience(address: SocketAddr) {
    let began = tokio::time::Instant::now();
    let nobody = tokio::time::timeout(A_WORD, is_refused(address)).await.unwrap_or(false);
    tokio::time::sleep_until(began + if nobody { NOBODY_THERE } else { PATIENCE }).await;
}

/// Whether the system there says that nobody listens at a port, which it may: a single byte is
/// nothing to a server.
async fn is_refused(address: SocketAddr) -> bool {
    let asked = async {
        let socket = UdpSocket::bind(any(address)).await?;
        socket.connect(address).await?;
        socket.send(&[0]).await?;
        socket.recv(&mut [0]).await
    };
    asked.await.is_err_and(|error| error.kind() == std::io::ErrorKind::ConnectionRefused)
}

/// Any of our own addresses towards this one.
fn any(towards: SocketAddr) -> SocketAddr {
    if towards.is_ipv4() { ([0, 0, 0, 0], 0).into() } else { ([0_u16; 8], 0).into() }
}

/// A handshake that loses a few packets in a row waits ever longer for the next one. So a new one
/// begins beside it after a while, and the first that comes to its end counts.
async fn insist(
    target: &ConnectString,
    transport: Transport,
    address: SocketAddr,
) -> Result<(Session, Endpoint), ClientError> {
    let mut attempts = JoinSet::new();
    loop {
        attempts.spawn(try_one(target.clone(), transport, address));
        match tokio::time::timeout(AGAIN, attempts.join_next()).await {
            Ok(Some(Ok(Ok(connected)))) => return Ok(connected),
            Ok(Some(Ok(Err(error)))) if !is_of_the_path(&error) => return Err(error),
            // One was lost on the way, or all of them are still there.
            Ok(_) | Err(_) => {}
        }
    }
}

/// Whether another attempt may come to another end.
fn is_of_the_path(error: &ClientError) -> bool {
    match error {
        ClientError::Connect { source, .. } => *source == ConnectionError::TimedOut,
        ClientError::WebTransport { source, .. } => match source {
            WebTransportError::Connection(_) | WebTransportError::SettingsError(_) => true,
            WebTransportError::HttpError(ConnectError::ProtoError(error)) => {
                matches!(error, proto::ConnectError::UnexpectedEnd)
            }
            WebTransportError::HttpError(error) => {
                !matches!(error, ConnectError::ErrorStatus(_) | ConnectError::ProtocolMismatch(_))
            }
            _ => false,
        },
        _ => false,
    }
}

async fn try_one(
    target: ConnectString,
    transport: Transport,
    address: SocketAddr,
) -> Result<(Session, Endpoint), ClientError> {
    let webtransport = transport == Transport::WebTransport;
    let alpn = if webtransport { quic::alpn_webtransport() } else { quic::alpn() };
    let endpoint = endpoint(&target, alpn, address)?;
    let connecting = endpoint
        .connect(address, PINNED_NAME)
        .map_err(|source| ClientError::Address { address, source })?;
    let connection = connecting.await.map_err(|source| connect_error(address, source))?;
    if !webtransport {
        return Ok((Session::raw(connection), endpoint));
    }
    // By its address: whatever name it was found by, that is where it was found.
    let url = format!("https://{address}{WEBTRANSPORT_PATH}");
    let request = url.parse().map(|url: url::Url| ConnectRequest::new(url));
    let request = request.map_err(|_| ClientError::NoWelcome)?;
    let session = Session::connect(connection, request).await;
    let session = session.map_err(|source| ClientError::WebTransport { address, source })?;
    Ok((session, endpoint))
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

fn endpoint(
    target: &ConnectString,
    alpn: Vec<u8>,
    address: SocketAddr,
) -> Result<Endpoint, ClientError> {
    let provider = quic::provider();
    let verifier = ByFingerprint { sha256: target.sha256, provider: Arc::clone(&provider) };
    let mut tls = rustls::ClientConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .dangerous() // the hash decides, not a chain of signatures
        .with_custom_certificate_verifier(Arc::new(verifier))
        .with_no_client_auth();
    tls.alpn_protocols = vec![alpn];
    let tls = QuicClientConfig::try_from(tls)
        .map_err(|error| ClientError::Tls(rustls::Error::General(error.to_string())))?;
    let mut config = quinn::ClientConfig::new(Arc::new(tls));
    config.transport_config(quic::client_transport());
    let mut endpoint = Endpoint::client(any(address)).map_err(ClientError::Socket)?;
    endpoint.set_default_client_config(config);
    Ok(endpoint)
}
