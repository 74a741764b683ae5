//! How many handshakes are let in, so that they never delay a force: each takes the stream thread
//! some tenths of a millisecond.
//!
//! A newcomer has to show first that it hears what is sent to its address (Retry, RFC 9000 section
//! 8.1.2): that takes no handshake, and is less than what came. Whoever writes somebody else's
//! address on its packets goes no further, and gets nothing amplified there (a handshake would
//! answer with three times what came). Those who do hear are let in at a bounded rate, and of those
//! under way each address has a share; the rest is dropped without a word, and comes again if it is a client.

use std::collections::HashMap;
use std::net::IpAddr;

/// Most under way at a time, and of one address.
const MOST: usize = 64;
const MOST_OF_ONE: usize = 32;

/// Most in a row, and in a second: 2 % of the stream thread.
const BURST: f64 = 64.0;
const PER_S: f64 = 64.0;

/// What becomes of a newcomer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Accept,
    /// It has to prove its address.
    Retry,
    /// Not a word.
    Ignore,
}

/// The handshakes of one endpoint.
#[derive(Debug)]
pub(super) struct Handshakes {
    under_way: HashMap<IpAddr, usize>,
    count: usize,
    /// So many may come at once.
    room: f64,
    judged_ns: u64,
}

impl Handshakes {
    /// None yet.
    pub fn new(now_ns: u64) -> Self {
        Self { under_way: HashMap::new(), count: 0, room: BURST, judged_ns: now_ns }
    }

    /// Judges a newcomer; one that is accepted is under way until [`Handshakes::ended`].
    pub fn judge(&mut self, from: IpAddr, proven: bool, now_ns: u64) -> Verdict {
        let passed_s = now_ns.saturating_sub(self.judged_ns) as f64 * 1e-9;
        self.judged_ns = now_ns;
        self.room = (self.room + passed_s * PER_S).min(BURST);
        let of_one = self.under_way.get(&from).copied().unwrap_or_default();
        if !proven {
            return Verdict::Retry;
        }
        if self.room < 1.0 || self.count >= MOST || of_one >= MOST_OF_ONE {
            return Verdict::Ignore;
        }
        self.room -= 1.0;
        self.count += 1;
        *self.under_way.entry(from).or_default() += 1;
        Verdict::Accept
    }

    /// One that was accepted has come to its end, good or bad.
    pub fn ended(&mut self, from: IpAddr) {
        self.count -= 1;
        if let Some(of_one) = self.under_way.get_mut(&from) {
            *of_one -= 1;
            if *of_one == 0 {
                self.under_way.remove(&from);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    fn address(last: u8) -> IpAddr {
        [192, 0, 2, last].into()
    }

    /// Whoever never proves its address holds up nobody who does.
    #[test]
    fn a_flood_from_nowhere_takes_no_room() {
        let mut door = Handshakes::new(0);
        for i in 0..100_000_u64 {
            assert_eq!(door.judge(address(i as u8), false, i * 1000), Verdict::Retry);
        }
        assert_eq!(door.judge(address(1), true, SECOND), Verdict::Accept);
    }

    #[test]
    fn a_busy_address_leaves_room_for_others_and_the_rate_is_bounded() {
        let mut door = Handshakes::new(0);
        let accepted =
            |door: &mut Handshakes, from, now_ns| door.judge(from, true, now_ns) == Verdict::Accept;
        assert_eq!((0..100).filter(|_| accepted(&mut door, address(1), 0)).count(), MOST_OF_ONE);
        assert!(accepted(&mut door, address(2), 0));
        // As fast as they end: at first a burst, then the rate.
        let mut all = 0;
        for ms in 0..10_000_u64 {
            for _ in 0..3 {
                if accepted(&mut door, address(3), ms * 1_000_000) {
                    door.ended(address(3));
                    all += 1;
                }
            }
        }
        assert!((600..=720).contains(&all), "{all} in ten seconds");
        let (count, addresses) = (door.count, door.under_way.len());
        assert_eq!((count, addresses), (MOST_OF_ONE + 1, 2), "whoever is gone is forgotten");
    }
}
