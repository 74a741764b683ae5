//! A client's clock against the device's, and the two halves of a round trip.
//!
//! From four timestamps as NTP has it (RFC 5905, section 8), filtered by the least round
//! trip among the newest (section 10): the fastest exchange waited least, so it bounds the
//! error best. One-way delays are *estimates*: however the halves of that round trip really
//! differ, they are off by at most half of it, which is told with them.

use crate::proto::Pong;

/// Exchanges that are remembered: 3.2 s of the server's pings. A clock that is 100 ppm off
/// moves by 0.3 ms meanwhile.
const REMEMBERED: usize = 32;

/// Which way something went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the client to the server.
    In,
    /// From the server to the client.
    Out,
}

impl Direction {
    /// Both, for tables of metrics.
    pub const ALL: [Self; 2] = [Self::In, Self::Out];

    /// The name used in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::In => "in",
            Self::Out => "out",
        }
    }
}

/// What is known of a session's clock and path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    /// The client's clock minus the device's.
    pub offset_ns: i64,
    /// Delay of the last exchange towards the server.
    pub in_ns: u64,
    /// Delay of the last exchange towards the client.
    pub out_ns: u64,
    /// All three are off by at most this: half the least round trip.
    pub bound_ns: u64,
}

/// One exchange.
#[derive(Clone, Copy, Debug)]
struct Exchange {
    rtt_ns: u64,
    offset_ns: i64,
}

/// The newest exchanges of one session.
#[derive(Clone, Debug, Default)]
pub(super) struct Offset {
    exchanges: [Option<Exchange>; REMEMBERED],
    next: usize,
    /// As of the last exchange.
    pub clock: Option<Clock>,
}

impl Offset {
    /// A Ping sent at `pong.sent_ns` came back now, after `rtt_ns` on the network.
    pub fn take(&mut self, pong: &Pong, rtt_ns: u64, now_ns: u64) -> Clock {
        let [sent, received, returned, now] =
            [pong.sent_ns, pong.received_ns, pong.returned_ns, now_ns].map(i128::from);
        let offset_ns = clamped(((received - sent) + (returned - now)) / 2);
        self.exchanges[self.next] = Some(Exchange { rtt_ns, offset_ns });
        self.next = (self.next + 1) % REMEMBERED;
        let best = self.exchanges.iter().flatten().min_by_key(|exchange| exchange.rtt_ns);
        let best = best.copied().unwrap_or(Exchange { rtt_ns, offset_ns });
        let ahead = i128::from(best.offset_ns);
        let clock = Clock {
            offset_ns: best.offset_ns,
            in_ns: half(now - (returned - ahead), rtt_ns),
            out_ns: half(received - ahead - sent, rtt_ns),
            bound_ns: best.rtt_ns.div_ceil(2),
        };
        self.clock = Some(clock);
        clock
    }
}

/// A half is never longer than the whole, whatever the client says of its clock.
fn half(ns: i128, rtt_ns: u64) -> u64 {
    ns.clamp(0, rtt_ns.into()) as u64
}

fn clamped(ns: i128) -> i64 {
    ns.clamp(i64::MIN.into(), i64::MAX.into()) as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const MS: u64 = 1_000_000;

    /// One exchange over these delays with a client whose clock is ahead by `ahead_ns`.
    fn exchange(offset: &mut Offset, sent_ns: u64, ahead_ns: i64, delays_ns: [u64; 2]) -> Clock {
        let [out_ns, in_ns] = delays_ns;
        let received_ns = (sent_ns + out_ns).wrapping_add_signed(ahead_ns);
        let returned_ns = received_ns + MS;
        let pong = Pong { seq: 1, sent_ns, received_ns, returned_ns, states_received: 0 };
        offset.take(&pong, out_ns + in_ns, sent_ns + out_ns + MS + in_ns)
    }

    #[test]
    fn the_truth_is_always_within_the_bound_however_the_path_is_split() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        for ahead_ns in [0, -3_000_000_000, 77_000_000_000] {
            for _ in 0..50 {
                let mut offset = Offset::default();
                let least = [rng.random_range(0..40 * MS), rng.random_range(0..40 * MS)];
                for ping in 100..140 {
                    let delays = least.map(|ns| ns + rng.random_range(0..30 * MS));
                    let clock = exchange(&mut offset, ping * 100 * MS, ahead_ns, delays);
                    let bound_ns = clock.bound_ns;
                    assert!(clock.offset_ns.abs_diff(ahead_ns) <= bound_ns);
                    assert!(clock.out_ns.abs_diff(delays[0]) <= bound_ns);
                    assert!(clock.in_ns.abs_diff(delays[1]) <= bound_ns);
                    assert!(bound_ns <= (delays[0] + delays[1]).div_ceil(2));
                }
            }
        }
    }

    #[test]
    fn the_fastest_exchange_decides_and_is_forgotten_in_time() {
        let mut offset = Offset::default();
        exchange(&mut offset, 100 * MS, 0, [MS, MS]);
        let slow = exchange(&mut offset, 200 * MS, 0, [50 * MS, 2 * MS]);
        assert_eq!((slow.offset_ns, slow.out_ns, slow.in_ns), (0, 50 * MS, 2 * MS));
        assert_eq!(slow.bound_ns, MS);
        let mut last = slow;
        for ping in 3..40 {
            last = exchange(&mut offset, ping * 100 * MS, 0, [50 * MS, 2 * MS]);
        }
        assert_eq!((last.offset_ns, last.bound_ns), (24 * MS as i64, 26 * MS));
    }

    #[test]
    fn a_clock_that_jumps_makes_no_half_longer_than_the_whole() {
        let mut offset = Offset::default();
        exchange(&mut offset, 100 * MS, 0, [MS, MS]);
        for ahead_ns in [-3_600_000 * MS as i64, 3_600_000 * MS as i64] {
            let sent_ns = 7_200_000 * MS;
            let clock = exchange(&mut offset, sent_ns, ahead_ns, [20 * MS, 30 * MS]);
            let expected = if ahead_ns < 0 { (0, 50 * MS) } else { (50 * MS, 0) };
            assert_eq!((clock.out_ns, clock.in_ns), expected);
        }
    }

    #[test]
    fn a_hostile_clock_overflows_nothing() {
        let mut offset = Offset::default();
        for (received_ns, returned_ns) in [(0, u64::MAX), (u64::MAX, u64::MAX), (0, 0)] {
            let pong =
                Pong { seq: 1, sent_ns: u64::MAX, received_ns, returned_ns, states_received: 0 };
            let clock = offset.take(&pong, u64::MAX, u64::MAX);
            assert_eq!(clock.bound_ns, 1 << 63);
        }
    }
}
