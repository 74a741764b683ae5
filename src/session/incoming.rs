//! What each message of a client does to the sessions, and how a session ends.
//!
//! A refused Hello closes its own connection and touches nothing else; a refused Command
//! leaves everything as it was. Ending a session, for whatever reason, ends its lease in
//! the same call. Where it ends by Bye or for breaking the rules, the setpoint goes out once
//! more, released: what it asked for fades by the tick's own ramp.

use crate::proto::datagram::Body as DatagramBody;
use crate::proto::{ByeReason, Command, Hello, Ping, Pong};
use crate::wire;

use super::command::{self, Context, Refusal};
use super::handshake::{self, Terms};
use super::peer::Open;
use super::state::Echo;
use super::{Outcome, Output, Role, SessionId, Sessions, StaleReason, events, ping, send};

impl Sessions {
    pub(super) fn on_hello(&mut self, id: SessionId, hello: &Hello, now_ns: u64) {
        let agreed = handshake::agree(hello, &self.config);
        match agreed.and_then(|terms| Ok((self.lease_for(id, &terms)?, terms))) {
            Ok((lease_epoch, terms)) => self.welcome(id, lease_epoch, terms, now_ns),
            Err(refusal) => {
                self.close(id, refusal.reason, &refusal.detail, StaleReason::Disconnected, now_ns);
            }
        }
    }

    /// The epoch under which a session commands, 0 for an observer.
    fn lease_for(&mut self, id: SessionId, terms: &Terms) -> Result<u64, handshake::Refusal> {
        if terms.role == Role::Observer {
            return Ok(0);
        }
        self.lease.grant(id).map_err(|held| {
            let holder = self.peers.get(&held.by).and_then(|peer| peer.open.as_ref());
            let name = holder.map_or("", |open| open.client_name.as_str());
            handshake::Refusal {
                reason: ByeReason::LeaseHeld,
                detail: format!("role = controller: {} ({name:?}) holds the lease", held.by),
            }
        })
    }

    fn welcome(&mut self, id: SessionId, lease_epoch: u64, terms: Terms, now_ns: u64) {
        let Some(peer) = self.peers.get_mut(&id) else {
            return;
        };
        peer.open = Some(Open::new(terms, now_ns));
        let revision = self.scene_revision;
        let message = handshake::welcome(id, lease_epoch, revision, &self.config, now_ns);
        self.outbox.must(Output::Message { to: id, message });
        if lease_epoch != 0 {
            self.tell_all(&events::of_lease(now_ns, lease_epoch));
        }
    }

    pub(super) fn on_command(&mut self, id: SessionId, command: &Command, now_ns: u64) -> Outcome {
        let Some(open) = self.peers.get_mut(&id).and_then(|peer| peer.open.as_mut()) else {
            return Outcome::Unexpected;
        };
        if self.lease.holder() != Some(id) {
            return Outcome::NotAllowed;
        }
        let context = Context {
            config: &self.config,
            epoch: self.lease.epoch(),
            last_seq: open.last_seq,
            newest_tick: self.newest_tick,
            now_ns,
        };
        match command::setpoint(command, &context) {
            Ok(setpoint) => {
                open.last_seq = command.seq;
                open.echo =
                    Some(Echo { client_time_ns: command.client_time_ns, received_ns: now_ns });
                open.liveness.commanded(now_ns);
                self.setpoint = setpoint;
                self.setpoint_due = true;
                Outcome::Accepted
            }
            Err(Refusal::Old) => Outcome::Old,
            Err(Refusal::Invalid(error)) => {
                open.last_refusal = Some(error);
                Outcome::Invalid
            }
        }
    }

    pub(super) fn on_ping(&mut self, id: SessionId, ping: &Ping, now_ns: u64) -> Outcome {
        let Some(peer) = self.peers.get(&id) else {
            return Outcome::Unexpected;
        };
        let bytes = wire::encode(&DatagramBody::Pong(ping::answer(ping, now_ns)));
        send(&mut self.outbox, &mut self.counters, (id, peer.transport), bytes);
        Outcome::Accepted
    }

    pub(super) fn on_pong(&mut self, id: SessionId, pong: &Pong, now_ns: u64) -> Outcome {
        let Some(peer) = self.peers.get_mut(&id) else {
            return Outcome::Unexpected;
        };
        let transport = peer.transport;
        let pinger = peer.open.as_mut().map(|open| &mut open.pinger);
        match pinger.and_then(|pinger| pinger.completed(pong, now_ns)) {
            Some(rtt_ns) => {
                self.outbox.may(Output::Rtt { transport, rtt_ns });
                Outcome::Accepted
            }
            None => Outcome::Unexpected,
        }
    }

    /// The client said goodbye.
    pub(super) fn on_bye(&mut self, id: SessionId, now_ns: u64) {
        if self.peers.remove(&id).is_some() {
            let (reason, detail) = (ByeReason::Done, String::new());
            self.outbox.must(Output::Close { to: id, reason, detail });
            self.end_lease(id, StaleReason::Released, now_ns);
        }
    }

    /// The client broke the protocol.
    pub(super) fn broken(&mut self, id: SessionId, detail: &str, now_ns: u64) {
        self.close(id, ByeReason::Invalid, detail, StaleReason::Disconnected, now_ns);
    }

    /// Ends a session from this side.
    pub(super) fn close(
        &mut self,
        id: SessionId,
        reason: ByeReason,
        detail: &str,
        stale: StaleReason,
        now_ns: u64,
    ) {
        if self.peers.remove(&id).is_some() {
            self.say_bye(id, reason, detail);
            self.end_lease(id, stale, now_ns);
        }
    }

    pub(super) fn say_bye(&mut self, to: SessionId, reason: ByeReason, detail: &str) {
        let message = handshake::bye(reason, detail);
        self.outbox.must(Output::Message { to, message });
        let detail = detail.to_owned();
        self.outbox.must(Output::Close { to, reason, detail });
    }

    /// Ends the lease if this session held it, and takes its force away by the ramp: it said
    /// Bye, or broke the rules.
    pub(super) fn end_lease(&mut self, id: SessionId, reason: StaleReason, now_ns: u64) {
        if self.lease.holder() == Some(id) && self.setpoint.is_fresh(now_ns) {
            self.setpoint.released = true;
            self.setpoint_due = true;
            self.counters.count_stale(reason);
        }
        self.lose_lease(id, now_ns);
    }

    /// Ends the lease if this session held it. It vanished; time-to-live alone decides when
    /// its force goes, so that a broken connection is as good as a lost datagram.
    pub(super) fn lose_lease(&mut self, id: SessionId, now_ns: u64) {
        if self.lease.end(id) {
            self.tell_all(&events::of_lease(now_ns, self.lease.epoch()));
        }
    }
}
