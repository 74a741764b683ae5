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
mod grpc;
mod http;
mod hub;
mod identity;
mod sealed_udp;
mod stream;

pub use access::{Access, AccessRefusal};
pub use browser::{BrowserIdentity, PublishedHashes};
pub use calls::{SessionCalls, SessionDesk, session_calls};
pub use door::Door;
pub use grpc::serve as serve_grpc;
pub use http::{HttpParts, serve as serve_http};
pub use hub::StreamDevice;
pub use identity::{Identity, IdentityError};
pub use sealed_udp::SealedUdpOffer;
pub use stream::{StreamError, StreamHandle, StreamParts, spawn as spawn_stream};
