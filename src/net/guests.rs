//! Who is behind the sessions of the stream: judged when they say Hello, and again while they
//! stay; what becomes of them and of the leases is told to the audit log.

use std::collections::HashMap;
use std::sync::Arc;

use super::gate::{Caller, Gate, Refused};
use crate::audit::What;
use crate::credentials::Grant;
use crate::proto::{self, Hello};
use crate::sealed::AssociationId;
use crate::session::{LeaseInfo, Role, SessionId, SessionInfo, Switchboard};

/// The sessions' people.
pub(super) struct Guests {
    gate: Arc<Gate>,
    known: HashMap<SessionId, Guest>,
    /// Sessions that there can be.
    most: usize,
    /// Of each device, as last told.
    leases: Vec<LeaseInfo>,
}

/// Somebody behind a session.
#[derive(Clone, Debug)]
pub(super) struct Guest {
    pub caller: Caller,
    pub from: String,
    pub device: String,
    /// Whose call has sent it away.
    pub closed_by: Option<String>,
    /// Over which it was to come.
    pub association: Option<AssociationId>,
}

impl Guests {
    /// Nobody yet, of so many.
    pub fn new(gate: Arc<Gate>, most: usize) -> Self {
        Self { gate, known: HashMap::new(), most, leases: Vec::new() }
    }

    /// Judges a Hello with a token: who it is, for this device and the role that it asks for.
    pub fn judge(&self, hello: &Hello, device: &str, from: String) -> Result<Guest, Refused> {
        let device = device.to_owned();
        let caller = self.gate.judge(&hello.token).inspect_err(|denied| {
            let refused = Refused::from(denied.clone());
            self.gate.record_refused(refused.who(), &from, &device, &refused.to_string());
        })?;
        let guest = Guest { caller, from, device, closed_by: None, association: None };
        self.check(&guest, hello)?;
        Ok(guest)
    }

    /// Judges the role that a Hello asks for, and whether there is another session for its
    /// credential.
    pub fn check(&self, guest: &Guest, hello: &Hello) -> Result<(), Refused> {
        let Guest { caller, from, device, .. } = guest;
        let allowed = caller.holder().check(needed_for(hello.role), device);
        let checked = allowed.map_err(Refused::from).and_then(|()| self.check_share(caller));
        checked.inspect_err(|refused| {
            self.gate.record_refused(caller.name(), from, device, &refused.to_string());
        })
    }

    /// One credential has half of all sessions at most, so that it keeps nobody out.
    fn check_share(&self, caller: &Caller) -> Result<(), Refused> {
        let (name, most) = (caller.name(), self.most);
        let held = self.known.values().filter(|guest| guest.caller.name() == name).count();
        if self.gate.is_guarded() && held >= (most / 2).max(1) {
            return Err(Refused::Share { name: name.to_owned(), held, most });
        }
        Ok(())
    }

    /// A session was opened for it.
    pub fn arrived(&mut self, session: SessionId, guest: Guest, info: &SessionInfo<'_>) {
        let detail = format!("{session}: {}, {}", info.role.name(), info.client_name);
        self.tell(What::SessionOpened, &guest, &detail);
        self.known.insert(session, guest);
    }

    /// A session that was opened by a call has its stream, from there.
    pub fn joined(&mut self, session: SessionId, from: String) {
        if let Some(guest) = self.known.get_mut(&session) {
            guest.from = from;
        }
    }

    /// Somebody has sent it away; that it is over is told by [`Guests::left`].
    pub fn closed_by(&mut self, session: SessionId, by: &str) {
        if let Some(guest) = self.known.get_mut(&session) {
            guest.closed_by = Some(by.to_owned());
        }
    }

    /// The session is over. Returns over what it was to come, if it was not to come otherwise.
    pub fn left(&mut self, session: SessionId, why: &str) -> Option<AssociationId> {
        let guest = self.known.remove(&session)?;
        let by = guest.closed_by.as_ref().map(|by| format!(" of {by}")).unwrap_or_default();
        self.tell(What::SessionClosed, &guest, &format!("{session}: {why}{by}"));
        guest.association
    }

