//! What must be true of everything that the sessions of a server let out, and of what is left.
//!
//! The rules know what was done (a [`Cause`]) and who was who before it, from the server's own
//! list; from the contract follows what may come of it: to whom, how much, and under which
//! lease.

use std::collections::BTreeMap;

use hapticd::control::{Report, Setpoint};
use hapticd::proto::datagram::Body;
use hapticd::proto::stream_message;
use hapticd::proto::{EventKind, StreamMessage};
use hapticd::session::{
    Output, Quality, Role, SessionConfig, SessionId, SessionInfo, Sessions, Switchboard, Transport,
};
use hapticd::wire::{MAX_FRAME_BYTES, decode, encode_frame, max_detailed_bytes};

use super::Seen;
use super::setpoints::Device;
use super::world::{Client, MAX_SESSIONS};
use crate::sealed::MAX_BODY_BYTES;
use crate::states::is_finite;

/// What may wait to be taken out, and what must be said beside it.
const MOST_OUTPUTS: usize = 1024 + 4 * MAX_SESSIONS;

/// A Pong, the only answer that a datagram gets.
const MOST_ANSWER_BYTES: usize = 64;

/// A frame over sealed UDP has one packet, with its number in front.
const MOST_SEALED_BYTES: usize = MAX_BODY_BYTES - 4;

/// Time for the Hello.
const HELLO_NS: u64 = 10_000_000_000;

/// What was done to the server.
#[derive(Clone, Copy, Debug)]
pub enum Cause {
    Connect,
    Message { by: SessionId },
    Datagram { by: SessionId, times: usize },
    Tick { device: usize, events: usize, late: bool },
    Timeout,
    Call,
    Disconnect,
    Shutdown,
}

/// A session as the server's list had it.
#[derive(Clone, Copy, Debug)]
struct Known {
    device: usize,
    role: Role,
    waiting: bool,
    transport: Transport,
    quality: Quality,
}

/// The rules, and what they have to remember.
#[derive(Debug)]
pub struct Rules {
    devices: Vec<Device>,
    known: BTreeMap<SessionId, Known>,
    closed: Vec<SessionId>,
    pub seen: Seen,
}

impl Rules {
    pub fn new(configs: &[SessionConfig]) -> Self {
        let devices = configs.iter().map(Device::new).collect();
        Self { devices, known: BTreeMap::new(), closed: Vec::new(), seen: Seen::default() }
    }

    /// What the loop of a device is to do next.
    pub fn setpoint(&self, device: usize) -> Setpoint {
        self.devices[device].setpoint
    }

    /// Connections that were closed since this was last asked.
    pub fn take_closed(&mut self) -> Vec<SessionId> {
        std::mem::take(&mut self.closed)
    }

    /// A tick was done with this setpoint.
    pub fn check_force(&mut self, device: usize, report: &Report, setpoint: &Setpoint) {
        self.devices[device].check_force(report, setpoint);
    }

    /// Takes everything out and looks at it, then at what is left.
    pub fn settle(
        &mut self,
        switchboard: &mut Switchboard,
        cause: Cause,
        clients: &mut [Client],
        now_ns: u64,
    ) {
        let outputs: Vec<_> = std::iter::from_fn(|| switchboard.poll_output()).collect();
        self.check_leases(switchboard, cause);
        let after = known(switchboard, now_ns);
        self.check_amount(cause, &outputs);
        for (place, (device, output)) in outputs.iter().enumerate() {
            let rest = &outputs[place + 1..];
            match output {
                Output::Datagram { to, bytes, .. } => {
                    self.check_datagram(cause, *device, *to, bytes);
                    note_ping(clients, *to, bytes);
                }
                Output::Message { to, message } => {
                    self.check_message(cause, (*device, *to), message, rest, &after);
                    let welcome = matches!(message.body, Some(stream_message::Body::Welcome(_)));
                    self.seen.welcomed += u64::from(welcome);
                }
                Output::Close { to, .. } => {
                    self.check_patience(cause, clients, *to, now_ns);
                    assert!(!after.contains_key(to), "{to} was closed and is forgotten");
                    assert!(!rest.iter().any(|(_, o)| addressee(o) == Some(*to)), "its last word");
                    self.closed.push(*to);
                }
                Output::Setpoint(setpoint) => {
                    self.check_path(cause, setpoint, &after);
                    let may = self.is_by(cause, *device, Role::Controller);
                    let own = &mut self.devices[*device];
                    own.check_setpoint(cause, may, setpoint, now_ns);
                    own.take(setpoint);
                    self.seen.setpoints += 1;
                }
                Output::Rtt { rtt_ns, .. } => assert!(*rtt_ns <= now_ns),
                Output::OneWay { delay_ns, bound_ns, .. } => {
                    assert!(*delay_ns <= now_ns && *bound_ns <= now_ns);
                }
                Output::Hand(target) => {
                    assert!(target.position_W_m.iter().all(|part| part.is_finite()));
                    assert!(target.received_ns == now_ns);
                    assert!(!target.held || self.is_by(cause, *device, Role::Hand));
                }
            }
        }
        self.check_list(switchboard, now_ns);
        if matches!(cause, Cause::Timeout) {
            let silent = |client: &&Client| {
                !after.contains_key(&client.id) && !self.closed.contains(&client.id)
            };
            for client in clients.iter().filter(silent) {
                assert!(now_ns - client.connected_ns < HELLO_NS, "{client:?} never says Hello");
            }
        }
        self.known = after;
    }

