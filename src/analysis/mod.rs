//! Offline: what a posture can do, and experiments over the whole loop in virtual time.
//!
//! Everything here is a plain function from a configuration to figures. An experiment runs the same
//! `control::tick` as the real-time thread against the simulated device; it knows no clock,
//! no thread, no file and no socket, and nothing in a tick may use it.

pub mod design;
#[cfg(feature = "design")]
pub mod experiment;
pub mod manipulability;
#[cfg(feature = "design")]
pub mod papers;
pub mod smoothness;
pub mod wall_following;
pub mod workspace;
