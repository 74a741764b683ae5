//! Offline: experiments over the whole loop in virtual time, and their figures.
//!
//! Everything here is a plain function from a configuration to figures. It runs the same
//! `control::tick` as the real-time thread against the simulated device; it knows no clock,
//! no thread, no file and no socket, and nothing in a tick may use it.

pub mod smoothness;
pub mod wall_following;
