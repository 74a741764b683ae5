//! How many handshakes are let in, so that they never delay a force: each takes the stream thread
//! some tenths of a millisecond.
//!
//! A newcomer has to show first that it hears what is sent to its address (Retry, RFC 9000 section
//! 8.1.2): that takes no handshake, and is less than what came. Whoever writes somebody else's
//! address on its packets goes no further, and gets nothing amplified there (a handshake would
//! answer with three times what came). Those who do hear are let in at a bounded rate, half of it
//! for those who did not come in the last second; where too many are under way, one of those who
//! have most of them gives way ([`gives_way`]). The rest is dropped without a word, and comes
//! again if it is a client.

use std::collections::HashMap;
use std::net::IpAddr;

use tokio::sync::oneshot;

use super::neighbours::{Holder, gives_way, site};

/// Most under way at a time.
const MOST: usize = 64;

/// Most in a row, and in a second: 2 % of the stream thread.
const BURST: f64 = 64.0;
const PER_S: f64 = 64.0;

/// Of those in a row, so many are for addresses that did not come lately, and half of these for
/// those of sites of which not many came.
const RESERVED: f64 = BURST / 2.0;
const LATELY_NS: u64 = 1_000_000_000;
const MANY: usize = 8;

/// What becomes of a newcomer.
#[derive(Debug)]
pub(super) enum Verdict {
    Accept(Admitted),
    /// It has to prove its address.
    Retry,
    /// Not a word.
    Ignore,
}

/// A handshake that is let in.
#[derive(Debug)]
pub(super) struct Admitted {
    /// Its number, for [`Handshakes::ended`].
    pub number: u64,
    /// Ready when its place is another's.
    pub gives_way: oneshot::Receiver<()>,
}

/// One of those under way.
#[derive(Debug)]
struct UnderWay {
    number: u64,
    from: IpAddr,
    /// Sending it away is letting this go.
    _place: oneshot::Sender<()>,
}

/// The handshakes of one endpoint.
#[derive(Debug)]
pub(super) struct Handshakes {
    /// The oldest first.
    under_way: Vec<UnderWay>,
    /// When one of an address was let in last.
    lately: HashMap<IpAddr, u64>,
    admitted: u64,
    /// So many may come at once.
    room: f64,
    judged_ns: u64,
}

impl Handshakes {
    /// None yet.
    pub fn new(now_ns: u64) -> Self {
        let (under_way, lately) = (Vec::with_capacity(MOST), HashMap::new());
        Self { under_way, lately, admitted: 0, room: BURST, judged_ns: now_ns }
    }

    /// Judges a newcomer; one that is accepted is under way until [`Handshakes::ended`].
    pub fn judge(&mut self, from: IpAddr, proven: bool, now_ns: u64) -> Verdict {
        let passed_s = now_ns.saturating_sub(self.judged_ns) as f64 * 1e-9;
        self.judged_ns = now_ns;
        self.room = (self.room + passed_s * PER_S).min(BURST);
        if !proven {
            return Verdict::Retry;
        }
        if self.room < 1.0 || self.room < 1.0 + self.left_for_others(from, now_ns) {
            return Verdict::Ignore;
        }
        if self.under_way.len() >= MOST {
            let holder = |one: &UnderWay| Holder { from: one.from, silent: false };
            let holders: Vec<_> = self.under_way.iter().map(holder).collect();
            let Some(place) = gives_way(&holders, from) else { return Verdict::Ignore };
            self.under_way.remove(place);
        }
        Verdict::Accept(self.admit(from, now_ns))
    }

    /// What one of this address has to leave: all that is reserved where it came lately itself, half
    /// of it where many of its site did.
    fn left_for_others(&self, from: IpAddr, now_ns: u64) -> f64 {
        let lately = self.lately.iter().filter(|(_, ns)| now_ns.saturating_sub(**ns) < LATELY_NS);
        let mut of_site = lately.map(|(ip, _)| *ip).filter(|ip| site(*ip) == site(from));
        if of_site.clone().any(|ip| ip == from) {
            RESERVED
        } else if of_site.nth(MANY - 1).is_some() {
            0.5 * RESERVED
        } else {
            0.0
        }
    }

