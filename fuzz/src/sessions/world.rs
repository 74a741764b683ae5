//! A server of two devices without its sockets, and clients that do what a script says.

use hapticd::config::Settings;
use hapticd::control::{
    ControlCommand, ControlState, DeviceError, Mode, ModeCommand, Plan, Sample, Setpoint,
    TickInput, tick,
};
use hapticd::proto::{
    Ack, Bye, Command, HandTarget, Hello, Ping, Pong, StreamMessage, datagram::Body, stream_message,
};
use hapticd::session::{SessionConfig, SessionId, Switchboard, Transport};
use hapticd::wire::{FrameDecoder, encode};

use super::Seen;
use super::rules::{Cause, Rules};
use crate::messages;
use crate::script::Script;
use crate::ticks;

const MS: u64 = 1_000_000;
pub const MAX_SESSIONS: usize = 6;
const NAMES: [&str; 2] = ["cho-2005", "singh"];

/// Datagrams that a client has sent and may send again.
const KEPT: usize = 8;

/// One end of a connection.
#[derive(Debug)]
pub struct Client {
    pub id: SessionId,
    pub connected_ns: u64,
    /// Of its commands and targets.
    seq: u64,
    sent: Vec<Vec<u8>>,
    /// The last Ping that came to it.
    pub pinged: Option<Ping>,
}

/// A device and its loop.
struct Loop {
    plan: Box<Plan>,
    state: ControlState,
    sample: Sample,
    place_m: [f64; 2],
    newest_tick: u64,
}

/// All of it.
pub struct World {
    switchboard: Switchboard,
    loops: Vec<Loop>,
    clients: Vec<Client>,
    /// Of sessions that were opened by a call.
    tickets: Vec<[u8; 16]>,
    rules: Rules,
    now_ns: u64,
}

impl World {
    pub fn new(script: &mut Script<'_>) -> Self {
        let config = |name: &str| SessionConfig {
            max_sessions: MAX_SESSIONS,
            takes_hands: true,
            ..SessionConfig::new(name, MS, 2, if name == "singh" { 2 } else { 4 })
        };
        let configs: Vec<_> = NAMES.iter().map(|name| config(name)).collect();
        // A device clock is anywhere between the boot of a machine and centuries later.
        let now_ns = u64::from(script.u32()) << script.below(30);
        Self {
            rules: Rules::new(&configs),
            switchboard: Switchboard::new(configs),
            loops: NAMES.iter().map(|name| Loop::new(name)).collect(),
            clients: Vec::new(),
            tickets: Vec::new(),
            now_ns,
        }
    }

    pub fn step(&mut self, script: &mut Script<'_>) {
        match script.below(20) {
            0 => self.connect(script),
            1 | 2 => self.hello(script),
            3..=6 => self.command(script),
            7 => self.hand_target(script),
            8 => self.again(script),
            9 => self.small_talk(script),
            10 => self.rubbish(script),
            11 => self.message(script),
            12..=14 => self.ticks(script),
            15 | 16 => self.time_passes(script),
            17 => self.operator(script),
            18 if script.rarely(3) => self.come_sealed(),
            18 => self.leave(script),
            _ => self.device(script),
        }
    }

    /// The server ends: everybody is told, and nothing of them is left.
    pub fn end(&mut self) -> Seen {
        self.switchboard.shutdown(self.now_ns);
        self.settle(Cause::Shutdown);
        assert_eq!(self.switchboard.list(self.now_ns).count(), 0);
        assert_eq!(self.switchboard.devices().filter(|d| d.lease().holder.is_some()).count(), 0);
        self.rules.seen
    }

    /// Draws out what there is to do and holds it against the rules.
    fn settle(&mut self, cause: Cause) {
        self.rules.settle(&mut self.switchboard, cause, &mut self.clients, self.now_ns);
        let closed = self.rules.take_closed();
        self.clients.retain(|client| !closed.contains(&client.id));
    }

    fn connect(&mut self, script: &mut Script<'_>) {
        let transport = script.one_of(&[Transport::Quic, Transport::WebTransport]);
        let turn = usize::from(script.u8());
        let any = |newcomers: &[SessionId]| turn.checked_rem(newcomers.len());
        self.switchboard.make_room(any, self.now_ns);
        match self.switchboard.connect(transport, self.now_ns) {
            Ok(id) => self.welcome(id),
            Err(full) => assert_eq!(full.most, MAX_SESSIONS),
        }
        self.settle(Cause::Connect);
    }

