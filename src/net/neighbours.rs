//! Who makes room where places run out: one of those who hold most of them.
//!
//! Whoever can have one address at an internet provider can have a few, and of IPv6 a whole
//! network of them; so addresses count by what one subscriber is given. With `n` attackers each
//! part of the network, a newcomer's too, gets at least one place in `n + 1`.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};

/// What one subscriber has: an IPv4 address, or the IPv6 addresses with the same first 64 bits.
pub(super) fn neighbourhood(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V4(address) => address.into(),
        IpAddr::V6(address) => {
            Ipv6Addr::from_bits(address.to_bits() & !u128::from(u64::MAX)).into()
        }
    }
}

/// Which of those who hold a place, the oldest first, has to give it to a newcomer: the oldest of
/// the neighbourhood that holds most of them. None, where the newcomer's would hold as many then.
pub(super) fn gives_way(
    holders: impl Iterator<Item = IpAddr> + Clone,
    newcomer: IpAddr,
) -> Option<usize> {
    let mut held: HashMap<IpAddr, usize> = HashMap::new();
    holders.clone().for_each(|holder| *held.entry(holder).or_default() += 1);
    let most = held.values().copied().max()?;
    let own = held.get(&newcomer).copied().unwrap_or_default();
    if most <= own + 1 {
        return None;
    }
    holders.into_iter().position(|holder| held.get(&holder) == Some(&most))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str) -> IpAddr {
        neighbourhood(text.parse().unwrap())
    }

    #[test]
    fn an_ipv6_network_is_one_neighbour_and_so_is_an_ipv4_address_however_written() {
        assert_eq!(at("2001:db8:1:2::1"), at("2001:db8:1:2:ffff:ffff:ffff:ffff"));
        assert_ne!(at("2001:db8:1:2::1"), at("2001:db8:1:3::1"));
        assert_eq!(at("::ffff:192.0.2.7"), at("192.0.2.7"));
        assert_ne!(at("192.0.2.7"), at("192.0.2.8"));
    }

    #[test]
    fn who_holds_most_gives_way_until_the_newcomer_holds_as_much() {
        let (anna, mallory, bert) = (at("192.0.2.1"), at("192.0.2.2"), at("192.0.2.3"));
        let held = [anna, mallory, mallory, bert];
        assert_eq!(gives_way(held.into_iter(), at("192.0.2.4")), Some(1));
        assert_eq!(gives_way(held.into_iter(), anna), None, "one of two would only change hands");
        assert_eq!(gives_way(held.into_iter(), mallory), None);
        assert_eq!(gives_way([anna, bert].into_iter(), mallory), None, "nobody holds more");
        assert_eq!(gives_way([anna; 3].into_iter(), bert), Some(0), "the oldest");
        assert_eq!(gives_way([].into_iter(), bert), None);
    }

    #[test]
    fn two_attackers_leave_a_third() {
        let [mallory, trudy, anna] = ["192.0.2.2", "192.0.2.3", "2001:db8::1"].map(at);
        let mut held: Vec<_> = [mallory, trudy].into_iter().cycle().take(64).collect();
        let mut come = |who| {
            if let Some(place) = gives_way(held.iter().copied(), who) {
                held.remove(place);
                held.push(who);
            }
            held.iter().filter(|holder| **holder == anna).count()
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
