//! What the tasks of the stream thread share: the sessions, what carries them, the bridges.
//!
//! One task at a time holds it, and never across a wait. Everything is decided by
//! [`Switchboard`]; here its outputs are carried out.

use std::cell::RefCell;
use std::collections::HashMap;
use std::net::{IpAddr, SocketAddr};
use std::os::fd::OwnedFd;
use std::rc::Rc;
use std::sync::Arc;

use tokio::sync::mpsc;
use web_transport_quinn::Session;

use super::Gate;
use super::gate::{Caller, Refused};
use super::guests::{Guest, Guests};
use super::neighbours::{Holder, gives_way};
use super::sealed_udp::SealedUdp;
use crate::clock::now_ns;
use crate::control::{Report, Setpoint};
use crate::device::{PointerInput, PointerTarget};
use crate::link::StreamEnd;
use crate::proto::{Hello, StreamMessage, stream_message::Body};
use crate::session::{
    HandTarget, Outcome, Output, Quality, Role, SessionConfig, SessionId, SessionInfo, Switchboard,
    Transport,
};
use crate::telemetry::{RoundTrips, StreamMetrics};
use crate::wire::{choose, encode_frame};

/// What the thread is given of one device.
pub struct StreamDevice {
    /// What its sessions take as given.
    pub sessions: SessionConfig,
    /// The bridge to the real-time thread.
    pub link: StreamEnd<Setpoint, Report>,
    /// Every setpoint on its way to the recorder.
    pub setpoints: rtrb::Producer<Setpoint>,
    /// The hand of a simulated device, where a person pulls it.
    pub pointer: Option<PointerInput>,
    /// Rung by the real-time thread after every tick.
    pub doorbell: OwnedFd,
    /// Where to count.
    pub metrics: StreamMetrics,
    /// Where the round trips of pings are gathered.
    pub round_trips: RoundTrips,
}

/// The hub, as the tasks hold it.
pub(super) type Shared = Rc<RefCell<Hub>>;

/// What carries a client's session.
pub(super) enum Carrier {
    /// A QUIC connection or a WebTransport session, with what waits for its reliable stream.
    Stream { session: Box<Session>, messages: mpsc::Sender<Vec<u8>> },
    /// An association of sealed UDP.
    Sealed { from: SocketAddr },
}

/// The bridges of one device.
struct Bridges {
    link: StreamEnd<Setpoint, Report>,
    setpoints: rtrb::Producer<Setpoint>,
    /// Number of the last setpoint.
    last_setpoint: u64,
    pointer: Option<PointerInput>,
    metrics: StreamMetrics,
    round_trips: RoundTrips,
}

impl Bridges {
    /// Told to the recorder first, so that it knows whatever a tick has used. Where that has no
    /// room, the recording lacks it and tells so by its number.
    fn hand_over(&mut self, mut setpoint: Setpoint) {
        self.last_setpoint += 1;
        setpoint.number = self.last_setpoint;
        let _ = self.setpoints.push(setpoint);
        self.link.setpoint.write(setpoint);
    }
}

/// What the tasks share.
pub(super) struct Hub {
    pub sessions: Switchboard,
    pub peers: HashMap<SessionId, Carrier>,
    pub sealed: SealedUdp,
    pub guests: Guests,
    pub gate: Arc<Gate>,
    /// By the place of the device.
    bridges: Vec<Bridges>,
}

impl Hub {
    /// Nobody is connected yet. Returns the doorbells, too, in the order of the devices.
    pub fn new(
        devices: Vec<StreamDevice>,
        sealed: SealedUdp,
        gate: Arc<Gate>,
    ) -> (Self, Vec<OwnedFd>) {
        let (mut configs, mut bridges, mut doorbells) = (Vec::new(), Vec::new(), Vec::new());
        for device in devices {
            configs.push(device.sessions);
            doorbells.push(device.doorbell);
            bridges.push(Bridges {
                link: device.link,
                setpoints: device.setpoints,
                last_setpoint: 0,
                pointer: device.pointer,
                metrics: device.metrics,
                round_trips: device.round_trips,
            });
        }
        let most = configs.first().map_or(0, |config| config.max_sessions);
        let sessions = Switchboard::new(configs);
        let guests = Guests::new(Arc::clone(&gate), most);
        (Self { sessions, peers: HashMap::new(), sealed, guests, gate, bridges }, doorbells)
    }