    /// Who says nothing but holds a connection has so long for its Hello, and not less.
    fn check_patience(&self, cause: Cause, clients: &[Client], id: SessionId, now_ns: u64) {
        let newcomer = clients.iter().find(|client| client.id == id);
        let newcomer = newcomer.filter(|_| !self.known.contains_key(&id));
        if let (Cause::Timeout, Some(client)) = (cause, newcomer) {
            assert!(now_ns - client.connected_ns >= HELLO_NS, "{client:?} was not waited for");
        }
    }

    /// A soft force needs a good path; contacts are taken over any.
    fn check_path(&self, cause: Cause, setpoint: &Setpoint, after: &BTreeMap<SessionId, Known>) {
        let Cause::Datagram { by, times: 1 } = cause else { return };
        let good = after.get(&by).is_some_and(|known| known.quality >= Quality::Good);
        assert!(good || setpoint.field().is_none(), "{setpoint:?} over a bad path");
    }

    fn is_by(&self, cause: Cause, device: usize, role: Role) -> bool {
        let Cause::Datagram { by, .. } = cause else { return false };
        self.known.get(&by).is_some_and(|k| (k.device, k.role, k.waiting) == (device, role, false))
    }

    /// No amplification: what a step can set off is bounded by what it is and who did it.
    fn check_amount(&self, cause: Cause, outputs: &[(usize, Output)]) {
        let count = outputs.len();
        assert!(count <= MOST_OUTPUTS, "{cause:?}: {count} outputs");
        let welcomed = self.known.len() + 1;
        match cause {
            // Who has not said Hello makes room for a newcomer.
            Cause::Connect => assert!(count == 0 || count == 2, "{outputs:?}"),
            Cause::Datagram { by, times } => match self.known.get(&by) {
                None => assert_eq!(count, 0, "who was not welcomed gets no answer: {outputs:?}"),
                Some(known) => {
                    assert!(!known.waiting, "nobody speaks for a session that waits");
                    assert!(count <= 3 * times, "{cause:?}: {outputs:?}");
                    let to = outputs.iter().filter_map(|(_, output)| addressee(output));
                    assert!(to.into_iter().all(|to| to == by), "an answer goes to who asked");
                }
            },
            Cause::Message { by } => {
                let said = |(_, output): &&(usize, Output)| match output {
                    Output::Message { to, message } => *to == by && !is_lease(message),
                    Output::Datagram { .. } => panic!("{output:?} is no answer to a message"),
                    _ => false,
                };
                assert!(outputs.iter().filter(said).count() <= 1, "one answer: {outputs:?}");
                assert!(count <= 4 + 2 * welcomed, "{outputs:?}");
            }
            Cause::Tick { events, late, .. } => {
                let states = if late { 0 } else { welcomed };
                assert!(count <= events * welcomed + states, "{cause:?}: {count}");
            }
            Cause::Timeout | Cause::Call | Cause::Disconnect | Cause::Shutdown => {
                // To each connection a Ping, or Bye and Close, and the news of the lease; a
                // setpoint and a hand that lets go.
                let most = (4 + MAX_SESSIONS) * MAX_SESSIONS;
                assert!(count <= most, "{cause:?}: {count}");
            }
        }
    }

    fn check_datagram(&self, cause: Cause, device: usize, to: SessionId, bytes: &[u8]) {
        let known = self.known.get(&to).copied();
        let known = known.unwrap_or_else(|| panic!("a datagram to {to}, which is not welcomed"));
        assert!(known.device == device && !known.waiting, "{to} of {known:?}, not {device}");
        match (decode(bytes), cause) {
            (Ok(Body::Pong(_)), Cause::Datagram { .. }) => {
                assert!(bytes.len() <= MOST_ANSWER_BYTES);
            }
            (Ok(Body::Ping(_)), Cause::Timeout) => assert!(bytes.len() <= MOST_ANSWER_BYTES),
            (Ok(Body::State(state)), Cause::Tick { device: ticked, .. }) => {
                assert_eq!(ticked, device);
                assert!(bytes.len() <= max_detailed_bytes(self.devices[device].actuators));
                assert!(is_finite(&state), "{state:?}");
                assert_eq!(state.seq, self.devices[device].newest_tick);
            }
            (message, _) => panic!("{message:?} is nothing that {cause:?} sends"),
        }
    }

