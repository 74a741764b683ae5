//! The daemon's sockets, bound before anything runs.

use std::io;
use std::net::{IpAddr, SocketAddr, TcpListener, UdpSocket};

use anyhow::Context;

use crate::config::ServerConfig;

/// All of them.
#[derive(Debug)]
pub struct Sockets {
    /// QUIC and WebTransport.
    pub stream: UdpSocket,
    /// Sealed UDP.
    pub sealed: UdpSocket,
    /// gRPC.
    pub grpc: TcpListener,
    /// Plain HTTP.
    pub http: TcpListener,
    /// HTTPS, beyond loopback.
    pub https: Option<TcpListener>,
}

impl Sockets {
    /// Binds the configured ports. With `or_free`, a port in use is replaced by a free one.
    pub fn bind(config: &ServerConfig, or_free: bool) -> anyhow::Result<Self> {
        let ip = config.listen;
        let udp = |address: SocketAddr| UdpSocket::bind(address);
        let tcp = |address: SocketAddr| TcpListener::bind(address);
        Ok(Self {
            stream: bind("stream_port", ip, config.stream_port, or_free, udp)?,
            sealed: bind("udp_port", ip, config.udp_port, or_free, udp)?,
            grpc: bind("grpc_port", ip, config.grpc_port, or_free, tcp)?,
            http: bind("http_port", config.http_address(), config.http_port, or_free, tcp)?,
            https: (!ip.is_loopback())
                .then(|| bind("https_port", ip, config.https_port, or_free, tcp))
                .transpose()?,
        })
    }
}

fn bind<S>(
    key: &str,
    ip: IpAddr,
    port: u16,
    or_free: bool,
    open: impl Fn(SocketAddr) -> io::Result<S>,
) -> anyhow::Result<S> {
    match open(SocketAddr::new(ip, port)) {
        Err(error) if or_free && error.kind() == io::ErrorKind::AddrInUse => {
            open(SocketAddr::new(ip, 0)).with_context(|| format!("no free port for {key} on {ip}"))
        }
        Err(error) if error.kind() == io::ErrorKind::AddrNotAvailable => {
            Err(error).with_context(|| {
                format!("server.listen = {ip}: this machine has no such address; choose one of its own")
            })
        }
        result => result.with_context(|| {
            format!("server.{key} = {port}: cannot listen on {ip} port {port}; choose another port, or 0 for any free one")
        }),
    }
}
