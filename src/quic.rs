//! What both ends of a QUIC connection agree on: name, certificates by hash, and buffers
//! that hold a datagram or two and no more.
//!
//! A late force is worse than a lost one, so nothing is queued: room for the newest
//! datagrams, the oldest goes. Used by `net` and `client`, which do not know each other.

use std::any::Any;
use std::sync::Arc;
use std::time::{Duration, Instant};

use quinn::congestion::{Controller, ControllerFactory};
use quinn::{IdleTimeout, TransportConfig, VarInt};
use rustls::crypto::CryptoProvider;

use crate::notation::MAX_ACTUATORS;
use crate::wire::{MAX_COMMAND_BYTES, MAX_FRAME_BYTES, PROTOCOL, max_detailed_bytes};

/// quinn counts this much beside the bytes of each datagram it holds, and WebTransport puts the
/// number of its session before each.
const BOOKKEEPING_BYTES: usize = 32 + 8;

/// Datagrams that may wait, of the largest: the newest State or Command, and a Ping or Pong beside
/// it. quinn counts bytes, so that of small ones a few more may.
const WAITING: usize = 2;

/// First guess of the round trip; the default of 333 ms would slow the first retries.
const INITIAL_RTT: Duration = Duration::from_millis(10);

/// A peer that is silent for this long is gone. Much longer than the limits of session and
/// client, which judge who was welcomed: a handshake on a path that loses half of everything has
/// pauses of seconds.
const IDLE: Duration = Duration::from_secs(10);

/// Keeps an idle observer alive.
const KEEP_ALIVE: Duration = Duration::from_millis(200);

/// Longest round trip at which a datagram every millisecond still fits into the window.
const LONGEST_RTT: Duration = Duration::from_millis(250);

/// Commands a second of a client, of which so many are on their way at the longest round trip.
const COMMANDS_PER_S: f64 = 1_000.0;

/// What QUIC, UDP and IP add to a datagram, about.
const HEADERS_BYTES: usize = 60;

/// A congestion window that stays as it is: what a stream of datagrams of this size has on its
/// way at the longest round trip.
///
/// Datagrams of touch cannot wait, and a window that shrinks with every loss makes them: at 60 ms
/// and 3 % a usual controller delivers half of them. The stream sends no more than its rate, and
/// the session slows it where losses last or delays grow; that is what makes this fair.
#[derive(Clone, Copy, Debug)]
struct FixedWindow {
    bytes: u64,
}

impl FixedWindow {
    fn of(datagram_bytes: usize, per_s: f64) -> Self {
        let in_flight = (per_s * LONGEST_RTT.as_secs_f64()).ceil() as u64;
        Self { bytes: in_flight * (datagram_bytes + HEADERS_BYTES) as u64 }
    }
}

impl Controller for FixedWindow {
    fn on_congestion_event(
        &mut self,
        _now: Instant,
        _sent: Instant,
        _persistent: bool,
        _lost: u64,
    ) {
    }

    fn on_mtu_update(&mut self, _new_mtu: u16) {}

    fn window(&self) -> u64 {
        self.bytes
    }

    fn clone_box(&self) -> Box<dyn Controller> {
        Box::new(*self)
    }

    fn initial_window(&self) -> u64 {
        self.bytes
    }

    fn into_any(self: Box<Self>) -> Box<dyn Any> {
        self
    }
}

impl ControllerFactory for FixedWindow {
    fn build(self: Arc<Self>, _now: Instant, _current_mtu: u16) -> Box<dyn Controller> {
        Box::new(*self)
    }
}

/// The application protocol of the handshake.
pub fn alpn() -> Vec<u8> {
    PROTOCOL.as_bytes().to_vec()
}

/// That of WebTransport, HTTP/3.
pub fn alpn_webtransport() -> Vec<u8> {
    web_transport_quinn::ALPN.as_bytes().to_vec()
}

/// Where the stream is, of all that a WebTransport URL can name.
pub const WEBTRANSPORT_PATH: &str = "/hapticd/1";

/// The name by which a client that knows the server by its hash asks for it. A WebTransport client
/// that does not gets a certificate for browsers, which lives two weeks at most.
pub const PINNED_NAME: &str = "pinned.hapticd";

/// Read at a time from the reliable stream.
pub const CHUNK_BYTES: usize = 16 * 1024;