    fn admit(&mut self, from: IpAddr, now_ns: u64) -> Admitted {
        self.room -= 1.0;
        // No more than were let in within a second: the rate bounds this, too.
        self.lately.retain(|_, ns| now_ns.saturating_sub(*ns) < LATELY_NS);
        self.lately.insert(from, now_ns);
        self.admitted += 1;
        let (place, gives_way) = oneshot::channel();
        self.under_way.push(UnderWay { number: self.admitted, from, _place: place });
        Admitted { number: self.admitted, gives_way }
    }

    /// One that was accepted has come to its end, good or bad.
    pub fn ended(&mut self, number: u64) {
        self.under_way.retain(|one| one.number != number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    fn address(last: u8) -> IpAddr {
        [192, 0, 2, last].into()
    }

    fn come(door: &mut Handshakes, from: IpAddr, now_ns: u64) -> Option<Admitted> {
        match door.judge(from, true, now_ns) {
            Verdict::Accept(admitted) => Some(admitted),
            _ => None,
        }
    }

    /// Whoever never proves its address holds up nobody who does.
    #[test]
    fn a_flood_from_nowhere_takes_no_room() {
        let mut door = Handshakes::new(0);
        for i in 0..100_000_u64 {
            assert!(matches!(door.judge(address(i as u8), false, i * 1000), Verdict::Retry));
        }
        assert!(come(&mut door, address(1), SECOND).is_some());
    }

    #[test]
    fn the_rate_is_bounded_and_whoever_is_gone_is_forgotten() {
        let mut door = Handshakes::new(0);
        let mut all = 0;
        for ms in 0..10_000_u64 {
            for _ in 0..3 {
                if let Some(Admitted { number, .. }) = come(&mut door, address(3), ms * 1_000_000) {
                    door.ended(number);
                    all += 1;
                }
            }
        }
        assert!((600..=720).contains(&all), "{all} in ten seconds");
        assert_eq!((door.under_way.len(), door.lately.len()), (0, 1));
        come(&mut door, address(4), 20 * SECOND);
        assert_eq!(door.lately.len(), 1);
    }

    /// One attacker has many addresses of everybody's network.
    #[test]
    fn a_crowded_site_leaves_room_for_its_own_as_well() {
        let mut door = Handshakes::new(0);
        for ms in 0..5_000_u64 {
            let now_ns = ms * 1_000_000;
            for attacker in 1..=8 {
                if let Some(Admitted { number, .. }) = come(&mut door, address(attacker), now_ns) {
                    door.ended(number);
                }
            }
            if ms % 1_000 == 999 {
                assert!(come(&mut door, address(200), now_ns).is_some());
                assert!(come(&mut door, [10, 0, 0, 1].into(), now_ns).is_some());
            }
        }
    }

    /// Every handshake from another of its networks.
    #[test]
    fn a_site_of_many_networks_leaves_room_for_others() {
        let mut door = Handshakes::new(0);
        for ms in 0..5_000_u64 {
            let now_ns = ms * 1_000_000;
            let from = std::net::Ipv6Addr::new(0x2001, 0xdb8, 1, (ms % 256) as u16, 0, 0, 0, 1);
            if let Some(Admitted { number, .. }) = come(&mut door, from.into(), now_ns) {
                door.ended(number);
            }
            if ms % 1_000 == 999 {
                assert!(come(&mut door, address(200), now_ns).is_some());
            }
        }
    }

    /// Both halves of what an attacker can hold: the rate, and the places.
    #[test]
    fn those_who_come_all_the_time_leave_room_for_who_comes_seldom() {
        let mut door = Handshakes::new(0);
        let (mut held, mut guests) = (Vec::new(), Vec::new());
        for ms in 0..20_000_u64 {
            let now_ns = ms * 1_000_000;
            for attacker in [1, 2] {
                held.extend(come(&mut door, address(attacker), now_ns));
            }
            if ms % 2_000 == 1_999 {
                guests.push(come(&mut door, address(200), now_ns).expect("there is room"));
                assert!(door.under_way.len() <= MOST);
            }
        }
        let sent_away = |admitted: &mut Admitted| {
            admitted.gives_way.try_recv() == Err(oneshot::error::TryRecvError::Closed)
        };
        assert!(!guests.iter_mut().any(sent_away), "none of ten made room again");
        let gave_way = held.iter_mut().map(sent_away).filter(|gave_way| *gave_way).count();
        assert!(gave_way >= guests.len() && held.len() - gave_way == MOST - guests.len());
    }
}