    /// A stranger wants a place: where there is none, one who has not said Hello gives way.
    pub fn make_room(&mut self, newcomer: IpAddr) {
        let holder = |id: &SessionId| match self.peers.get(id) {
            Some(Carrier::Stream { session, .. }) => Some(session.remote_address().ip()),
            // They say Hello before they come.
            Some(Carrier::Sealed { .. }) | None => None,
        };
        let choose = |newcomers: &[SessionId]| {
            let from = newcomers.iter().map(|id| holder(id).unwrap_or(newcomer));
            let holders: Vec<_> = from.map(|from| Holder { from, silent: true }).collect();
            gives_way(&holders, newcomer)
        };
        self.sessions.make_room(choose, now_ns());
    }

    /// A message came on a reliable stream. Returns by which number its client is known from
    /// now on.
    pub fn on_message(&mut self, id: SessionId, message: StreamMessage) -> SessionId {
        let guest = match &message.body {
            Some(Body::Hello(hello)) => self.judge(id, hello).transpose(),
            _ => Ok(None),
        };
        let guest = match guest {
            Ok(guest) => guest,
            Err(refused) => {
                self.sessions.send_away(id, refused.reason(), &refused.to_string(), now_ns());
                return id;
            }
        };
        let known_as = self.sessions.on_message(id, message, now_ns());
        if let (Some(guest), Some(info)) = (guest, self.sessions.info(known_as, now_ns())) {
            self.guests.arrived(known_as, guest, &info);
            self.guests.watch_leases(&self.sessions, None);
        }
        if known_as != id
            && let Some(peer) = self.peers.remove(&id)
        {
            self.peers.insert(known_as, peer);
            self.guests.joined(known_as, self.from(known_as));
        }
        known_as
    }

    /// Who says this Hello; `None` where that is known, or where it is refused anyway.
    fn judge(&self, id: SessionId, hello: &Hello) -> Option<Result<Guest, Refused>> {
        // Who was sent away, or welcomed, is judged no more.
        let judged = !hello.ticket.is_empty() || !self.sessions.is_newcomer(id);
        if judged || choose(&hello.versions).is_none() {
            return None;
        }
        let device = self.sessions.device_meant(hello);
        let device = device.as_deref().unwrap_or("a device that is not here");
        Some(self.guests.judge(hello, device, self.from(id)))
    }

    /// Where a session's datagrams come from.
    fn from(&self, id: SessionId) -> String {
        match self.peers.get(&id) {
            Some(Carrier::Stream { session, .. }) => session.remote_address().to_string(),
            Some(Carrier::Sealed { from }) => from.to_string(),
            None => String::new(),
        }
    }

    /// Sends a session away whose credential does not count any more.
    pub fn judge_again(&mut self, id: SessionId) {
        let role = self.sessions.info(id, now_ns()).map(|info| info.role);
        let refused = role.and_then(|role| self.guests.judge_again(id, role));
        if let Some(refused) = refused {
            self.sessions.send_away(id, refused.reason(), &refused.to_string(), now_ns());
            self.act();
        }
    }

    /// A call has changed who commands.
    pub fn lease_changed(&mut self, by: &(Caller, String)) {
        self.guests.watch_leases(&self.sessions, Some(by));
    }

    /// The connection of a session is gone.
    pub fn leave(&mut self, id: SessionId) {
        self.peers.remove(&id);
        self.sessions.disconnect(id, now_ns());
        self.act();
        self.guests.left(id, "gone");
    }

    /// Of several reports that waited only the newest becomes State.
    pub fn hear_reports(&mut self, device: usize) {
        let (Some(bridges), Some(sessions)) =
            (self.bridges.get_mut(device), self.sessions.device(device))
        else {
            return;
        };
        let mut newest = bridges.link.reports.pop().ok();
        while let Some(report) = newest {
            newest = bridges.link.reports.pop().ok();
            match newest {
                Some(_) => sessions.on_late_report(&report),
                None => sessions.on_report(&report, now_ns()),
            }
        }
    }