    fn welcome(&mut self, id: SessionId) {
        assert!(self.clients.iter().all(|other| other.id != id), "an id is used once");
        let connected_ns = self.now_ns;
        self.clients.push(Client { id, connected_ns, seq: 0, sent: Vec::new(), pinged: None });
    }

    /// A client of sealed UDP comes for the session that a call has opened for it.
    fn come_sealed(&mut self) {
        let ticket = self.tickets.pop().unwrap_or_default();
        let sealed = Transport::SealedUdp;
        let Some(by) = self.switchboard.join_by_ticket(&ticket, sealed, self.now_ns) else {
            return;
        };
        self.welcome(by);
        self.settle(Cause::Message { by });
    }

    fn client(&mut self, script: &mut Script<'_>) -> Option<usize> {
        (!self.clients.is_empty()).then(|| script.below(self.clients.len()))
    }

    fn hello(&mut self, script: &mut Script<'_>) {
        let Some(index) = self.client(script) else { return self.connect(script) };
        let mut hello = messages::hello(script, &NAMES);
        if script.rarely(10) {
            hello.ticket = match script.below(2) {
                0 => script.bytes(16).to_vec(),
                _ => self.tickets.pop().unwrap_or_default().to_vec(),
            };
        }
        let ticket = !hello.ticket.is_empty();
        let message = StreamMessage { body: Some(stream_message::Body::Hello(hello)) };
        self.say(index, message, ticket);
    }

    fn say(&mut self, index: usize, message: StreamMessage, ticket: bool) {
        let by = self.clients[index].id;
        let now_known_as = self.switchboard.on_message(by, message, self.now_ns);
        assert!(ticket || now_known_as == by, "only a ticket makes a client another session");
        self.clients[index].id = now_known_as;
        self.settle(Cause::Message { by: now_known_as });
    }

    fn command(&mut self, script: &mut Script<'_>) {
        let Some(index) = self.client(script) else { return self.connect(script) };
        let newest = self.loops[script.below(2)].newest_tick;
        let client = &mut self.clients[index];
        let seq = match script.u8() {
            0..=239 => client.seq + 1,
            240..=247 => client.seq + u64::from(script.u16()),
            248..=251 => client.seq.saturating_sub(u64::from(script.u8())),
            _ => script.u64() >> script.below(64),
        };
        client.seq = client.seq.max(seq.min(1 << 50));
        let state_seq = match script.u8() {
            0..=199 => newest,
            200..=219 => 0,
            220..=239 => newest.saturating_sub(script.u8().into()),
            _ => script.u64() >> script.below(64),
        };
        let command = Command {
            seq,
            client_time_ns: if script.rarely(20) { script.u64() } else { self.now_ns },
            state_seq,
            ttl_ms: if script.rarely(10) { script.u32() } else { script.u8().into() },
            body: messages::body(script),
            clutched: script.rarely(12),
            event_ack: if script.rarely(10) { script.u64() } else { 0 },
        };
        self.send(index, encode(&Body::Command(command)), script);
    }

    fn hand_target(&mut self, script: &mut Script<'_>) {
        let Some(index) = self.client(script) else { return self.connect(script) };
        let client = &mut self.clients[index];
        client.seq += 1;
        let target = HandTarget {
            seq: if script.rarely(10) { script.u64() } else { client.seq },
            position_m: script.floats(3, -1.0, 1.0),
            held: !script.rarely(3),
            buttons: u32::from(script.u8() % 4),
            client_time_ns: self.now_ns,
        };
        self.send(index, encode(&Body::HandTarget(target)), script);
    }