/// What a peer may have on its way on one stream, and on all: a few messages.
const STREAM_WINDOW_BYTES: u32 = 2 * MAX_FRAME_BYTES as u32;

/// The reliable stream; for WebTransport, beside it, the request that made the session.
const BIDI_STREAMS: u32 = 2;

/// HTTP/3 has three for itself, and browsers open more to see what happens.
const UNI_STREAMS: u32 = 8;

/// The one cryptography provider of the crate.
pub fn provider() -> Arc<CryptoProvider> {
    Arc::new(rustls::crypto::ring::default_provider())
}

/// Random bytes of the system.
pub fn fill_random(bytes: &mut [u8]) -> Result<(), NoRandomBytes> {
    use ring::rand::SecureRandom;
    ring::rand::SystemRandom::new().fill(bytes).map_err(|_| NoRandomBytes)
}

/// The system gave none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the system gave no random bytes")]
pub struct NoRandomBytes;

/// SHA-256 of a certificate's DER: what clients check it by.
pub fn fingerprint(certificate_der: &[u8]) -> [u8; 32] {
    let digest = ring::digest::digest(&ring::digest::SHA256, certificate_der);
    let mut bytes = [0; 32];
    bytes.copy_from_slice(digest.as_ref());
    bytes
}

/// Of the server's end of a connection at so many States a second.
fn server_window(states_per_s: f64) -> FixedWindow {
    FixedWindow::of(max_detailed_bytes(MAX_ACTUATORS), states_per_s)
}

/// Of a client's end.
fn client_window() -> FixedWindow {
    FixedWindow::of(MAX_COMMAND_BYTES, COMMANDS_PER_S)
}

/// What the server may have on its way to one client.
pub fn server_window_bytes(states_per_s: f64) -> u64 {
    server_window(states_per_s).bytes
}

/// What a client may have on its way.
pub fn client_window_bytes() -> u64 {
    client_window().bytes
}

/// Transport settings of an end that sends datagrams of up to `sends_bytes`, and takes those of up
/// to `takes_bytes`.
fn transport(sends_bytes: usize, window: FixedWindow, takes_bytes: usize) -> Arc<TransportConfig> {
    let mut config = TransportConfig::default();
    let idle = IdleTimeout::from(VarInt::from_u32(IDLE.as_millis() as u32));
    config
        .initial_rtt(INITIAL_RTT)
        .congestion_controller_factory(Arc::new(window))
        .max_idle_timeout(Some(idle))
        .keep_alive_interval(Some(KEEP_ALIVE))
        .datagram_send_buffer_size(WAITING * (sends_bytes + BOOKKEEPING_BYTES))
        .datagram_receive_buffer_size(Some(WAITING * (takes_bytes + BOOKKEEPING_BYTES)))
        .max_concurrent_bidi_streams(VarInt::from_u32(BIDI_STREAMS))
        .max_concurrent_uni_streams(VarInt::from_u32(UNI_STREAMS))
        .stream_receive_window(VarInt::from_u32(STREAM_WINDOW_BYTES))
        .receive_window(VarInt::from_u32(2 * STREAM_WINDOW_BYTES))
        // One small datagram at a time leaves nothing to segment.
        .enable_segmentation_offload(false);
    Arc::new(config)
}

/// The server's end; so many States a second at most go to one client.
pub fn server_transport(states_per_s: f64) -> Arc<TransportConfig> {
    transport(max_detailed_bytes(MAX_ACTUATORS), server_window(states_per_s), MAX_COMMAND_BYTES)
}

/// A client's end. It has room for datagrams as large as a Command, more than a State needs.
pub fn client_transport() -> Arc<TransportConfig> {
    transport(MAX_COMMAND_BYTES, client_window(), MAX_COMMAND_BYTES)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_holds_what_is_on_its_way_and_no_loss_makes_it_smaller() {
        let window = Arc::new(server_window(1_000.0));
        // 455 bytes a millisecond, the largest State, for a quarter of a second.
        assert_eq!(window.bytes, 113_750);
        let now = Instant::now();
        let mut controller = window.build(now, 1_200);
        controller.on_congestion_event(now, now, true, 60_000);
        assert_eq!((controller.window(), controller.initial_window()), (113_750, 113_750));
    }
}
