//! The Rust client of hapticd: a stream for forces, services for configuration.
//!
//! ```no_run
//! # async fn example() -> Result<(), Box<dyn std::error::Error>> {
//! use hapticd::client::{Client, Incoming, Options};
//! use hapticd::proto::Role;
//!
//! let target = "127.0.0.1:7351".parse()?;
//! let mut client = Client::connect(&target, Options::new("my scene", Role::Controller)).await?;
//! loop {
//!     if let Incoming::State(state) = client.next().await? {
//!         client.send_contacts(state.seq, 100, Vec::new())?;
//!     }
//! }
//! # }
//! ```
//!
//! Nothing here needs Linux or the server's code. A client never re-sends: commands are
//! absolute and the newest wins.

mod carrier;
mod connect_string;
mod dial;
mod error;
mod sealed;
mod services;
mod stream;
mod transport;
mod verify;

pub use connect_string::{
    ConnectString, ConnectStringError, DEFAULT_GRPC_PORT, DEFAULT_STREAM_PORT, DEFAULT_UDP_PORT,
};
pub use error::ClientError;
pub use services::{Authorized, Bearer, Devices, Services, ServicesError, services, told};
pub use stream::{Client, Incoming, Options};
pub use transport::Transport;
