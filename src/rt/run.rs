//! The loop of the real-time thread: wake on the grid, turn, ring, sleep.
//!
//! Between two ticks there is nothing else: no allocation, no lock, no log.
#![cfg_attr(
    not(test),
    deny(clippy::disallowed_types, clippy::disallowed_methods, clippy::disallowed_macros)
)]

use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicBool, Ordering};

use super::Cycle;
use super::clock::sleep_until;
use crate::clock::now_ns;
use crate::device::Device;

/// Turns `cycle` on time until `stop`; its end releases the device.
pub(super) fn run<D: Device>(mut cycle: Cycle<D>, stop: &AtomicBool, doorbell: &OwnedFd) {
    let mut due_ns = now_ns() + cycle.tick_ns();
    while !stop.load(Ordering::Relaxed) {
        sleep_until(due_ns);
        cycle.turn(due_ns, now_ns(), now_ns);
        ring(doorbell);
        due_ns = next_due_ns(due_ns, now_ns(), cycle.tick_ns());
    }
}

/// The next tick on the same grid that is not past: a late loop skips ticks and never runs
/// a burst of them.
fn next_due_ns(due_ns: u64, now_ns: u64, tick_ns: u64) -> u64 {
    let behind = now_ns.saturating_sub(due_ns) / tick_ns.max(1);
    due_ns + (behind + 1) * tick_ns
}

/// Wakes the stream thread. The counter cannot be full while anybody reads it; if nobody
/// does, there is nobody to wake.
fn ring(doorbell: &OwnedFd) {
    let _ = rustix::io::write(doorbell, &1u64.to_ne_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_loop_keeps_its_grid_and_skips() {
        assert_eq!(next_due_ns(1000, 1010, 1000), 2000);
        assert_eq!(next_due_ns(1000, 1999, 1000), 2000);
        assert_eq!(next_due_ns(1000, 2000, 1000), 3000);
        assert_eq!(next_due_ns(1000, 7300, 1000), 8000);
    }
}
