//! What can be done to a session from outside its stream: opened, closed, given the lease.
//!
//! An operator's calls, judged by the same lease and the same handshake as a stream's own
//! messages. A session that was opened by a call waits for a stream, and holds what it was
//! granted meanwhile, the lease too; nothing is sent to it and it cannot command.

use crate::proto::{ByeReason, Hello, Welcome};

use super::handshake::{self, Refusal};
use super::peer::Peer;
use super::{Role, SessionId, SessionInfo, Sessions, StaleReason, TooManySessions, Transport};

/// What a stream shows to join a session that a call has opened: not to be guessed.
pub type Ticket = [u8; 16];

/// Why a call did nothing.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CallRefusal {
    /// No welcomed session has this name.
    #[error("there is no session {0:?}")]
    Unknown(String),
    /// Its role can never command.
    #[error("{0} pulls a handle and cannot command")]
    Hand(SessionId),
    /// It does not command.
    #[error("{0} does not hold the lease")]
    NoLease(SessionId),
    /// What Bye would say to a Hello like that.
    #[error("{detail}")]
    Refused { reason: ByeReason, detail: String },
}

impl From<Refusal> for CallRefusal {
    fn from(Refusal { reason, detail }: Refusal) -> Self {
        Self::Refused { reason, detail }
    }
}

impl From<TooManySessions> for CallRefusal {
    fn from(full: TooManySessions) -> Self {
        Self::Refused { reason: ByeReason::TooManySessions, detail: full.to_string() }
    }
}

/// Who commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LeaseInfo {
    /// The session; `None`: nobody.
    pub holder: Option<SessionId>,
    /// 0 while nobody commands.
    pub epoch: u64,
}

impl Sessions {
    /// Opens a session for a stream that is to join it with this ticket.
    pub(super) fn open_by_call(
        &mut self,
        id: SessionId,
        hello: &Hello,
        ticket: Ticket,
        now_ns: u64,
    ) -> Result<Welcome, CallRefusal> {
        self.peers.insert(id, Peer::waiting(ticket, now_ns));
        if let Err(refusal) = self.admit(id, hello, now_ns) {
            self.peers.remove(&id);
            return Err(refusal.into());
        }
        self.tell_lease_of(id, now_ns);
        self.welcome_of(id, now_ns).ok_or_else(|| CallRefusal::Unknown(id.to_string()))
    }

    /// The session that waits for the stream with this ticket.
    pub(super) fn waiting_with(&self, ticket: &[u8]) -> Option<SessionId> {
        let waits = |(_, peer): &(&SessionId, &Peer)| {
            peer.waiting.as_ref().is_some_and(|waiting| waiting[..] == *ticket)
        };
        self.peers.iter().find(waits).map(|(id, _)| *id)
    }

    /// The stream that a session waited for is there, and is told what was granted.
    pub(super) fn join_waiting(&mut self, id: SessionId, transport: Transport, now_ns: u64) {
        if let Some(peer) = self.peers.get_mut(&id) {
            peer.join(transport, now_ns);
            self.say_welcome(id, now_ns);
            self.watch_hand(now_ns);
        }
    }

    /// A stream came with a ticket that no session waits for, or in another version.
    pub(super) fn refuse_ticket(&mut self, id: SessionId, hello: &Hello, now_ns: u64) {
        match handshake::check_version(hello) {
            Ok(()) => {
                let said =
                    "ticket: no session waits for it: it was joined already, or not within 10 s";
                self.broken(id, said, now_ns);
            }
            Err(Refusal { reason, detail }) => {
                self.close(id, reason, &detail, StaleReason::Disconnected, now_ns);
            }
        }
    }

    /// Sends a session away.
    pub fn close_by_call(&mut self, id: SessionId, now_ns: u64) -> Result<(), CallRefusal> {
        self.welcomed(id)?;
        let said = "the session was closed by a call";
        self.close(id, ByeReason::Closed, said, StaleReason::Released, now_ns);
        Ok(())
    }

    /// Makes a session the controller. One that is already stays it, under the same epoch.
    pub fn acquire_lease(
        &mut self,
        id: SessionId,
        takeover: bool,
        now_ns: u64,
    ) -> Result<LeaseInfo, CallRefusal> {
        match self.welcomed(id)? {
            Role::Hand => return Err(CallRefusal::Hand(id)),
            _ if self.lease.holder() == Some(id) => return Ok(self.lease()),
            _ => {}
        }
        self.grant_lease(id, takeover, now_ns)?;
        if let Some(open) = self.peers.get_mut(&id).and_then(|peer| peer.open.as_mut()) {
            open.promote();
        }
        self.tell_lease_of(id, now_ns);
        Ok(self.lease())
    }

    /// Makes the controller an observer; its force fades by the ramp.
    pub fn release_lease(&mut self, id: SessionId, now_ns: u64) -> Result<LeaseInfo, CallRefusal> {
        self.welcomed(id)?;
        if self.lease.holder() != Some(id) {
            return Err(CallRefusal::NoLease(id));
        }
        self.end_lease(id, StaleReason::Released, now_ns);
        if let Some(open) = self.peers.get_mut(&id).and_then(|peer| peer.open.as_mut()) {
            open.demote();
        }
        Ok(self.lease())
    }

    /// Who commands.
    pub fn lease(&self) -> LeaseInfo {
        LeaseInfo { holder: self.lease.holder(), epoch: self.lease.epoch() }
    }

    /// What lists show of one session.
    pub fn info(&self, id: SessionId, now_ns: u64) -> Option<SessionInfo<'_>> {
        self.peers.get(&id)?.info(id, now_ns)
    }

    fn welcomed(&self, id: SessionId) -> Result<Role, CallRefusal> {
        let open = self.peers.get(&id).and_then(|peer| peer.open.as_ref());
        open.map(|open| open.role).ok_or_else(|| CallRefusal::Unknown(id.to_string()))
    }
}
