//! Who makes room where places run out: one of those who hold most of them.
//!
//! Whoever can have one address at an internet provider can have a few, and of IPv6 whole networks
//! of them. So holders are counted by networks, the smallest first and then by ever larger ones,
//! until one of them holds more than the newcomer's would. With `n` attackers, each of one
//! network, a newcomer's network gets at least one place in `n + 1`. Where there are as many
//! attackers as places, far from one another, nothing is promised to anybody.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

/// Leading bits of networks, the smallest first: of IPv4 an address, and what is handed out; of
/// IPv6 what one line, one house and one site is given (RFC 6177).
const V4_BITS: [u32; LEVELS] = [32, 24, 16];
const V6_BITS: [u32; LEVELS] = [64, 56, 48];
const LEVELS: usize = 3;

/// Somebody in a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Holder {
    pub from: IpAddr,
    /// It has said nothing yet.
    pub silent: bool,
}

/// The smallest network of an address.
pub(super) fn neighbourhood(address: IpAddr) -> IpAddr {
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

/// Which of those who hold a place, the oldest first, has to give it to a newcomer: one of the
/// network that holds most of them, the silent first. Where none holds more than the newcomer's
/// would, a silent one of its own; else nobody.
pub(super) fn gives_way(holders: &[Holder], newcomer: IpAddr) -> Option<usize> {
    let of_most = (0..LEVELS).find_map(|level| of_most(holders, newcomer, level));
    let own = |holder: &Holder| neighbourhood(holder.from) == neighbourhood(newcomer);
    of_most.or_else(|| holders.iter().position(|holder| holder.silent && own(holder)))
}

fn of_most(holders: &[Holder], newcomer: IpAddr, level: usize) -> Option<usize> {
    let mut held: HashMap<IpAddr, usize> = HashMap::new();
    for holder in holders {
        *held.entry(network(holder.from, level)).or_default() += 1;
    }
    let most = held.values().copied().max()?;
    let own = held.get(&network(newcomer, level)).copied().unwrap_or_default();
    if most <= own + 1 {
        return None;
    }
    let holds_most = |holder: &Holder| held.get(&network(holder.from, level)) == Some(&most);
    let silent = holders.iter().position(|holder| holder.silent && holds_most(holder));
    silent.or_else(|| holders.iter().position(holds_most))
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
    fn an_ipv6_network_is_one_neighbour_and_so_is_an_ipv4_address_however_written() {
        let same = |one, other| neighbourhood(at(one)) == neighbourhood(at(other));
        assert!(same("2001:db8:1:2::1", "2001:db8:1:2:ffff:ffff:ffff:ffff"));
        assert!(!same("2001:db8:1:2::1", "2001:db8:1:3::1"));
        assert!(same("::ffff:192.0.2.7", "192.0.2.7"));
        assert!(!same("192.0.2.7", "192.0.2.8"));
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
    fn many_networks_of_one_site_are_seen_for_what_they_are() {
        let mallory: Vec<_> = (0..64).map(|n| format!("2001:db8:1:{n:x}::1")).collect();
        let held = speaking(&mallory.iter().map(String::as_str).collect::<Vec<_>>());
        assert_eq!(gives_way(&held, at("2001:db8:2::1")), Some(0));
        assert_eq!(gives_way(&held, at("192.0.2.1")), Some(0));
        assert_eq!(gives_way(&held, at("2001:db8:1:ff::1")), None);
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
