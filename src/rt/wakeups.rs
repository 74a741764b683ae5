//! How late this machine wakes a real-time thread: the loop without a device.
//!
//! The same rights, the same clock and the same grid as the loop of a device, and nothing in
//! between two wake-ups, so what is measured is the machine's share alone.

use std::sync::mpsc;

use super::clock::sleep_until;
use super::{Right, Rights, RtConfig, RtError};
use crate::clock::now_ns;

/// What was measured.
#[derive(Clone, Debug)]
pub struct Wakeups {
    /// Rights that were denied, and why.
    pub denied: Vec<(Right, String)>,
    /// Lateness of each wake-up, nanoseconds, in the order they came.
    pub lateness_ns: Vec<u64>,
    /// Wake-ups whose time was over before the one before was done.
    pub skipped: u64,
}

/// Wakes every `period_ns` for `count` times on a thread of its own. Blocks so long.
pub fn measure_wakeups(config: RtConfig, period_ns: u64, count: usize) -> Result<Wakeups, RtError> {
    let (send, done) = mpsc::sync_channel(1);
    let measure = move || {
        let rights = Rights::claim(config.priority, config.cpu);
        let mut lateness_ns = vec![0; count];
        let (mut skipped, mut due_ns) = (0, now_ns() + period_ns);
        for lateness_ns in &mut lateness_ns {
            sleep_until(due_ns);
            *lateness_ns = now_ns().saturating_sub(due_ns);
            let behind = *lateness_ns / period_ns.max(1);
            skipped += behind;
            due_ns += (behind + 1) * period_ns;
        }
        let _ = send.send(Wakeups { denied: rights.denied().to_vec(), lateness_ns, skipped });
    };
    std::thread::Builder::new().name("hapticd-wakeups".into()).spawn(measure)?;
    done.recv().map_err(|_| RtError::Ended)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_wake_up_is_measured_and_none_comes_early() {
        let config = RtConfig { priority: 1, ..RtConfig::default() };
        let before_ns = now_ns();
        let measured = measure_wakeups(config, 500_000, 20).unwrap();
        let took_ns = now_ns() - before_ns;
        assert_eq!(measured.lateness_ns.len(), 20);
        assert!(took_ns >= (20 + measured.skipped) * 500_000, "{took_ns} ns");
    }
}
