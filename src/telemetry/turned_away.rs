//! What reached no session, by why.

use metrics::Counter;

use super::registry::Telemetry;
use super::table;

/// Why something that came from outside was turned away.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TurnedAway {
    /// A handshake has to prove its address first.
    HandshakeRetried,
    /// A handshake too many.
    HandshakeIgnored,
    /// A packet on the port of sealed UDP, of no association that is open.
    SealedUnknown,
    /// One of an association, and not sealed with its key.
    SealedForged,
    /// One that came before.
    SealedReplayed,
    /// A Hello or a call whose credential does not count, or does not allow it.
    Denied,
}

impl TurnedAway {
    /// Every reason.
    pub const ALL: [Self; 6] = [
        Self::HandshakeRetried,
        Self::HandshakeIgnored,
        Self::SealedUnknown,
        Self::SealedForged,
        Self::SealedReplayed,
        Self::Denied,
    ];

    /// Its name as a label.
    pub fn name(self) -> &'static str {
        match self {
            Self::HandshakeRetried => "handshake_retried",
            Self::HandshakeIgnored => "handshake_ignored",
            Self::SealedUnknown => "sealed_unknown",
            Self::SealedForged => "sealed_forged",
            Self::SealedReplayed => "sealed_replayed",
            Self::Denied => "denied",
        }
    }
}

/// Counts them.
#[derive(Clone, Debug)]
pub struct TurnedAwayMetrics(Vec<Counter>);

impl TurnedAwayMetrics {
    pub(super) fn new(telemetry: &Telemetry) -> Self {
        Self(telemetry.counters(&table::TURNED_AWAY, None))
    }

    /// One more.
    pub fn count(&self, why: TurnedAway) {
        self.0[why as usize].increment(1);
    }
}
