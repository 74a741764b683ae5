//! The device clock: CLOCK_MONOTONIC in nanoseconds, one for the loop, the stream and the host.
//!
//! Whoever decides anything takes `now_ns` as an argument instead; this is for the rim.

use rustix::time::{ClockId, clock_gettime};

pub(crate) const NS_PER_S: u64 = 1_000_000_000;

/// The device clock now.
pub fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * NS_PER_S + now.tv_nsec as u64
}