    /// Replayed, forged, cut or changed.
    fn again(&mut self, script: &mut Script<'_>) {
        let (Some(by), Some(of)) = (self.client(script), self.client(script)) else { return };
        let sent = &self.clients[of].sent;
        if sent.is_empty() {
            return;
        }
        let mut bytes = sent[script.below(sent.len())].clone();
        match script.below(4) {
            0 => {}
            1 => bytes.truncate(usize::from(script.u16()) % bytes.len().max(1)),
            2 => bytes.extend_from_slice(script.bytes(3)),
            _ => {
                let at = usize::from(script.u16()) % bytes.len().max(1);
                let new = script.u8();
                bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte = new);
            }
        }
        self.send(by, bytes, script);
    }

    fn small_talk(&mut self, script: &mut Script<'_>) {
        let Some(index) = self.client(script) else { return self.connect(script) };
        let ping = Ping { seq: script.u8().into(), sent_ns: self.now_ns };
        let body = match (script.below(4), self.clients[index].pinged) {
            (0, _) => Body::Ping(ping),
            (1 | 2, Some(Ping { seq, sent_ns })) => {
                let received_ns = if script.rarely(8) { script.u64() } else { self.now_ns };
                let returned_ns = received_ns.saturating_add(u64::from(script.u16()));
                let states_received = u64::from(script.u32() >> script.below(32));
                Body::Pong(Pong { seq, sent_ns, received_ns, returned_ns, states_received })
            }
            (1 | 2, None) => {
                let [seq, sent_ns, received_ns, returned_ns] = [(); 4].map(|()| script.u64());
                Body::Pong(Pong { seq, sent_ns, received_ns, returned_ns, states_received: 0 })
            }
            _ => Body::Ack(Ack { event_id: script.u64() >> script.below(64) }),
        };
        self.send(index, encode(&body), script);
    }

    fn rubbish(&mut self, script: &mut Script<'_>) {
        let Some(index) = self.client(script) else { return self.connect(script) };
        let count = if script.rarely(16) { 1_200 } else { script.below(80) };
        let mut bytes = script.bytes(count).to_vec();
        if script.rarely(2) && !bytes.is_empty() && bytes.len() < 128 {
            // A known envelope around whatever it is.
            let key = script.one_of(&[0x0a, 0x12, 0x1a, 0x22, 0x2a, 0x32]);
            bytes.splice(0..0, [key, bytes.len() as u8]);
        }
        self.send(index, bytes, script);
    }

    /// Sends a datagram; once in a while a flood of it before anything is taken out.
    fn send(&mut self, index: usize, bytes: Vec<u8>, script: &mut Script<'_>) {
        let client = &mut self.clients[index];
        if client.sent.len() < KEPT {
            client.sent.push(bytes.clone());
        } else {
            client.sent[bytes.len() % KEPT].clone_from(&bytes);
        }
        let by = client.id;
        let times = if script.rarely(250) { 1 + script.u16() % 2_500 } else { 1 };
        for _ in 0..times {
            self.switchboard.on_datagram(by, &bytes, self.now_ns);
        }
        self.settle(Cause::Datagram { by, times: times.into() });
    }

    /// Whatever else can come on the reliable stream.
    fn message(&mut self, script: &mut Script<'_>) {
        let Some(index) = self.client(script) else { return self.connect(script) };
        let body = match script.below(6) {
            0 => Some(stream_message::Body::Bye(Bye { reason: 1, detail: script.text() })),
            1 => Some(stream_message::Body::Hello(Hello::default())),
            2 => None,
            3 => Some(stream_message::Body::Event(Default::default())),
            _ => return self.frames(index, script),
        };
        self.say(index, StreamMessage { body }, false);
    }

    fn frames(&mut self, index: usize, script: &mut Script<'_>) {
        let count = script.below(120);
        let (mut chunk, mut decoder) = (script.bytes(count), FrameDecoder::default());
        loop {
            let by = self.clients.get(index).map(|client| client.id);
            let Some(by) = by else { return };
            match decoder.next(&mut chunk) {
                Ok(None) => return,
                Ok(Some(message)) => {
                    let known_as = self.switchboard.on_message(by, message, self.now_ns);
                    self.clients[index].id = known_as;
                    self.settle(Cause::Message { by: known_as });
                    if !self.clients.iter().any(|client| client.id == known_as) {
                        return;
                    }
                }
                Err(error) => {
                    self.switchboard.on_broken_stream(by, error, self.now_ns);
                    return self.settle(Cause::Message { by });
                }
            }
        }
    }

    fn ticks(&mut self, script: &mut Script<'_>) {
        let device = script.below(2);
        let count = if script.rarely(4) { script.u8() % 64 } else { 1 };
        for _ in 0..count {
            self.now_ns += MS;
            self.timeouts();
            let setpoint = self.rules.setpoint(device);
            let report = self.loops[device].tick(script, &setpoint, self.now_ns);
            self.rules.check_force(device, &report, &setpoint);
            let late = script.rarely(16);
            if let Some(sessions) = self.switchboard.device(device) {
                if late {
                    sessions.on_late_report(&report);
                } else {
                    sessions.on_report(&report, self.now_ns);
                }
            }
            let events = report.events().count();
            self.settle(Cause::Tick { device, events, late });
        }
    }

    fn time_passes(&mut self, script: &mut Script<'_>) {
        let ms = script.one_of(&[0, 1, 5, 20, 50, 100, 100, 250, 500, 1_000, 2_000, 10_000]);
        let more_ns = if script.rarely(4) { u64::from(script.u32()) } else { 0 };
        self.now_ns += ms * MS + more_ns;
        self.timeouts();
    }

    fn timeouts(&mut self) {
        if self.switchboard.next_timeout().is_some_and(|at_ns| at_ns <= self.now_ns) {
            self.switchboard.on_timeout(self.now_ns);
            let next_ns = self.switchboard.next_timeout();
            assert!(next_ns.is_none_or(|at_ns| at_ns > self.now_ns), "it does not spin");
            self.settle(Cause::Timeout);
        }
    }

    /// What can be called from outside.
    fn operator(&mut self, script: &mut Script<'_>) {
        let now_ns = self.now_ns;
        let some = self.client(script).map(|index| self.clients[index].id);
        let waiting = self.switchboard.list(now_ns).find(|info| info.waiting).map(|info| info.id);
        let some = if script.rarely(4) { waiting.or(some) } else { some };
        match (script.below(5), some) {
            (0, _) => {
                let hello = messages::hello(script, &NAMES);
                let mut ticket = [0; 16];
                ticket[..8].copy_from_slice(&script.u64().to_le_bytes());
                if self.switchboard.open(&hello, ticket, now_ns).is_ok() {
                    self.tickets.push(ticket);
                }
            }
            (1 | 2, Some(id)) => {
                if let Ok(lease) = self.switchboard.acquire_lease(id, script.rarely(2), now_ns) {
                    assert!(lease.holder == Some(id) && lease.epoch > 0);
                }
            }
            (3, Some(id)) => {
                if let Ok(lease) = self.switchboard.release_lease(id, now_ns) {
                    assert!(lease.holder.is_none() && lease.epoch == 0);
                }
            }
            (_, Some(id)) => {
                let _ = self.switchboard.close(id, now_ns);
            }
            _ => {}
        }
        self.settle(Cause::Call);
    }

    fn leave(&mut self, script: &mut Script<'_>) {
        let Some(index) = self.client(script) else { return };
        let client = self.clients.remove(index);
        self.switchboard.disconnect(client.id, self.now_ns);
        self.settle(Cause::Disconnect);
    }

    /// Something happens at a device.
    fn device(&mut self, script: &mut Script<'_>) {
        let own = &mut self.loops[script.below(2)];
        match script.below(4) {
            0 | 1 => {
                use ModeCommand::{ClearFault, Disable, Enable, Stop};
                let command = script.one_of(&[ClearFault, Disable, Enable, Stop]);
                let _ = own.state.apply(ControlCommand::Mode(command), &mut own.plan);
            }
            2 => {
                let step = if script.rarely(8) { script.u64() } else { script.u8().into() } as i64;
                own.sample.counts[0] = own.sample.counts[0].wrapping_add(step);
            }
            _ => own.sample.buttons = u32::from(script.u8() % 4),
        }
    }
}

