//! Who may command a device: the protocol's state machine, without socket and clock.
//!
//! ```text
//!  connect ─▶ awaiting Hello ──good Hello──▶ welcomed ──▶ closed
//!                  │ bad or none in 10 s                    ▲ disconnect, Bye, 2 s of
//!                  └────────── Bye ─────────────────────────┘ silence, broken protocol
//! ```
//!
//! Messages, datagrams, reports and `now_ns` (the device clock, monotonic) go in; what to
//! send, what to close and what to render come out of [`Sessions::poll_output`], which the
//! caller drains after every call; [`Sessions::next_timeout`] says when to call again.
//! It is the only place where wire messages become control types.
//!
//! - One controller at a time, under a lease whose epoch grows; observers never command. A
//!   takeover turns the controller into an observer, which stays connected. A Command carries
//!   no epoch: it is the session that fences, because the lease is one session's.
//! - A hand pulls a simulated device and commands nothing.
//! - A refused Hello, Command or datagram changes nothing but a counter, and costs the
//!   server bounded memory whatever arrives.
//! - A force that is to go is the tick's business: a controller that says Bye, or breaks the
//!   rules, hands over its last setpoint, *released*; one that vanishes leaves it to its
//!   time-to-live.
//!
//! The order of events is the order of calls, so a run in virtual time is deterministic.

mod cadence;
mod calls;
mod command;
mod config;
mod contact;
mod counters;
mod deadband;
mod events;
mod hand;
mod handshake;
mod history;
mod incoming;
mod lease;
mod liveness;
mod mapping;
mod offset;
mod outgoing;
mod output;
mod pace;
mod path;
mod peer;
mod ping;
mod quality;
mod shape;
mod soft;
mod state;
mod switchboard;
#[cfg(test)]
mod tests;
mod workspace;

use std::collections::BTreeMap;

use nalgebra::Vector3;

use crate::control::Setpoint;
use crate::proto::datagram::Body as DatagramBody;
use crate::proto::stream_message::Body;
use crate::proto::{ByeReason, State, StreamMessage};
use crate::wire::{self, Detail, FrameError, WireError};

use events::Riding;
use hand::Pull;
use history::History;
use lease::Lease;
use output::Outbox;
use peer::Peer;

pub use calls::{CallRefusal, LeaseInfo, Ticket};
pub use config::{ExampleWall, Role, SessionConfig, SessionId, Transport};
pub use counters::{Counters, Outcome, StaleReason};
pub use events::event_to_proto;
pub use hand::HandTarget;
pub use mapping::{SCENE_ID, surface_id};
pub use offset::{Clock, Direction};
pub use output::Output;
pub use peer::SessionInfo;
pub use quality::Quality;
pub use switchboard::Switchboard;

/// There is no room for one more session; nothing was opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("sessions = {most}: at most {most} at a time")]
pub struct TooManySessions {
    /// How many there can be.
    pub most: usize,
}

impl TooManySessions {
    /// What to tell the client before closing its connection.
    pub fn bye(&self) -> StreamMessage {
        handshake::bye(ByeReason::TooManySessions, &self.to_string())
    }
}

/// The sessions of one device.
#[derive(Debug)]
pub struct Sessions {
    config: SessionConfig,
    peers: BTreeMap<SessionId, Peer>,
    last_id: u64,
    lease: Lease,
    /// The last command taken, whoever sent it.
    setpoint: Setpoint,
    /// It was not handed out yet.
    setpoint_due: bool,
    /// Why its force ends if it just runs out.
    ending: StaleReason,
    /// The hand that pulls now.
    pull: Option<Pull>,
    history: History,
    /// Where the newest tick found the tool point.
    p_WT_m: Vector3<f64>,
    scene_revision: u64,
    riding: Riding,
    /// Keeps the room of its vectors from tick to tick.
    state: State,
    detail: Detail,
    outbox: Outbox,
    counters: Counters,
}

impl Sessions {
    /// No sessions yet.
    pub fn new(config: SessionConfig) -> Self {
        Self {
            history: History::new(config.tick_ns, config.greatest_age_ns()),
            config,
            peers: BTreeMap::new(),
            last_id: 0,
            lease: Lease::default(),
            setpoint: Setpoint::NONE,
            setpoint_due: false,
            ending: StaleReason::Ttl,
            pull: None,
            p_WT_m: Vector3::zeros(),
            scene_revision: 0,
            riding: Riding::default(),
            state: State::default(),
            detail: Detail::default(),
            outbox: Outbox::default(),
            counters: Counters::default(),
        }
    }

    /// A client connected; it has 10 s for its Hello.
    pub fn connect(
        &mut self,
        transport: Transport,
        now_ns: u64,
    ) -> Result<SessionId, TooManySessions> {
        let most = self.config.max_sessions;
        if self.peers.len() >= most {
            return Err(TooManySessions { most });
        }
        let id = self.next_id();
        self.peers.insert(id, Peer::new(transport, now_ns));
        Ok(id)
    }

    fn next_id(&mut self) -> SessionId {
        self.last_id += 1;
        SessionId(self.last_id)
    }

    /// Resource name of the device.
    pub fn device_name(&self) -> String {
        self.config.device_name()
    }

    /// Connections, welcomed or not yet.
    fn connections(&self) -> usize {
        self.peers.len()
    }

    fn is_newcomer(&self, id: SessionId) -> bool {
        self.peers.get(&id).is_some_and(|peer| peer.open.is_none())
    }

    /// Since when somebody has been connected without a Hello, and who; the one who came first.
    fn newcomers(&self) -> impl Iterator<Item = SessionId> {
        self.peers.iter().filter(|(_, peer)| peer.open.is_none()).map(|(id, _)| *id)
    }

