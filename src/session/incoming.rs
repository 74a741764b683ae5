//! What each message of a client does to the sessions, and how a session ends.
//!
//! A refused Hello closes its own connection and touches nothing else; a refused Command
//! leaves everything as it was. Ending a session, for whatever reason, ends its lease in
//! the same call. Where it ends by Bye or for breaking the rules, or where another session
//! takes the lease, the setpoint goes out once more, released: what it asked for fades by
//! the tick's own ramp, and no command of an old epoch acts any more.

use crate::proto::datagram::Body as DatagramBody;
use crate::proto::stream_message::Body;
use crate::proto::{Ack, ByeReason, Command, Hello, Ping, Pong, StreamMessage, Welcome};
use crate::wire;

use super::command::{self, Context, Refusal};
use super::handshake::{self, Terms};
use super::peer::Open;
use super::state::Echo;
use super::{
    Direction, Outcome, Output, Role, SessionId, Sessions, StaleReason, events, ping, send,
};

impl Sessions {
    pub(super) fn on_hello(&mut self, id: SessionId, hello: &Hello, now_ns: u64) {
        match self.admit(id, hello, now_ns) {
            Ok(()) => {
                self.say_welcome(id, now_ns);
                self.tell_lease_of(id, now_ns);
            }
            Err(refusal) => {
                self.close(id, refusal.reason, &refusal.detail, StaleReason::Disconnected, now_ns);
            }
        }
    }

    /// Opens a session on the terms of its Hello.
    pub(super) fn admit(
        &mut self,
        id: SessionId,
        hello: &Hello,
        now_ns: u64,
    ) -> Result<(), handshake::Refusal> {
        let terms = handshake::agree(hello, &self.config)?;
        if terms.role == Role::Controller {
            self.grant_lease(id, terms.takeover, now_ns)?;
        }
        self.open(id, terms, now_ns);
        Ok(())
    }

    /// Gives the lease to a session; the epoch under which it commands.
    pub(super) fn grant_lease(
        &mut self,
        id: SessionId,
        takeover: bool,
        now_ns: u64,
    ) -> Result<u64, handshake::Refusal> {
        let loser = self.lease.grant(id, takeover).map_err(|held| {
            let holder = self.peers.get(&held.by).and_then(|peer| peer.open.as_ref());
            let name = holder.map_or("", |open| open.client_name.as_str());
            handshake::Refusal {
                reason: ByeReason::LeaseHeld,
                detail: format!("role = controller: {} ({name:?}) holds the lease", held.by),
            }
        })?;
        // Without a loser there may be the force of one that vanished.
        let reason = loser.map_or(StaleReason::Disconnected, |_| StaleReason::TakenOver);
        self.release(reason, now_ns);
        let loser = loser.and_then(|loser| self.peers.get_mut(&loser)?.open.as_mut());
        if let Some(open) = loser {
            open.demote();
        }
        Ok(self.lease.epoch())
    }

    fn open(&mut self, id: SessionId, terms: Terms, now_ns: u64) {
        let Some(peer) = self.peers.get_mut(&id) else {
            return;
        };
        peer.open = Some(Open::new(terms, self.riding.newest(), now_ns));
        self.watch_hand(now_ns);
    }

    /// Tells a session what it was granted.
    pub(super) fn say_welcome(&mut self, id: SessionId, now_ns: u64) {
        let Some(welcome) = self.welcome_of(id, now_ns) else { return };
        let message = StreamMessage { body: Some(Body::Welcome(welcome)) };
        self.outbox.must(Output::Message { to: id, message });
    }

    /// Tells everybody where this session has come to hold the lease.
    pub(super) fn tell_lease_of(&mut self, id: SessionId, now_ns: u64) {
        if self.lease.holder() == Some(id) {
            self.tell_all(&events::of_lease(now_ns, self.lease.epoch()));
        }
    }

    /// What a session was granted.
    pub(super) fn welcome_of(&self, id: SessionId, now_ns: u64) -> Option<Welcome> {
        let open = self.peers.get(&id)?.open.as_ref()?;
        let lease_epoch = if self.lease.holder() == Some(id) { self.lease.epoch() } else { 0 };
        let numbers = (lease_epoch, self.scene_revision);
        Some(handshake::welcome(id, numbers, &open.workspace, &self.config, now_ns))
    }

