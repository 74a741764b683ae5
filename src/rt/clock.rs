//! Absolute sleep on the device clock.

use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::Timespec;

use crate::clock::NS_PER_S;

/// Sleeps until `due_ns`; returns at once when that is past. A signal does not shorten it.
pub fn sleep_until(due_ns: u64) {
    let due = Timespec { tv_sec: (due_ns / NS_PER_S) as _, tv_nsec: (due_ns % NS_PER_S) as _ };
    while let Err(rustix::io::Errno::INTR) = clock_nanosleep_absolute(ClockId::Monotonic, &due) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::now_ns;

    #[test]
    fn sleep_ends_after_its_deadline_and_a_past_one_does_not_wait() {
        let due_ns = now_ns() + 2_000_000;
        sleep_until(due_ns);
        assert!(now_ns() >= due_ns);
        sleep_until(0);
    }
}