    fn check_message(
        &self,
        cause: Cause,
        (device, to): (usize, SessionId),
        message: &StreamMessage,
        rest: &[(usize, Output)],
        after: &BTreeMap<SessionId, Known>,
    ) {
        let bytes = encode_frame(message).len();
        assert!(bytes < MAX_FRAME_BYTES / 16, "{message:?}");
        let before = self.known.get(&to);
        let transport = after.get(&to).or(before).map(|known| known.transport);
        let sealed = transport == Some(Transport::SealedUdp);
        assert!(!sealed || bytes <= MOST_SEALED_BYTES, "{bytes} bytes fit no packet: {message:?}");
        match &message.body {
            Some(stream_message::Body::Welcome(welcome)) => {
                assert!(matches!(cause, Cause::Message { by } if by == to), "{cause:?}");
                assert!(before.is_none_or(|known| known.waiting), "{to} was welcomed already");
                assert!(after.get(&to).is_some_and(|known| known.device == device));
                let lease = self.devices[device].lease;
                let expected = if lease.holder == Some(to) { lease.epoch } else { 0 };
                assert_eq!(welcome.lease_epoch, expected);
                assert_eq!(welcome.session, to.to_string());
            }
            Some(stream_message::Body::Bye(bye)) => {
                let Some((_, Output::Close { to: closed, reason, .. })) = rest.first() else {
                    panic!("a Bye without its Close")
                };
                assert_eq!((*closed, *reason), (to, bye.reason()));
            }
            Some(stream_message::Body::Event(event)) => {
                let news = matches!(cause, Cause::Tick { device: ticked, .. } if ticked == device);
                assert!(news || event.kind() == EventKind::Lease, "{event:?} of {cause:?}");
                let there = before.or(after.get(&to)).is_some_and(|known| known.device == device);
                assert!(there, "an event for {to}, which is not of device {device}");
            }
            _ => panic!("{message:?} is not for a client"),
        }
    }

    /// At most one commands, under an epoch that only grows.
    fn check_leases(&mut self, switchboard: &Switchboard, cause: Cause) {
        for (device, sessions) in switchboard.devices().enumerate() {
            let own = &mut self.devices[device];
            let lease = sessions.lease();
            assert_eq!(lease.holder.is_some(), lease.epoch > 0);
            if lease.holder.is_some() && lease != own.lease {
                assert!(lease.epoch > own.newest_epoch, "{lease:?} after {}", own.newest_epoch);
                own.newest_epoch = lease.epoch;
                let may = matches!(cause, Cause::Message { .. } | Cause::Call);
                assert!(may, "{cause:?} gives no lease");
            }
            own.lease = lease;
        }
    }

    /// What is left is bounded and makes sense.
    fn check_list(&self, switchboard: &Switchboard, now_ns: u64) {
        for (sessions, own) in switchboard.devices().zip(&self.devices) {
            let controllers = sessions.list(now_ns).filter(|info| info.role == Role::Controller);
            let controllers: Vec<_> = controllers.map(|info| info.id).collect();
            assert_eq!(controllers, Vec::from_iter(own.lease.holder), "who holds the lease");
        }
        assert!(switchboard.list(now_ns).count() <= MAX_SESSIONS);
        for info in switchboard.list(now_ns) {
            assert!((0.0..=1.0).contains(&info.loss) && info.variation_ns >= 0.0, "{info:?}");
            assert!(info.variation_ns.is_finite() && [1, 2, 4].contains(&info.slowed_by));
            assert!(info.felt_stiffness_ratio > 0.0 && info.felt_stiffness_ratio <= 1e3);
            assert!(info.client_name.len() <= 64);
            assert!(info.last_refusal.is_none_or(|said| said.to_string().len() < 1_000));
        }
    }
}

fn known(switchboard: &Switchboard, now_ns: u64) -> BTreeMap<SessionId, Known> {
    let of_device = |(device, sessions): (usize, &_)| {
        let sessions: &Sessions = sessions;
        let known = |info: SessionInfo<'_>| {
            let SessionInfo { id, role, waiting, transport, quality, .. } = info;
            (id, Known { device, role, waiting, transport, quality })
        };
        sessions.list(now_ns).map(known).collect::<Vec<_>>()
    };
    switchboard.devices().enumerate().flat_map(of_device).collect()
}

fn addressee(output: &Output) -> Option<SessionId> {
    match output {
        Output::Datagram { to, .. } | Output::Message { to, .. } | Output::Close { to, .. } => {
            Some(*to)
        }
        _ => None,
    }
}

fn is_lease(message: &StreamMessage) -> bool {
    let Some(stream_message::Body::Event(event)) = &message.body else { return false };
    event.kind() == EventKind::Lease
}

fn note_ping(clients: &mut [Client], to: SessionId, bytes: &[u8]) {
    if let Ok(Body::Ping(ping)) = decode(bytes) {
        let client = clients.iter_mut().find(|client| client.id == to);
        client.into_iter().for_each(|client| client.pinged = Some(ping));
    }
}
