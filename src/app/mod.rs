//! The composition root: builds a daemon from its parts, in order, and takes it down again.
//!
//! ```text
//! ServerConfig ─▶ devices, scenes, identity, sockets, signals ─▶ stream ─▶ loops ─▶ services
//! ```
//!
//! Everything that can be refused (a file, a port, a certificate, a thread) is tried before
//! the loop moves the device; the loop itself asks for its rights before its first tick.
//! Nothing here decides at run time.

mod daemon;
mod device;
pub mod echo;
mod log;
pub mod netsim;
mod reachable;
pub mod relay;
mod services;
mod signals;
mod sockets;

pub(crate) use daemon::state_path;
pub use daemon::{Daemon, Start};
pub use device::RunningDevice;
pub use log::{Logs, init as init_log};
pub(crate) use reachable::address as reachable_address;
pub use signals::Signals;