    pub(super) fn on_command(&mut self, id: SessionId, command: &Command, now_ns: u64) -> Outcome {
        let Some(open) = self.peers.get_mut(&id).and_then(|peer| peer.open.as_mut()) else {
            return Outcome::Unexpected;
        };
        if self.lease.holder() != Some(id) {
            return Outcome::NotAllowed;
        }
        open.acknowledge(command.event_ack, self.riding.newest());
        // What is refused tells of the path as well: a bad one is to be seen getting better.
        if (1..=command::MAX_SEQ).contains(&command.seq) {
            open.judge.take(command.seq, command.client_time_ns, now_ns);
        }
        let mut workspace = open.workspace;
        workspace.clutch(command.clutched, &self.p_WT_m);
        let context = Context {
            config: &self.config,
            epoch: self.lease.epoch(),
            last_seq: open.last_seq,
            history: &self.history,
            welcomed_ns: open.welcomed_ns,
            quality: open.judge.quality(),
            liveness: &open.liveness,
            workspace: &workspace,
            now_ns,
        };
        let (error, outcome) = match command::take(command, &context) {
            Ok(taken) => {
                open.last_seq = command.seq;
                open.echo =
                    Some(Echo { client_time_ns: command.client_time_ns, received_ns: now_ns });
                open.liveness.commanded(now_ns);
                open.workspace = workspace;
                (self.setpoint, self.ending) = (taken.setpoint, taken.ending);
                self.setpoint_due = true;
                return Outcome::Accepted;
            }
            Err(Refusal::Old) => return Outcome::Old,
            Err(Refusal::Invalid(error)) => (error, Outcome::Invalid),
            Err(Refusal::Stale(error)) => {
                self.ending = StaleReason::Age;
                (error, Outcome::Stale)
            }
            Err(Refusal::Quality(error)) => {
                self.ending = StaleReason::Quality;
                (error, Outcome::Quality)
            }
        };
        open.last_refusal = Some(error);
        outcome
    }

    pub(super) fn on_ack(&mut self, id: SessionId, ack: &Ack) -> Outcome {
        let newest = self.riding.newest();
        let open = self.peers.get_mut(&id).and_then(|peer| peer.open.as_mut());
        match open.map(|open| open.acknowledge(ack.event_id, newest)) {
            Some(true) => Outcome::Accepted,
            Some(false) => Outcome::Invalid,
            None => Outcome::Unexpected,
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
        let Some(open) = &mut peer.open else {
            return Outcome::Unexpected;
        };
        let Some(rtt_ns) = open.pinger.completed(pong, now_ns) else {
            return Outcome::Unexpected;
        };
        open.pace.ponged(pong.seq, pong.states_received, rtt_ns);
        if open.role == Role::Observer {
            open.judge.take(pong.seq, pong.returned_ns, now_ns);
        }
        let clock = open.offset.take(pong, rtt_ns, now_ns);
        self.outbox.may(Output::Rtt { transport, rtt_ns });
        for (direction, delay_ns) in [(Direction::In, clock.in_ns), (Direction::Out, clock.out_ns)]
        {
            let bound_ns = clock.bound_ns;
            self.outbox.may(Output::OneWay { direction, delay_ns, bound_ns });
        }
        Outcome::Accepted
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

    /// Sends a session away, or a connection that is none yet.
    pub(super) fn send_away(
        &mut self,
        id: SessionId,
        reason: ByeReason,
        detail: &str,
        now_ns: u64,
    ) {
        self.close(id, reason, detail, StaleReason::Released, now_ns);
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
        if self.lease.holder() == Some(id) {
            self.release(reason, now_ns);
        }
        self.lose_lease(id, now_ns);
    }

    /// Lets the last setpoint go, if its time is not over anyway.
    fn release(&mut self, reason: StaleReason, now_ns: u64) {
        if self.setpoint.is_fresh(now_ns) {
            self.setpoint.released = true;
            self.setpoint_due = true;
            self.counters.count_stale(reason);
        }
    }

    /// Ends the lease if this session held it. It vanished; time-to-live alone decides when
    /// its force goes, so that a broken connection is as good as a lost datagram.
    pub(super) fn lose_lease(&mut self, id: SessionId, now_ns: u64) {
        if self.lease.end(id) {
            self.ending = StaleReason::Disconnected;
            self.tell_all(&events::of_lease(now_ns, self.lease.epoch()));
        }
        self.watch_hand(now_ns);
    }
}