    /// Does what the sessions want done.
    pub fn act(&mut self) {
        self.guests.watch_leases(&self.sessions, None);
        while let Some((device, output)) = self.sessions.poll_output() {
            self.carry_out(device, output);
        }
    }

    fn carry_out(&mut self, device: usize, output: Output) {
        let bridges = &mut self.bridges[device];
        match output {
            Output::Setpoint(setpoint) => bridges.hand_over(*setpoint),
            Output::Datagram { to, transport, bytes } => {
                let outcome = if self.send(to, bytes) { Outcome::Sent } else { Outcome::Dropped };
                if let Some(sessions) = self.sessions.device(device) {
                    sessions.on_sent(transport, outcome);
                }
            }
            Output::Message { to, message } => self.say(to, &message),
            Output::Close { to, reason, detail } => {
                tracing::info!(session = %to, reason = reason.as_str_name(), detail, "session ended");
                let why = if detail.is_empty() { reason.as_str_name() } else { &detail };
                let association = self.guests.left(to, why);
                // Its writer sends what is queued, then closes the connection.
                match (self.peers.remove(&to), association) {
                    (Some(Carrier::Sealed { .. }), _) => self.sealed.end(to),
                    // It was waited for, and never came.
                    (None, Some(association)) => self.sealed.forget(association),
                    _ => {}
                }
            }
            Output::Rtt { transport, rtt_ns } => {
                bridges.metrics.rtt(transport, rtt_ns);
                bridges.round_trips.record(rtt_ns);
            }
            Output::OneWay { direction, delay_ns, .. } => {
                bridges.metrics.one_way(direction, delay_ns);
            }
            Output::Hand(target) => {
                // A device without one is never said to have a hand to pull.
                if let Some(pointer) = &mut bridges.pointer {
                    pointer.write(pointed(&target));
                }
            }
        }
    }

    /// Never waits. False where a datagram is lost: this one with its connection, or for want
    /// of room the oldest that waits, which was counted as sent in its turn.
    fn send(&mut self, to: SessionId, bytes: Vec<u8>) -> bool {
        match self.peers.get(&to) {
            Some(Carrier::Stream { session, .. }) => {
                let room = session.datagram_send_buffer_space() >= bytes.len();
                session.send_datagram(bytes.into()).is_ok() && room
            }
            Some(Carrier::Sealed { .. }) => self.sealed.send(to, &bytes),
            None => false,
        }
    }

    fn say(&mut self, to: SessionId, message: &StreamMessage) {
        let frame = || encode_frame(message);
        match self.peers.get(&to) {
            Some(Carrier::Stream { session, messages }) if messages.try_send(frame()).is_err() => {
                session.close(2, b"you do not read");
            }
            Some(Carrier::Sealed { .. }) if !self.sealed.say(to, &frame()) => {
                // It takes nothing, as one that does not read its stream.
                self.peers.remove(&to);
                self.sealed.end(to);
                self.sessions.disconnect(to, now_ns());
                self.guests.watch_leases(&self.sessions, None);
                self.guests.left(to, "it does not read");
            }
            _ => {}
        }
    }

    /// Brings the metrics up to now.
    pub fn publish(&mut self) {
        for (device, Bridges { metrics, .. }) in self.bridges.iter_mut().enumerate() {
            let Some(sessions) = self.sessions.device(device) else { continue };
            metrics.publish(sessions.counters());
            for role in Role::ALL {
                let alike = |like: &dyn Fn(&SessionInfo<'_>) -> bool| {
                    let open = sessions.list(now_ns()).filter(|session| session.role == role);
                    open.filter(|session| like(session)).count()
                };
                for transport in Transport::ALL {
                    let here = |session: &SessionInfo<'_>| {
                        !session.waiting && session.transport == transport
                    };
                    metrics.sessions(role, transport, alike(&here));
                }
                metrics.slowed(role, alike(&|session| session.slowed_by > 1));
                for quality in Quality::ALL {
                    let as_good = |session: &SessionInfo<'_>| session.quality == quality;
                    metrics.qualities(role, quality, alike(&as_good));
                }
            }
        }
    }
}

fn pointed(target: &HandTarget) -> PointerTarget {
    let HandTarget { position_W_m, held, buttons, .. } = *target;
    PointerTarget { p_WT_m: position_W_m, holds: held, buttons }
}
