//! The server's sockets: the stream, the services, and the page that Prometheus reads.
//!
//! The stream has a thread and a single-threaded runtime of its own, so that configuration
//! never delays a force; services and HTTP share another runtime. Nothing here decides
//! anything: the stream asks [`crate::session`], the services ask [`crate::host`].
//! It never sees the real-time thread.

mod access;
mod associations;
mod browser;
mod calls;
mod connection;
mod door;
mod gate;
mod grpc;
mod guests;
mod handshakes;
mod http;
mod hub;
mod identity;
mod line;
mod neighbours;
mod sealed_udp;
mod stream;
mod visit;

pub use access::{Access, AccessRefusal};
pub use browser::{BrowserIdentity, PublishedHashes};
pub use calls::{DeskRefusal, SessionCalls, SessionDesk, session_calls};
pub use door::Door;
pub use gate::{Caller, Gate, Refused};
pub use grpc::{GrpcParts, routes as grpc_routes, serve as serve_grpc};
pub use http::{HttpParts, Reach, serve as serve_http};
pub use hub::StreamDevice;
pub use identity::{Identity, IdentityError};
pub use line::Security;
pub use sealed_udp::SealedUdpOffer;
pub use stream::{StreamError, StreamHandle, StreamParts, spawn as spawn_stream};