    /// Whether this is the resource name of the device.
    fn is_called(&self, name: &str) -> bool {
        self.config.device_name() == name
    }

    /// Forgets a connection that was not welcomed yet, for another device to take in.
    fn let_go(&mut self, id: SessionId) -> Option<Peer> {
        let newcomer = self.peers.get(&id).is_some_and(|peer| peer.open.is_none());
        if newcomer { self.peers.remove(&id) } else { None }
    }

    /// Takes in a newcomer that another device let go.
    fn take_in(&mut self, id: SessionId, newcomer: Peer) {
        self.peers.insert(id, newcomer);
    }

    /// Its connection is gone. What it commanded last holds for its time-to-live.
    pub fn disconnect(&mut self, id: SessionId, now_ns: u64) {
        if self.peers.remove(&id).is_some() {
            self.lose_lease(id, now_ns);
        }
    }

    /// The server ends: Bye to everyone.
    pub fn shutdown(&mut self, now_ns: u64) {
        for id in std::mem::take(&mut self.peers).into_keys() {
            self.say_bye(id, ByeReason::Shutdown, "the server is shutting down");
            self.end_lease(id, StaleReason::Released, now_ns);
        }
    }

    /// A message came on the reliable stream.
    pub fn on_message(&mut self, id: SessionId, message: StreamMessage, now_ns: u64) {
        let Some(peer) = self.peers.get_mut(&id) else {
            return;
        };
        peer.heard(now_ns);
        match message.body {
            Some(Body::Hello(hello)) if peer.open.is_none() => self.on_hello(id, &hello, now_ns),
            Some(Body::Bye(_)) => self.on_bye(id, now_ns),
            Some(Body::Hello(_)) => self.broken(id, "a second Hello", now_ns),
            _ => self.broken(id, "only Hello, once, and Bye are for a client to send", now_ns),
        }
    }

    /// The reliable stream cannot be read any more.
    pub fn on_broken_stream(&mut self, id: SessionId, error: FrameError, now_ns: u64) {
        self.broken(id, &error.to_string(), now_ns);
    }

    /// A datagram came.
    pub fn on_datagram(&mut self, id: SessionId, bytes: &[u8], now_ns: u64) {
        let Some(peer) = self.peers.get_mut(&id) else {
            return;
        };
        peer.heard(now_ns);
        let transport = peer.transport;
        let outcome = match wire::decode(bytes) {
            Err(WireError::Oversize { .. }) => Outcome::Oversize,
            Err(_) => Outcome::Malformed,
            Ok(_) if peer.open.is_none() => Outcome::Unexpected,
            Ok(DatagramBody::Command(command)) => self.on_command(id, &command, now_ns),
            Ok(DatagramBody::Ping(ping)) => self.on_ping(id, &ping, now_ns),
            Ok(DatagramBody::Pong(pong)) => self.on_pong(id, &pong, now_ns),
            Ok(DatagramBody::HandTarget(target)) => self.on_hand_target(id, &target, now_ns),
            Ok(DatagramBody::Ack(ack)) => self.on_ack(id, &ack),
            Ok(DatagramBody::State(_)) => Outcome::Unexpected,
        };
        self.counters.count_datagram(transport, outcome);
    }

    /// When [`Sessions::on_timeout`] has something to do.
    pub fn next_timeout(&self) -> Option<u64> {
        let hand = self.pull.as_ref().map(Pull::ends_ns);
        self.peers.values().map(Peer::next_timeout).chain(hand).min()
    }

    /// Closes who was silent for too long, and pings the others. Hand in first what has
    /// arrived: a caller that was held up is not a silent client.
    pub fn on_timeout(&mut self, now_ns: u64) {
        let expired = |(id, peer): (&SessionId, &Peer)| Some((*id, peer.expired(now_ns)?));
        let expired: Vec<_> = self.peers.iter().filter_map(expired).collect();
        for (id, (reason, detail)) in expired {
            self.close(id, reason, detail, StaleReason::Disconnected, now_ns);
        }
        self.watch_hand(now_ns);
        for (id, peer) in self.peers.iter_mut().filter(|(_, peer)| peer.waiting.is_none()) {
            let Some(open) = &mut peer.open else { continue };
            if let Some(ping) = open.pinger.due(now_ns) {
                open.pace.pinged(ping.seq);
                let bytes = wire::encode(&DatagramBody::Ping(ping));
                send(&mut self.outbox, &mut self.counters, (*id, peer.transport), bytes);
            }
        }
    }

    /// What became of a datagram of [`Output::Datagram`].
    pub fn on_sent(&mut self, transport: Transport, outcome: Outcome) {
        self.counters.count_datagram(transport, outcome);
    }

    /// The next thing to do: a new setpoint before all else.
    pub fn poll_output(&mut self) -> Option<Output> {
        if std::mem::take(&mut self.setpoint_due) {
            return Some(Output::Setpoint(Box::new(self.setpoint)));
        }
        self.outbox.pop()
    }

    /// The welcomed sessions, the oldest first.
    pub fn list(&self, now_ns: u64) -> impl Iterator<Item = SessionInfo<'_>> {
        self.peers.iter().filter_map(move |(id, peer)| peer.info(*id, now_ns))
    }

    /// What was counted.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }
}

/// Hands a datagram over, or counts it as dropped.
fn send(
    outbox: &mut Outbox,
    counters: &mut Counters,
    (to, transport): (SessionId, Transport),
    bytes: Vec<u8>,
) {
    if !outbox.may(Output::Datagram { to, transport, bytes }) {
        counters.count_datagram(transport, Outcome::Dropped);
    }
}
