//! The lease: who commands, one at a time, under an epoch that only grows.
//!
//! ```text
//!          grant: epoch + 1
//!  ┌──────┐ ─────────────▶ ┌──────┐ ── grant to another: refused,
//!  │ free │                │ held │    or with takeover: epoch + 1
//!  └──────┘ ◀───────────── └──────┘
//!              end, by the holder's session only
//! ```
//!
//! The epoch fences: whatever came under an older one can be told from what is in force.

use super::SessionId;

/// Somebody else holds the lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Held {
    pub by: SessionId,
}

/// The lease of one device.
#[derive(Debug, Default)]
pub(super) struct Lease {
    epoch: u64,
    holder: Option<SessionId>,
}

impl Lease {
    /// Gives the lease to a session, under a new epoch; with `takeover` from whoever holds
    /// it, who is returned.
    pub fn grant(&mut self, to: SessionId, takeover: bool) -> Result<Option<SessionId>, Held> {
        match self.holder {
            Some(by) if !takeover || by == to => Err(Held { by }),
            loser => {
                self.holder = Some(to);
                self.epoch += 1;
                Ok(loser)
            }
        }
    }

    /// Ends the lease if this session holds it; true when it did.
    pub fn end(&mut self, by: SessionId) -> bool {
        let held = self.holder == Some(by);
        if held {
            self.holder = None;
        }
        held
    }

    /// Who may command.
    pub fn holder(&self) -> Option<SessionId> {
        self.holder
    }

    /// The epoch in force, 0 while nobody holds the lease.
    pub fn epoch(&self) -> u64 {
        if self.holder.is_some() { self.epoch } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: SessionId = SessionId(1);
    const B: SessionId = SessionId(2);

    #[test]
    fn one_session_holds_it_and_the_next_gets_a_higher_epoch() {
        let mut lease = Lease::default();
        assert_eq!(lease.epoch(), 0);
        assert_eq!((lease.grant(A, false), lease.epoch()), (Ok(None), 1));
        assert_eq!(lease.grant(B, false), Err(Held { by: A }));
        assert_eq!(lease.grant(A, true), Err(Held { by: A }), "not even its holder twice");
        assert!(!lease.end(B), "only the holder ends it");
        assert_eq!((lease.holder(), lease.epoch()), (Some(A), 1));
        assert!(lease.end(A));
        assert_eq!((lease.holder(), lease.epoch()), (None, 0));
        assert_eq!((lease.grant(B, true), lease.epoch()), (Ok(None), 2));
    }

    #[test]
    fn a_takeover_names_the_loser_whose_end_ends_nothing() {
        let mut lease = Lease::default();
        lease.grant(A, false).unwrap();
        assert_eq!(lease.grant(B, true), Ok(Some(A)));
        assert_eq!((lease.holder(), lease.epoch()), (Some(B), 2));
        assert!(!lease.end(A));
        assert_eq!(lease.grant(A, true), Ok(Some(B)), "and back");
        assert_eq!(lease.epoch(), 3);
    }
}
