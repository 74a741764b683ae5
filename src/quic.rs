//! What both ends of a QUIC connection agree on: name, certificates by hash, and buffers
//! that hold a datagram or two and no more.
//!
//! A late force is worse than a lost one, so nothing is queued: room for the newest
//! datagrams, the oldest goes. Used by `net` and `client`, which do not know each other.

use std::sync::Arc;
use std::time::Duration;

use quinn::{IdleTimeout, TransportConfig, VarInt};
use rustls::crypto::CryptoProvider;

use crate::wire::{MAX_COMMAND_BYTES, MAX_STATE_BYTES, PROTOCOL};

/// quinn counts this much beside the bytes of each datagram it holds.
const BOOKKEEPING_BYTES: usize = 32;

/// Datagrams that may wait: State or Command, and a Ping or Pong beside them.
const WAITING: usize = 3;

/// First guess of the round trip; the default of 333 ms would slow the first retries.
const INITIAL_RTT: Duration = Duration::from_millis(10);

/// A peer that is silent for this long is gone. Longer than the session's own limit, so that
/// a silent client is told why it has to go.
const IDLE: Duration = Duration::from_secs(3);

/// Keeps an idle observer alive.
const KEEP_ALIVE: Duration = Duration::from_millis(200);

/// The application protocol of the handshake.
pub fn alpn() -> Vec<u8> {
    PROTOCOL.as_bytes().to_vec()
}

/// The one cryptography provider of the crate.
pub fn provider() -> Arc<CryptoProvider> {
    Arc::new(rustls::crypto::ring::default_provider())
}

/// SHA-256 of a certificate's DER: what clients check it by.
pub fn fingerprint(certificate_der: &[u8]) -> [u8; 32] {
    let digest = ring::digest::digest(&ring::digest::SHA256, certificate_der);
    let mut bytes = [0; 32];
    bytes.copy_from_slice(digest.as_ref());
    bytes
}

/// Transport settings of an end that sends datagrams of up to `sends_bytes` and takes those
/// of up to `takes_bytes`.
fn transport(sends_bytes: usize, takes_bytes: usize) -> Arc<TransportConfig> {
    let mut config = TransportConfig::default();
    let idle = IdleTimeout::from(VarInt::from_u32(IDLE.as_millis() as u32));
    config
        .initial_rtt(INITIAL_RTT)
        .max_idle_timeout(Some(idle))
        .keep_alive_interval(Some(KEEP_ALIVE))
        .datagram_send_buffer_size(WAITING * (sends_bytes + BOOKKEEPING_BYTES))
        .datagram_receive_buffer_size(Some(WAITING * (takes_bytes + BOOKKEEPING_BYTES)))
        .max_concurrent_bidi_streams(VarInt::from_u32(1))
        .max_concurrent_uni_streams(VarInt::from_u32(0))
        // One small datagram at a time leaves nothing to segment.
        .enable_segmentation_offload(false);
    Arc::new(config)
}

/// The server's end.
pub fn server_transport() -> Arc<TransportConfig> {
    transport(MAX_STATE_BYTES, MAX_COMMAND_BYTES)
}

/// A client's end. It has room for datagrams as large as a Command, more than a State needs.
pub fn client_transport() -> Arc<TransportConfig> {
    transport(MAX_COMMAND_BYTES, MAX_COMMAND_BYTES)
}