    /// Tells which leases are others than when it was last told; by the caller of the call that
    /// was just carried out, else by those whose leases they are.
    pub fn watch_leases(&mut self, sessions: &Switchboard, by: Option<&(Caller, String)>) {
        for (place, device) in sessions.devices().enumerate() {
            let now = device.lease();
            if self.leases.len() <= place {
                self.leases.push(LeaseInfo { holder: None, epoch: 0 });
            }
            let before = std::mem::replace(&mut self.leases[place], now);
            if now != before {
                self.tell_lease(&device.device_name(), before.holder, now, by);
            }
        }
    }

    fn tell_lease(
        &self,
        device: &str,
        before: Option<SessionId>,
        now: LeaseInfo,
        by: Option<&(Caller, String)>,
    ) {
        let owner = |session: SessionId| {
            self.known.get(&session).map_or("?", |guest| guest.caller.name()).to_owned()
        };
        let named = |session: SessionId| format!("{session} of {}", owner(session));
        let (what, holder, detail) = match (before, now.holder) {
            (Some(loser), Some(holder)) => {
                let lost = format!("{} from {}", named(holder), named(loser));
                (What::Takeover, Some(holder), format!("{lost}, epoch {}", now.epoch))
            }
            (None, Some(holder)) => {
                let detail = format!("{}, epoch {}", named(holder), now.epoch);
                (What::LeaseAcquired, Some(holder), detail)
            }
            (loser, None) => (What::LeaseReleased, loser, loser.map(named).unwrap_or_default()),
        };
        let guest = holder.and_then(|session| self.known.get(&session));
        let guest = guest.map(|guest| (guest.caller.clone(), guest.from.clone()));
        let (who, from) = by.cloned().or(guest).unwrap_or((Caller::local(), String::new()));
        self.gate.record(what, &who, &from, device, &detail);
    }

    /// Whether this caller may decide about a session: its own, or as an operator of its device.
    pub fn may_decide(&self, session: SessionId, caller: &Caller) -> Result<(), Refused> {
        let Some(guest) = self.known.get(&session) else { return Ok(()) };
        caller.holder().check_device(&guest.device)?;
        if guest.caller.name() != caller.name() {
            caller.holder().check_grant(Grant::Operator)?;
        }
        Ok(())
    }

    /// Whether whoever is behind a session may command its device.
    pub fn may_command(&self, session: SessionId) -> Result<(), Refused> {
        let Some(guest) = self.known.get(&session) else { return Ok(()) };
        Ok(guest.caller.holder().check(Grant::Controller, &guest.device)?)
    }

    /// Those who are there, to be judged again one by one.
    pub fn sessions(&self) -> Vec<SessionId> {
        if self.gate.is_guarded() { self.known.keys().copied().collect() } else { Vec::new() }
    }

    /// Why somebody who was let in may not stay.
    pub fn judge_again(&self, session: SessionId, role: Role) -> Option<Refused> {
        let guest = self.known.get(&session)?;
        let needed = if role == Role::Observer { Grant::Observer } else { Grant::Controller };
        let refused = self.gate.still(&guest.caller, needed, &guest.device).err()?;
        self.gate.record_refused(
            guest.caller.name(),
            &guest.from,
            &guest.device,
            &refused.to_string(),
        );
        Some(refused)
    }

    fn tell(&self, what: What, guest: &Guest, detail: &str) {
        self.gate.record(what, &guest.caller, &guest.from, &guest.device, detail);
    }
}

/// What a role takes; one that is none is refused for that.
fn needed_for(role: i32) -> Grant {
    match proto::Role::try_from(role) {
        Ok(proto::Role::Controller | proto::Role::Hand) => Grant::Controller,
        _ => Grant::Observer,
    }
}
