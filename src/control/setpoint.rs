//! What the stream thread hands to the next tick: the controller's newest command.

use crate::environment::{Contact, MAX_CONTACTS};

/// The newest command of the controller; all zero when there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setpoint {
    /// Fencing epoch of the lease it came under, 0 for no command ever.
    pub epoch: u64,
    /// The command's own number, 0 for none.
    pub seq: u64,
    /// The tick whose State it was computed from.
    pub state_tick: u64,
    /// Device time at which it was received.
    pub received_ns: u64,
    /// How long it holds from then.
    pub ttl_ns: u64,
    contacts: [Option<Contact>; MAX_CONTACTS],
    /// The owner let go on purpose: its force ends now, by the same ramp.
    pub released: bool,
}

impl Setpoint {
    /// No command.
    pub const NONE: Self = Self {
        epoch: 0,
        seq: 0,
        state_tick: 0,
        received_ns: 0,
        ttl_ns: 0,
        contacts: [None; MAX_CONTACTS],
        released: false,
    };

    /// The same command with these contacts; those beyond [`MAX_CONTACTS`] are dropped, so
    /// whoever maps a message checks the number first.
    #[must_use]
    pub fn with_contacts(mut self, contacts: &[Contact]) -> Self {
        self.contacts = [None; MAX_CONTACTS];
        for (place, contact) in self.contacts.iter_mut().zip(contacts) {
            *place = Some(*contact);
        }
        self
    }

    /// The local models it carries.
    pub fn contacts(&self) -> impl Iterator<Item = &Contact> {
        self.contacts.iter().flatten()
    }

    /// True while it may be rendered.
    pub fn is_fresh(&self, now_ns: u64) -> bool {
        self.seq != 0 && !self.released && now_ns.saturating_sub(self.received_ns) <= self.ttl_ns
    }
}

impl Default for Setpoint {
    fn default() -> Self {
        Self::NONE
    }
}
