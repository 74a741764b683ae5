//! What can carry a session, by the names that command lines use.

use std::fmt;
use std::str::FromStr;

/// What carries a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Transport {
    /// QUIC datagrams and a stream.
    #[default]
    Quic,
    /// The same inside HTTP/3, as browsers do it.
    WebTransport,
    /// Sealed datagrams over plain UDP.
    Udp,
}

impl Transport {
    /// Every one.
    pub const ALL: [Self; 3] = [Self::Quic, Self::WebTransport, Self::Udp];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Quic => "quic",
            Self::WebTransport => "webtransport",
            Self::Udp => "udp",
        }
    }
}

impl fmt::Display for Transport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Transport {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let found = Self::ALL.into_iter().find(|transport| transport.name() == name);
        found.ok_or_else(|| "must be quic, webtransport or udp".to_owned())
    }
}
