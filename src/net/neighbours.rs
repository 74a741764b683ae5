//! Who makes room where places run out: one of those who hold most of them.
//!
//! Whoever can have one address at an internet provider can have a few, and of IPv6 whole networks
//! of them. So holders are counted by networks, the largest first: of two the one that holds
//! more has to give, in it the smaller network that holds most, and so on to the address. With `n`
//! attackers, each of one network, a newcomer's network gets at least one place in `n + 1`; inside
//! a network the same holds of its parts. Where there are as many attackers as places, far from
//! one another, nothing is promised to anybody.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

/// Leading bits of networks, the largest first: of IPv4 what is handed out, and an address; of
/// IPv6 what one site, one house, one line is given (RFC 6177), and an address.
const V4_BITS: [u32; LEVELS] = [16, 24, 32, 32];
const V6_BITS: [u32; LEVELS] = [48, 56, 64, 128];
const LEVELS: usize = 4;

/// Somebody in a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Holder {
    pub from: IpAddr,
    /// It has said nothing yet.
    pub silent: bool,
}

/// The largest network of an address that counts as one.
pub(super) fn site(address: IpAddr) -> IpAddr {
    network(address, 0)
}

fn network(address: IpAddr, level: usize) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V4(address) => {
            let mask = u32::MAX << (u32::BITS - V4_BITS[level]);
            Ipv4Addr::from_bits(address.to_bits() & mask).into()
        }
        IpAddr::V6(address) => {
            let mask = u128::MAX << (u128::BITS - V6_BITS[level]);
            Ipv6Addr::from_bits(address.to_bits() & mask).into()
        }
    }
}

