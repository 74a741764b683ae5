//! The gRPC services of a server, ready to call.
//!
//! Every call has a deadline for its answer to begin, and the connection is watched, so a
//! server that is silent or gone is an error and never a wait without end. What is streamed
//! after a first answer may take as long as it likes.

use std::net::SocketAddr;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use http::Uri;
use hyper_util::rt::TokioIo;
use rustls::pki_types::ServerName;
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{Channel, Endpoint};
use tonic::{Code, Request, Status};

use super::ConnectString;
use super::verify::ByFingerprint;
use crate::proto::device_service_client::DeviceServiceClient;
use crate::proto::recording_service_client::RecordingServiceClient;
use crate::proto::scene_service_client::SceneServiceClient;
use crate::proto::session_service_client::SessionServiceClient;
use crate::quic::{self, PINNED_NAME};

/// Time for a connection.
const CONNECT: Duration = Duration::from_secs(3);

/// Time for the answer to a call; an edit waits for a disk, and for the edits before it.
const ANSWER: Duration = Duration::from_secs(10);

/// Between two looks whether the server is still there, and time for its sign of life.
const KEEP_ALIVE: Duration = Duration::from_secs(5);

/// A channel that shows the credential of the connect string with every call.
pub type Authorized = InterceptedService<Channel, Bearer>;

/// A client of the DeviceService.
pub type Devices = DeviceServiceClient<Authorized>;

/// Clients of the services on one channel.
#[derive(Clone, Debug)]
pub struct Services {
    /// Devices: describe, watch, switch.
    pub devices: Devices,
    /// Resident scenes.
    pub scenes: SceneServiceClient<Authorized>,
    /// Who is connected, and who commands.
    pub sessions: SessionServiceClient<Authorized>,
    /// Recordings.
    pub recordings: RecordingServiceClient<Authorized>,
}

/// Why there are no services.
#[derive(Debug, thiserror::Error)]
pub enum ServicesError {
    /// A server elsewhere can only be known by its certificate's hash.
    #[error(
        "{host} is not this machine: use the whole connect string that the server prints (with sha256=...)"
    )]
    HashNeeded { host: String },
    /// Another server than the one in the connect string.
    #[error(
        "the server at {authority} is not the one in the connect string: its certificate has another sha256"
    )]
    WrongServer { authority: String },
    /// The token is no text of a header.
    #[error("token: it has characters that no credential has")]
    Token,
    /// The certificates cannot be set up.
    #[error("cannot set up TLS: {0}")]
    Tls(#[from] rustls::Error),
    /// It went as it came.
    #[error("cannot connect to {authority}: it is gone again")]
    Gone { authority: String },
    /// No connection.
    #[error("cannot connect to {authority}: {source}")]
    Connect { authority: String, source: tonic::transport::Error },
}

/// Puts `authorization: Bearer TOKEN` on every call.
#[derive(Clone)]
pub struct Bearer(Option<MetadataValue<Ascii>>);

impl Bearer {
    fn new(token: Option<&str>) -> Result<Self, ServicesError> {
        let Some(token) = token else { return Ok(Self(None)) };
        let value = format!("Bearer {token}").parse();
        let mut value: MetadataValue<Ascii> = value.map_err(|_| ServicesError::Token)?;
        value.set_sensitive(true);
        Ok(Self(Some(value)))
    }
}

impl Interceptor for Bearer {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(value) = &self.0 {
            request.metadata_mut().insert("authorization", value.clone());
        }
        Ok(request)
    }
}

/// Never the secret.
impl std::fmt::Debug for Bearer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Bearer(..)")
    }
}

/// Connects to the services of a server: over TLS, by the hash of its certificate, where it is
/// elsewhere or wants a credential; in plaintext on this machine.
pub async fn services(target: &ConnectString) -> Result<Services, ServicesError> {
    services_at(target).await.map(|(services, _)| services)
}

/// The same, with the address that answered.
pub(super) async fn services_at(
    target: &ConnectString,
) -> Result<(Services, SocketAddr), ServicesError> {
    if target.sha256.is_none() && !target.is_loopback() {
        return Err(ServicesError::HashNeeded { host: target.host.clone() });
    }
    let bearer = Bearer::new(target.token.as_deref())?;
    let (channel, address) = channel(target).await?;
    let authorized = || InterceptedService::new(channel.clone(), bearer.clone());
    let services = Services {
        devices: DeviceServiceClient::new(authorized()),
        scenes: SceneServiceClient::new(authorized()),
        sessions: SessionServiceClient::new(authorized()),
        recordings: RecordingServiceClient::new(authorized()),
    };
    Ok((services, address))
}

