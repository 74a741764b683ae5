//! The protocol's name, and how two peers agree on it.

/// What this server and this client speak; also the ALPN of QUIC.
pub const PROTOCOL: &str = "hapticd/1";

/// The protocol to speak with a peer that offers these, best first; `None`: no common one.
pub fn choose(offered: &[String]) -> Option<&'static str> {
    offered.iter().any(|version| version == PROTOCOL).then_some(PROTOCOL)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_common_protocol_is_found_among_others_and_else_there_is_none() {
        let offer =
            |versions: &[&str]| choose(&versions.iter().map(|v| v.to_string()).collect::<Vec<_>>());
        assert_eq!(offer(&["hapticd/2", "hapticd/1"]), Some("hapticd/1"));
        assert_eq!(offer(&[]), None);
        assert_eq!(offer(&["hapticd/2", "hapticd", "hapticd/10", ""]), None);
    }
}