impl Loop {
    fn new(name: &str) -> Self {
        let mut named = ticks::devices().iter().filter(|(device, _)| device.name.as_str() == name);
        let (device, plan) = named.next().expect("built in");
        assert_eq!(Settings::of(device).guards.stale_ramp_ns, plan.guards.stale_ramp_ns);
        let place_m = device.start_m;
        let sample = ticks::sample_at(plan, place_m[0], place_m[1]).expect("the start was checked");
        let (plan, state) = (Box::new(plan.clone()), ControlState::new(Mode::Enabled));
        Self { plan, state, sample, place_m, newest_tick: 0 }
    }

    fn tick(
        &mut self,
        script: &mut Script<'_>,
        setpoint: &Setpoint,
        now_ns: u64,
    ) -> hapticd::control::Report {
        if script.rarely(3) {
            let there = [
                self.place_m[0] + script.inside(-1e-3, 1e-3),
                self.place_m[1] + script.inside(-1e-3, 1e-3),
            ];
            if let Some(moved) = ticks::sample_at(&self.plan, there[0], there[1]) {
                (self.sample.counts, self.place_m) = (moved.counts, there);
            }
        }
        let lost = script.rarely(60).then_some(DeviceError::Timeout);
        let input = TickInput {
            sample: lost.map_or(Ok(self.sample), Err),
            setpoint,
            plan: &self.plan,
            now_ns,
            overruns_in_row: 0,
        };
        let decision = tick(&mut self.state, &input);
        ticks::check_commands(&self.plan, &decision);
        ticks::check_report(&decision.report);
        self.newest_tick = decision.report.tick;
        decision.report
    }
}
