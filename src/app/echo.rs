//! Bare echoes: what a round trip costs before hapticd adds anything, and how to compare.
//!
//! Each server is a thread with a `current_thread` runtime of its own that sends back what it
//! gets; each client lives in the runtime of the caller. The payload is a Ping of the protocol.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket as StdUdpSocket};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use quinn::crypto::rustls::{QuicClientConfig, QuicServerConfig};
use quinn::{Connection, Endpoint, EndpointConfig, TokioRuntime};
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio::net::UdpSocket;
use tokio::sync::oneshot;
use tokio::time::{MissedTickBehavior, interval, sleep_until};

use crate::client::{Client, Incoming};
use crate::proto::{Ping, datagram::Body};
use crate::{quic, wire};

/// An answer that takes longer is lost.
const LOST: Duration = Duration::from_millis(200);

/// Pings of a block that only wake everything up.
const WARM_UP: usize = 10;

/// A way to the other end and back.
#[allow(async_fn_in_trait)] // nobody needs it to be Send
pub trait Way {
    /// Sends a Ping.
    fn ask(&mut self) -> anyhow::Result<()>;
    /// The round trip of the next answer. Cancel safe.
    async fn answer(&mut self) -> anyhow::Result<Duration>;
}

/// One block of pings, sent on time whether or not the one before is back; what comes back
/// after the first few is recorded. Returns how many came back.
pub async fn block(
    way: &mut impl Way,
    pings: usize,
    pace: Duration,
    mut record: impl FnMut(Duration),
) -> anyhow::Result<usize> {
    let mut ticks = interval(pace);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let (mut sent, mut answered) = (0, 0);
    let mut over = Instant::now() + LOST + pace * (2 * pings) as u32;
    while answered < pings && Instant::now() < over {
        tokio::select! {
            biased;
            round_trip = way.answer() => {
                let round_trip = round_trip?;
                answered += 1;
                if answered > WARM_UP {
                    record(round_trip);
                }
            }
            _ = ticks.tick(), if sent < pings => {
                way.ask()?;
                sent += 1;
                if sent == pings {
                    over = Instant::now() + LOST;
                }
            }
            () = sleep_until(over.into()) => {}
        }
    }
    anyhow::ensure!(2 * answered > pings, "only {answered} of {pings} pings came back");
    Ok(answered)
}

/// The client of a server. What else it receives, it answers on the way.
pub struct Served(pub Client);

impl Way for Served {
    fn ask(&mut self) -> anyhow::Result<()> {
        Ok(self.0.send_ping()?)
    }

    async fn answer(&mut self) -> anyhow::Result<Duration> {
        loop {
            if let Incoming::RoundTrip(time) = self.0.next().await? {
                return Ok(time);
            }
        }
    }
}

/// Numbers Pings and reads the time from their answers.
struct Pinger {
    begin: Instant,
    seq: u64,
}

impl Pinger {
    fn new() -> Self {
        Self { begin: Instant::now(), seq: 0 }
    }

    fn ask(&mut self) -> Vec<u8> {
        self.seq += 1;
        let sent_ns = self.begin.elapsed().as_nanos() as u64;
        wire::encode(&Body::Ping(Ping { seq: self.seq, sent_ns }))
    }

    fn round_trip(&self, answer: &[u8]) -> anyhow::Result<Duration> {
        let Body::Ping(ping) = wire::decode(answer)? else { anyhow::bail!("not what was sent") };
        Ok(self.begin.elapsed().saturating_sub(Duration::from_nanos(ping.sent_ns)))
    }
}

/// A server's thread; it ends when this is dropped.
struct Server {
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Runs `serve` until it is stopped.
    fn start<F>(serve: impl FnOnce() -> anyhow::Result<F> + Send + 'static) -> anyhow::Result<Self>
    where
        F: Future<Output = ()> + Send + 'static,
    {
        let (stop, stopped) = oneshot::channel();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let thread = std::thread::spawn(move || {
            runtime.block_on(async {
                let serving = serve().map(tokio::spawn);
                assert!(serving.is_ok(), "an echo did not start");
                // Dropped means the same.
                let _ = stopped.await;
            });
        });
        Ok(Self { stop: Some(stop), thread: Some(thread) })
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop.take();
        if let Some(thread) = self.thread.take() {
            // Its panic has been printed.
            let _ = thread.join();
        }
    }
}

const ANY_PORT: (Ipv4Addr, u16) = (Ipv4Addr::LOCALHOST, 0);

/// Largest datagram of an echo.
const ROOM: usize = 2048;

/// Plain UDP.
pub struct UdpEcho {
    socket: UdpSocket,
    pinger: Pinger,
    _server: Server,
}

impl UdpEcho {
    /// Starts the other end.
    pub async fn start() -> anyhow::Result<Self> {
        let far = bound()?;
        let address = far.local_addr()?;
        let server = Server::start(move || Ok(echo_udp(UdpSocket::from_std(far)?)))?;
        let socket = UdpSocket::from_std(bound()?)?;
        socket.connect(address).await?;
        Ok(Self { socket, pinger: Pinger::new(), _server: server })
    }
}

impl Way for UdpEcho {
    fn ask(&mut self) -> anyhow::Result<()> {
        self.socket.try_send(&self.pinger.ask())?;
        Ok(())
    }

