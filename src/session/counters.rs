//! What the sessions count: datagrams by outcome, and commands that did not last.
//!
//! Totals only grow; the caller reads them whenever it publishes metrics.

use super::Transport;

/// What became of a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Understood and acted on.
    Accepted,
    /// Not a datagram of the protocol.
    Malformed,
    /// Longer than any datagram of the protocol.
    Oversize,
    /// A command of a session without the lease, or a hand's that does not pull.
    NotAllowed,
    /// A command not newer than the last.
    Old,
    /// A command with a value out of range.
    Invalid,
    /// A command computed from a State that is too old.
    Stale,
    /// A command that the session's quality is not good enough for.
    Quality,
    /// Before the handshake, of the wrong kind, or an answer to nothing.
    Unexpected,
    /// Taken by the transport.
    Sent,
    /// Found no room, here or in the transport, which lets the oldest go for a newer one.
    Dropped,
}

impl Outcome {
    /// Every outcome, for tables of metrics.
    pub const ALL: [Self; 11] = [
        Self::Accepted,
        Self::Malformed,
        Self::Oversize,
        Self::NotAllowed,
        Self::Old,
        Self::Invalid,
        Self::Stale,
        Self::Quality,
        Self::Unexpected,
        Self::Sent,
        Self::Dropped,
    ];

    /// The name used in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Malformed => "malformed",
            Self::Oversize => "oversize",
            Self::NotAllowed => "not_allowed",
            Self::Old => "old",
            Self::Invalid => "invalid",
            Self::Stale => "stale",
            Self::Quality => "quality",
            Self::Unexpected => "unexpected",
            Self::Sent => "sent",
            Self::Dropped => "dropped",
        }
    }

    /// The direction it belongs to, as metrics name it.
    pub fn direction(self) -> &'static str {
        match self {
            Self::Sent | Self::Dropped => "out",
            _ => "in",
        }
    }
}

/// Why a controller's force ended other than by a newer command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StaleReason {
    /// Its time-to-live ran out.
    Ttl,
    /// The controller's connection was lost, or it broke the protocol and was sent away.
    Disconnected,
    /// The controller said goodbye, or the server shut down.
    Released,
    /// Another controller took the lease.
    TakenOver,
    /// A wrench ended because 20 commands in a row were missed, before its time-to-live.
    Missed,
    /// Newer commands came and were refused for the session's quality.
    Quality,
    /// Newer commands came and were refused because they were computed from old States.
    Age,
}

impl StaleReason {
    /// Every reason, for tables of metrics.
    pub const ALL: [Self; 7] = [
        Self::Ttl,
        Self::Disconnected,
        Self::Released,
        Self::TakenOver,
        Self::Missed,
        Self::Quality,
        Self::Age,
    ];

    /// The name used in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ttl => "ttl",
            Self::Disconnected => "disconnected",
            Self::Released => "released",
            Self::TakenOver => "taken_over",
            Self::Missed => "missed",
            Self::Quality => "quality",
            Self::Age => "age",
        }
    }
}

/// Totals since the start.
#[derive(Clone, Debug, Default)]
pub struct Counters {
    datagrams: [[u64; Outcome::ALL.len()]; Transport::ALL.len()],
    stale: [u64; StaleReason::ALL.len()],
}

impl Counters {
    /// Datagrams of one transport with one outcome.
    pub fn datagrams(&self, transport: Transport, outcome: Outcome) -> u64 {
        self.datagrams[transport as usize][outcome as usize]
    }

    /// Forces that ended for one reason.
    pub fn stale(&self, reason: StaleReason) -> u64 {
        self.stale[reason as usize]
    }

    pub(super) fn count_datagram(&mut self, transport: Transport, outcome: Outcome) {
        self.datagrams[transport as usize][outcome as usize] += 1;
    }

    pub(super) fn count_stale(&mut self, reason: StaleReason) {
        self.stale[reason as usize] += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_has_its_own_name_and_place() {
        for (index, outcome) in Outcome::ALL.into_iter().enumerate() {
            assert_eq!(outcome as usize, index);
        }
        for (index, reason) in StaleReason::ALL.into_iter().enumerate() {
            assert_eq!(reason as usize, index);
        }
        let mut names = Outcome::ALL.map(Outcome::name).to_vec();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), Outcome::ALL.len());
    }
}