async fn channel(target: &ConnectString) -> Result<(Channel, SocketAddr), ServicesError> {
    let authority = target.grpc_authority();
    let failed = |source| connect_error(authority.clone(), source);
    // The scheme that tonic leaves to its connector: with `https` it would want to do TLS itself.
    let endpoint = Endpoint::from_shared(format!("http://{authority}")).map_err(failed)?;
    let endpoint = endpoint
        .connect_timeout(CONNECT)
        .timeout(ANSWER)
        .http2_keep_alive_interval(KEEP_ALIVE)
        .keep_alive_timeout(KEEP_ALIVE)
        .keep_alive_while_idle(true);
    let reached = Arc::new(OnceLock::new());
    let at = (target.host.clone(), target.grpc_port);
    let reaching = reached.clone();
    let connected = if target.is_loopback() && target.token.is_none() {
        let plain = move |_: Uri| plain(at.clone(), reaching.clone());
        endpoint.connect_with_connector(tower::service_fn(plain)).await
    } else {
        let tls = tls(target)?;
        let secure = move |_: Uri| secure(at.clone(), reaching.clone(), tls.clone());
        endpoint.connect_with_connector(tower::service_fn(secure)).await
    };
    let channel = connected.map_err(failed)?;
    let address = reached.get().copied().ok_or(ServicesError::Gone { authority })?;
    Ok((channel, address))
}

fn tls(target: &ConnectString) -> Result<TlsConnector, rustls::Error> {
    let provider = quic::provider();
    let verifier = ByFingerprint { sha256: target.sha256, provider: Arc::clone(&provider) };
    let mut config = rustls::ClientConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .dangerous() // the hash decides, not a chain of signatures
        .with_custom_certificate_verifier(Arc::new(verifier))
        .with_no_client_auth();
    config.alpn_protocols = vec![b"h2".to_vec()];
    Ok(TlsConnector::from(Arc::new(config)))
}

/// The address that answered first.
type Reached = Arc<OnceLock<SocketAddr>>;

async fn plain(at: (String, u16), reached: Reached) -> std::io::Result<TokioIo<TcpStream>> {
    reach(at, reached).await.map(TokioIo::new)
}

async fn reach((host, port): (String, u16), reached: Reached) -> std::io::Result<TcpStream> {
    let stream = TcpStream::connect((host, port)).await?;
    stream.set_nodelay(true)?;
    // Another one by now would be told by the connection after this.
    let _ = reached.set(stream.peer_addr()?);
    Ok(stream)
}

async fn secure(
    at: (String, u16),
    reached: Reached,
    tls: TlsConnector,
) -> std::io::Result<TokioIo<TlsStream<TcpStream>>> {
    let stream = reach(at, reached).await?;
    let name = ServerName::try_from(PINNED_NAME).map_err(std::io::Error::other)?;
    Ok(TokioIo::new(tls.connect(name, stream).await?))
}

/// The verifier's refusal is the cause of the cause of what the channel says.
fn connect_error(authority: String, source: tonic::transport::Error) -> ServicesError {
    let causes =
        std::iter::successors(Some(&source as &(dyn std::error::Error + 'static)), |e| e.source());
    let refused = |error: &(dyn std::error::Error + 'static)| {
        let io = error.downcast_ref::<std::io::Error>().and_then(std::io::Error::get_ref);
        let tls = io.and_then(|inner| inner.downcast_ref::<rustls::Error>());
        matches!(tls, Some(rustls::Error::InvalidCertificate(_)))
    };
    match causes.into_iter().any(refused) {
        true => ServicesError::WrongServer { authority },
        false => ServicesError::Connect { authority, source },
    }
}

/// A refusal in the server's own words, or that there were none.
pub fn told(status: &Status) -> String {
    let expired = tonic::TimeoutExpired(()).to_string();
    match status.code() {
        Code::Cancelled if status.message() == expired => {
            format!("the server did not answer within {} s", ANSWER.as_secs())
        }
        code => format!("{} ({code:?})", status.message()),
    }
}
