//! The address that others reach this machine by, for a server that listens on all of them.
//!
//! Nobody is asked and nothing is sent: first the address of the interface that the default
//! route uses, else the first one of this machine that is not loopback. A machine with
//! neither can only be reached from itself. An address and no name, because a name that
//! nobody resolves is worth less.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

/// Addresses of documentation (RFC 5737, RFC 3849): no interface has them, so the way there
/// is the default route.
const ELSEWHERE: [IpAddr; 2] = [
    IpAddr::V4(Ipv4Addr::new(192, 0, 2, 1)),
    IpAddr::V6(Ipv6Addr::new(0x2001, 0xdb8, 0, 0, 0, 0, 0, 1)),
];

/// Where clients reach what listens on `listen`.
pub fn address(listen: IpAddr) -> IpAddr {
    if !listen.is_unspecified() {
        return listen;
    }
    let routed = ELSEWHERE.into_iter().filter(|far| listen.is_ipv6() || far.is_ipv4());
    let routed = routed.filter_map(source_towards).find(|ip| !ip.is_loopback());
    routed.or_else(first_local).unwrap_or(match listen {
        IpAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
    })
}

/// The address that a packet to `far` would come from.
fn source_towards(far: IpAddr) -> Option<IpAddr> {
    let any = match far {
        IpAddr::V4(_) => IpAddr::V4(Ipv4Addr::UNSPECIFIED),
        IpAddr::V6(_) => IpAddr::V6(Ipv6Addr::UNSPECIFIED),
    };
    let socket = UdpSocket::bind(SocketAddr::new(any, 0)).ok()?;
    // Connecting a UDP socket chooses the route and sends nothing.
    socket.connect(SocketAddr::new(far, 9)).ok()?;
    Some(socket.local_addr().ok()?.ip())
}

fn first_local() -> Option<IpAddr> {
    local_in(&std::fs::read_to_string("/proc/net/fib_trie").ok()?)
}

/// The first address that is this machine's own in the kernel's table of routes: a line with
/// the address, then one with `/32 host LOCAL`.
fn local_in(table: &str) -> Option<IpAddr> {
    let mut last = None;
    for line in table.lines().map(str::trim) {
        match line.strip_prefix("|-- ") {
            Some(address) => last = address.parse::<Ipv4Addr>().ok(),
            None if line == "/32 host LOCAL" => {
                if let Some(address) = last.filter(|address| !address.is_loopback()) {
                    return Some(address.into());
                }
            }
            None => {}
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_address_of_the_machine_itself_is_found() {
        let table = "Local:\n  +-- 0.0.0.0/0 3 0 5\n     |-- 0.0.0.0\n        /0 universe UNICAST\n\
                     \n           |-- 127.0.0.1\n              /32 host LOCAL\n     |-- 10.1.2.0\n\
                     \n        /24 link UNICAST\n        |-- 10.1.2.3\n           /32 host LOCAL\n";
        assert_eq!(local_in(table), Some("10.1.2.3".parse().unwrap()));
        assert_eq!(local_in("Main:\n"), None);
    }

    #[test]
    fn what_is_printed_can_be_connected_to() {
        for listen in ["0.0.0.0", "::"] {
            assert!(!address(listen.parse().unwrap()).is_unspecified());
        }
        for listen in ["127.0.0.1", "10.9.9.9", "::1"] {
            assert_eq!(address(listen.parse().unwrap()).to_string(), listen);
        }
    }
}