/// Which of those who hold a place, the oldest first, has to give it to a newcomer: one of those
/// who hold more than the newcomer's would, the silent first. Where there are none, a silent one
/// of its own network; else nobody.
pub(super) fn gives_way(holders: &[Holder], newcomer: IpAddr) -> Option<usize> {
    let mut among: Vec<usize> = (0..holders.len()).collect();
    let mut elsewhere = false;
    for level in 0..LEVELS {
        let of = |place: &usize| network(holders[*place].from, level);
        let mut held: HashMap<IpAddr, usize> = HashMap::new();
        among.iter().for_each(|place| *held.entry(of(place)).or_default() += 1);
        let own = network(newcomer, level);
        let own_held = held.get(&own).copied().unwrap_or_default();
        let most = held.values().copied().max()?;
        elsewhere |= most > own_held + 1;
        if !elsewhere && own_held == 0 && level > 0 {
            break; // a newcomer to its network, of those who hold no more than it would
        }
        // Of those that hold as many, the one with the oldest who is silent, or else the oldest.
        let silent = among.iter().filter(|place| holders[**place].silent);
        let mut first = silent.chain(&among).map(of);
        let fullest = first.find(|network| held.get(network) == Some(&most))?;
        let chosen = if elsewhere { fullest } else { own };
        among.retain(|place| of(place) == chosen);
    }
    let silent = among.iter().find(|place| holders[**place].silent);
    silent.or(among.first().filter(|_| elsewhere)).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    fn speaking(from: &[&str]) -> Vec<Holder> {
        from.iter().map(|from| Holder { from: at(from), silent: false }).collect()
    }

    #[test]
    fn a_site_is_one_and_so_is_an_ipv4_address_however_written() {
        let same = |one, other| site(at(one)) == site(at(other));
        assert!(same("2001:db8:1:2::1", "2001:db8:1:ffff::1"));
        assert!(!same("2001:db8:1:2::1", "2001:db8:2:2::1"));
        assert!(same("::ffff:192.0.2.7", "192.0.2.7") && !same("192.0.2.7", "198.51.100.7"));
    }

    #[test]
    fn who_holds_most_gives_way_until_the_newcomer_holds_as_much() {
        let (anna, mallory) = ("10.0.0.1", "192.0.2.2");
        let held = speaking(&[anna, mallory, mallory, "172.16.0.3"]);
        assert_eq!(gives_way(&held, at("198.51.100.4")), Some(1));
        assert_eq!(gives_way(&held, at(anna)), None, "one of two would only change hands");
        assert_eq!(gives_way(&held, at(mallory)), None);
        assert_eq!(gives_way(&speaking(&[anna, "172.16.0.3"]), at(mallory)), None);
        assert_eq!(gives_way(&speaking(&[anna; 3]), at(mallory)), Some(0), "the oldest");
        assert_eq!(gives_way(&[], at(mallory)), None);
    }

    #[test]
    fn the_silent_go_first_but_only_of_who_holds_most_or_of_the_newcomers_own() {
        let (anna, mallory) = ("10.0.0.1", "192.0.2.2");
        let mut held = speaking(&[mallory, mallory, mallory, anna]);
        held[3].silent = true;
        assert_eq!(gives_way(&held, at("172.16.0.3")), Some(0), "not who is about to speak");
        assert_eq!(gives_way(&held, at(mallory)), None, "least of all for who has the rest");
        held[1].silent = true;
        assert_eq!(gives_way(&held, at("172.16.0.3")), Some(1));
        assert_eq!(gives_way(&held, at(mallory)), Some(1), "its own");
    }

    #[test]
    fn among_those_who_hold_one_each_the_silent_go_first() {
        let mut held = speaking(&["10.0.0.1"]);
        let silent = |n: u8| Holder { from: [10, 0, 0, n].into(), silent: true };
        held.extend((2..100).map(silent));
        assert_eq!(gives_way(&held, at("192.0.2.1")), Some(1));
        assert_eq!(gives_way(&held, at("10.0.0.200")), Some(1), "of its own network, too");
        held.truncate(1);
        assert_eq!(gives_way(&held, at("10.0.0.200")), None);
    }

    #[test]
    fn many_networks_of_one_site_are_seen_for_what_they_are() {
        let mallory: Vec<_> = (0..64).map(|n| format!("2001:db8:1:{n:x}::1")).collect();
        let held = speaking(&mallory.iter().map(String::as_str).collect::<Vec<_>>());
        assert_eq!(gives_way(&held, at("2001:db8:2::1")), Some(0));
        assert_eq!(gives_way(&held, at("192.0.2.1")), Some(0));
        assert_eq!(gives_way(&held, at("2001:db8:1:ff::1")), None);
    }

    /// Whoever uses each of its addresses once holds no less for it.
    #[test]
    fn many_addresses_win_nothing_against_one_that_holds_a_few() {
        let [honest, another] = ["10.0.0.1", "10.0.0.2"];
        let mut held = speaking(&[honest; 20]);
        let mut fresh = 0_u32;
        while held.len() < 128 {
            fresh += 1;
            held.extend(speaking(&[&format!("198.51.100.{fresh}")]));
        }
        let count = |held: &[Holder], who| held.iter().filter(|h| h.from == at(who)).count();
        for _ in 0..1000 {
            fresh += 1;
            let attacker = format!("198.51.{}.{}", 100 + fresh / 256 % 4, fresh % 256);
            if let Some(place) = gives_way(&held, at(&attacker)) {
                held.remove(place);
                held.extend(speaking(&[&attacker]));
            }
            assert_eq!(count(&held, honest), 20);
        }
        for _ in 0..100 {
            if let Some(place) = gives_way(&held, at(another)) {
                held.remove(place);
                held.extend(speaking(&[another]));
            }
        }
        assert_eq!(count(&held, honest) + count(&held, another), 64, "half for each of two sites");
    }

    #[test]
    fn on_one_local_network_hosts_are_told_apart() {
        let held = speaking(&["fd00::1"; 8]);
        assert_eq!(gives_way(&held, at("fd00::2")), Some(0));
        assert_eq!(gives_way(&held, at("fd00::1")), None);
    }

    #[test]
    fn two_attackers_leave_a_third() {
        let [mallory, trudy, anna] = ["192.0.2.2", "198.51.100.3", "2001:db8::1"];
        let mut held: Vec<_> = speaking(&[mallory, trudy]).into_iter().cycle().take(64).collect();
        let mut come = |who: &str| {
            if let Some(place) = gives_way(&held, at(who)) {
                held.remove(place);
                held.extend(speaking(&[who]));
            }
            held.iter().filter(|holder| holder.from == at(anna)).count()
        };
        for _ in 0..64 {
            come(anna);
        }
        for _ in 0..1000 {
            come(mallory);
            assert!((21..=22).contains(&come(trudy)));
        }
    }
}
