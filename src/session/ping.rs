//! Round trips: the server's own Pings, and answers to the client's.
//!
//! A round trip is measured as NTP does it (RFC 5905, section 8): from sending to receipt
//! here, less what the peer says it held the Ping. Only a Pong to a Ping that is still
//! waited for counts, once; times come from here, not from what the peer echoes.

use crate::proto::{Ping, Pong};

/// Between two Pings: 10 Hz.
pub(super) const PING_EVERY_NS: u64 = 100_000_000;

/// Pings that are waited for at once: 1.6 s of them.
const IN_FLIGHT: usize = 16;

/// The Pong to a client's Ping.
pub(super) fn answer(ping: &Ping, now_ns: u64) -> Pong {
    Pong {
        seq: ping.seq,
        sent_ns: ping.sent_ns,
        received_ns: now_ns,
        returned_ns: now_ns,
        states_received: 0,
    }
}

/// The server's Pings to one session.
#[derive(Debug)]
pub(super) struct Pinger {
    next_ns: u64,
    seq: u64,
    in_flight: [Option<Ping>; IN_FLIGHT],
    /// The last round trip.
    pub rtt_ns: Option<u64>,
}

impl Pinger {
    /// Pings from now on.
    pub fn new(now_ns: u64) -> Self {
        Self { next_ns: now_ns, seq: 0, in_flight: [None; IN_FLIGHT], rtt_ns: None }
    }

    /// When the next Ping is due.
    pub fn next_ns(&self) -> u64 {
        self.next_ns
    }

    /// The Ping that is due, if one is.
    pub fn due(&mut self, now_ns: u64) -> Option<Ping> {
        if now_ns < self.next_ns {
            return None;
        }
        self.next_ns = now_ns.saturating_add(PING_EVERY_NS);
        self.seq += 1;
        let ping = Ping { seq: self.seq, sent_ns: now_ns };
        self.in_flight[place(self.seq)] = Some(ping);
        Some(ping)
    }

    /// The round trip that a Pong completes; `None`: nothing waits for it.
    pub fn completed(&mut self, pong: &Pong, now_ns: u64) -> Option<u64> {
        let waiting = &mut self.in_flight[place(pong.seq)];
        let ping = waiting.filter(|ping| (ping.seq, ping.sent_ns) == (pong.seq, pong.sent_ns))?;
        let elapsed_ns = now_ns.checked_sub(ping.sent_ns)?;
        let held_ns = pong.returned_ns.checked_sub(pong.received_ns)?;
        let rtt_ns = elapsed_ns.checked_sub(held_ns)?;
        *waiting = None;
        self.rtt_ns = Some(rtt_ns);
        Some(rtt_ns)
    }
}

fn place(seq: u64) -> usize {
    (seq % IN_FLIGHT as u64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn pong(ping: Ping, held_ns: u64) -> Pong {
        Pong {
            seq: ping.seq,
            sent_ns: ping.sent_ns,
            received_ns: 5,
            returned_ns: 5 + held_ns,
            states_received: 0,
        }
    }

    #[test]
    fn the_round_trip_leaves_out_what_the_client_held() {
        let mut pinger = Pinger::new(0);
        let ping = pinger.due(0).unwrap();
        assert_eq!(pinger.completed(&pong(ping, MS), 4 * MS), Some(3 * MS));
        assert_eq!(pinger.rtt_ns, Some(3 * MS));
    }

    #[test]
    fn pings_leave_ten_times_a_second_and_a_late_timer_does_not_bunch_them() {
        let mut pinger = Pinger::new(0);
        let sent = (0..1000).filter(|ms| pinger.due(ms * MS).is_some()).count();
        assert_eq!(sent, 10);
        assert!(pinger.due(5000 * MS).is_some());
        assert!(pinger.due(5001 * MS).is_none());
    }

    #[test]
    fn a_pong_counts_once_and_only_if_it_is_waited_for() {
        let mut pinger = Pinger::new(0);
        let ping = pinger.due(0).unwrap();
        let good = pong(ping, 0);
        for bad in [
            Pong { seq: 2, ..good },
            Pong { seq: u64::MAX, ..good },
            Pong { sent_ns: 1, ..good },
            Pong { returned_ns: 0, ..good },
            Pong { returned_ns: u64::MAX, ..good },
        ] {
            assert_eq!(pinger.completed(&bad, MS), None, "{bad:?}");
        }
        assert_eq!(pinger.completed(&good, MS), Some(MS));
        assert_eq!(pinger.completed(&good, 2 * MS), None);
        for count in 1..=IN_FLIGHT as u64 {
            pinger.due(count * PING_EVERY_NS);
        }
        assert_eq!(pinger.completed(&good, 2000 * MS), None, "given up");
    }
}
