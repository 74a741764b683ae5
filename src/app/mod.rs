//! The composition root: builds a daemon from its parts, in order, and takes it down again.
//!
//! ```text
//! ServerConfig ─▶ device definition, scene, identity, sockets ─▶ threads ─▶ Daemon
//! ```
//!
//! Everything that can be refused (a file, a right, a port) is tried before the first thread
//! moves the device. Nothing here decides at run time.

mod daemon;
mod log;
mod signals;
mod sockets;

pub use daemon::{Daemon, Start};
pub use log::init as init_log;
pub use signals::Signals;