    async fn answer(&mut self) -> anyhow::Result<Duration> {
        let mut bytes = [0; ROOM];
        let length = self.socket.recv(&mut bytes).await?;
        self.pinger.round_trip(&bytes[..length])
    }
}

async fn echo_udp(socket: UdpSocket) {
    let mut bytes = [0; ROOM];
    while let Ok((length, from)) = socket.recv_from(&mut bytes).await {
        let _ = socket.send_to(&bytes[..length], from).await;
    }
}

/// QUIC datagrams with the transport settings of hapticd.
pub struct QuicEcho {
    connection: Connection,
    pinger: Pinger,
    _endpoint: Endpoint,
    _server: Server,
}

impl QuicEcho {
    /// Starts the other end and connects to it.
    pub async fn start() -> anyhow::Result<Self> {
        let (certificate, key) = certificate()?;
        let config = server_config(certificate.clone(), key)?;
        let far = bound()?;
        let address: SocketAddr = far.local_addr()?;
        let server = Server::start(move || Ok(echo_quic(endpoint(far, Some(config))?)))?;
        let endpoint = endpoint(bound()?, None)?;
        let connecting = endpoint.connect_with(client_config(certificate)?, address, "echo")?;
        let connection = connecting.await?;
        Ok(Self { connection, pinger: Pinger::new(), _endpoint: endpoint, _server: server })
    }
}

impl Way for QuicEcho {
    fn ask(&mut self) -> anyhow::Result<()> {
        self.connection.send_datagram(self.pinger.ask().into())?;
        Ok(())
    }

    async fn answer(&mut self) -> anyhow::Result<Duration> {
        let bytes = self.connection.read_datagram().await?;
        self.pinger.round_trip(&bytes)
    }
}

async fn echo_quic(endpoint: Endpoint) {
    let Some(incoming) = endpoint.accept().await else { return };
    let Ok(connection) = incoming.await else { return };
    while let Ok(bytes) = connection.read_datagram().await {
        let _ = connection.send_datagram(bytes);
    }
}

fn bound() -> std::io::Result<StdUdpSocket> {
    let socket = StdUdpSocket::bind(ANY_PORT)?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

fn endpoint(
    socket: StdUdpSocket,
    config: Option<quinn::ServerConfig>,
) -> std::io::Result<Endpoint> {
    Endpoint::new(EndpointConfig::default(), config, socket, Arc::new(TokioRuntime))
}

fn certificate() -> anyhow::Result<(CertificateDer<'static>, PrivateKeyDer<'static>)> {
    let made = rcgen::generate_simple_self_signed(["echo".to_owned()])?;
    let key = PrivateKeyDer::try_from(made.signing_key.serialize_der());
    Ok((made.cert.der().clone(), key.map_err(anyhow::Error::msg)?))
}

fn server_config(
    certificate: CertificateDer<'static>,
    key: PrivateKeyDer<'static>,
) -> anyhow::Result<quinn::ServerConfig> {
    let mut tls = rustls::ServerConfig::builder_with_provider(quic::provider())
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .with_no_client_auth()
        .with_single_cert(vec![certificate], key)?;
    tls.alpn_protocols = vec![quic::alpn()];
    let tls = QuicServerConfig::try_from(tls)?;
    let mut config = quinn::ServerConfig::with_crypto(Arc::new(tls));
    config.transport_config(quic::server_transport(1_000.0));
    Ok(config)
}

fn client_config(certificate: CertificateDer<'static>) -> anyhow::Result<quinn::ClientConfig> {
    let mut roots = rustls::RootCertStore::empty();
    roots.add(certificate)?;
    let mut tls = rustls::ClientConfig::builder_with_provider(quic::provider())
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .with_root_certificates(roots)
        .with_no_client_auth();
    tls.alpn_protocols = vec![quic::alpn()];
    let tls = QuicClientConfig::try_from(tls)?;
    let mut config = quinn::ClientConfig::new(Arc::new(tls));
    config.transport_config(quic::client_transport());
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both ends of a stream have the window of touch, and not quinn's usual one.
    #[test]
    fn the_windows_of_a_connection_are_fixed() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let (certificate, key) = certificate().unwrap();
            let config = server_config(certificate.clone(), key).unwrap();
            let far = endpoint(bound().unwrap(), Some(config)).unwrap();
            let near = endpoint(bound().unwrap(), None).unwrap();
            let address = far.local_addr().unwrap();
            let config = client_config(certificate).unwrap();
            let connecting = near.connect_with(config, address, "echo").unwrap();
            let accepting = async { far.accept().await.unwrap().await.unwrap() };
            let (here, there) = tokio::join!(connecting, accepting);
            assert_eq!(there.stats().path.cwnd, quic::server_window_bytes(1_000.0));
            assert_eq!(here.unwrap().stats().path.cwnd, quic::client_window_bytes());
        });
    }
}
