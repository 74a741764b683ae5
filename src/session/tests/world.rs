//! A device that ticks, its sessions, and scripted clients on bad networks, in virtual time.

use super::link::{self, Link, Packet};
use super::*;
use crate::impairment::Impairment;
use crate::proto::{Pong, SessionState};

/// What a client answers a State with: its number, its clock, the State.
pub type Answer = fn(u64, u64, &State) -> Command;

pub const GOOD: Impairment = Impairment { delay_ns: 100_000, ..Impairment::NONE };

pub const BAD: Impairment = Impairment {
    loss: 0.2,
    duplicates: 0.1,
    delay_ns: 20 * MS,
    jitter_ns: 15 * MS,
    ..Impairment::NONE
};

/// A scripted client: says Hello, answers every State with a wall, and every Ping.
pub struct Client {
    pub id: SessionId,
    pub up: Link,
    down: Link,
    pub welcomed: bool,
    pub refused: Option<ByeReason>,
    next_seq: u64,
    newest_state: u64,
    pub states: u64,
    pub rtts_ns: Vec<u64>,
    pub states_seen: Vec<SessionState>,
    /// Where it was told that its tool is, by State number.
    pub positions_m: Vec<(u64, f64)>,
    /// Events that rode in State, in the order in which they were first seen.
    pub events: Vec<u64>,
    pub answer: Answer,
    /// Its clock is ahead of the device's.
    pub ahead_ns: u64,
    /// Silent from then on.
    pub dies_ns: u64,
    /// Sends the newest answer again, as a new command, where it has sent nothing for this long.
    pub at_least_ns: u64,
    newest: Option<State>,
    sent_ns: u64,
}

impl Client {
    fn start(sessions: &mut Sessions, hello: Hello, network: Impairment, seed: u64) -> Self {
        let id = sessions.connect(Transport::Quic, 0).unwrap();
        let mut up = Link::new(network, seed);
        link::send(&mut up, Packet::Message(say(Body::Hello(hello))), 0);
        Self {
            id,
            up,
            down: Link::new(network, seed + 1),
            welcomed: false,
            refused: None,
            next_seq: 1,
            newest_state: 0,
            states: 0,
            rtts_ns: Vec::new(),
            states_seen: Vec::new(),
            positions_m: Vec::new(),
            events: Vec::new(),
            answer: |seq, clock_ns, state| wall_command(seq, clock_ns, state.seq),
            ahead_ns: 0,
            dies_ns: u64::MAX,
            at_least_ns: u64::MAX,
            newest: None,
            sent_ns: 0,
        }
    }

    fn next_ns(&self) -> Option<u64> {
        self.up.next_ns().into_iter().chain(self.down.next_ns()).min()
    }

    fn receive(&mut self, now_ns: u64) {
        while let Some(packet) = self.down.receive(now_ns) {
            match packet {
                Packet::Message(message) => self.on_message(message),
                Packet::Datagram(bytes) if now_ns < self.dies_ns => {
                    self.on_datagram(&bytes, now_ns)
                }
                Packet::Datagram(_) => (),
            }
        }
    }

    fn on_message(&mut self, message: StreamMessage) {
        match message.body {
            Some(Body::Welcome(_)) => self.welcomed = true,
            Some(Body::Bye(bye)) => self.refused = Some(bye.reason()),
            _ => (),
        }
    }

    fn on_datagram(&mut self, bytes: &[u8], now_ns: u64) {
        match wire::decode(bytes).unwrap() {
            DatagramBody::State(state) => self.on_state(&state, now_ns),
            DatagramBody::Ping(ping) => {
                let pong = Pong {
                    seq: ping.seq,
                    sent_ns: ping.sent_ns,
                    received_ns: now_ns + self.ahead_ns,
                    returned_ns: now_ns + self.ahead_ns,
                    states_received: self.states,
                };
                let bytes = wire::encode(&DatagramBody::Pong(pong));
                link::send(&mut self.up, Packet::Datagram(bytes), now_ns);
            }
            other => panic!("{other:?} is not for a client"),
        }
    }

    fn on_state(&mut self, state: &State, now_ns: u64) {
        self.states += 1;
        if state.seq <= self.newest_state {
            return;
        }
        self.newest_state = state.seq;
        self.states_seen.push(state.session_state());
        self.positions_m.push((state.seq, f64::from(state.position_m[0])));
        let newest = self.events.last().copied().unwrap_or(0);
        self.events.extend(state.event_id.iter().filter(|id| **id > newest));
        self.newest = Some(state.clone());
        let clock_ns = now_ns + self.ahead_ns;
        if state.echo_client_time_ns != 0 {
            let hold_ns = u64::from(state.echo_hold_ns);
            self.rtts_ns.push(clock_ns - state.echo_client_time_ns - hold_ns);
        }
        self.command(state, now_ns);
    }

    fn command(&mut self, state: &State, now_ns: u64) {
        let event_ack = self.events.last().copied().unwrap_or(0);
        let clock_ns = now_ns + self.ahead_ns;
        let command = Command { event_ack, ..(self.answer)(self.next_seq, clock_ns, state) };
        self.next_seq += 1;
        self.sent_ns = now_ns;
        link::send(&mut self.up, Packet::Datagram(datagram(command)), now_ns);
    }

    fn keep_on(&mut self, now_ns: u64) {
        if now_ns.saturating_sub(self.sent_ns) < self.at_least_ns {
            return;
        }
        if let Some(state) = self.newest.take() {
            self.command(&state, now_ns);
            self.newest = Some(state);
        }
    }
}

/// A device that ticks, its sessions, and their clients.
pub struct World {
    pub sessions: Sessions,
    pub clients: Vec<Client>,
    pub setpoints: Vec<Setpoint>,
    pub closed: Vec<(SessionId, u64)>,
    pub delays: Vec<(Direction, u64, u64)>,
    pub now_ns: u64,
    /// What a tick tells.
    pub device: fn(u64) -> Report,
}

impl World {
    pub fn new() -> Self {
        Self {
            sessions: sessions(),
            clients: Vec::new(),
            setpoints: Vec::new(),
            closed: Vec::new(),
            delays: Vec::new(),
            now_ns: 0,
            device: report,
        }
    }

    pub fn run_until(&mut self, end_ns: u64) {
        while self.now_ns < end_ns {
            let tick_ns = (self.now_ns / MS + 1) * MS;
            let arrivals = self.clients.iter().filter_map(Client::next_ns);
            let next_ns = arrivals.chain(self.sessions.next_timeout()).min();
            self.now_ns = next_ns.unwrap_or(tick_ns).clamp(self.now_ns, tick_ns);
            self.deliver();
            if self.sessions.next_timeout().is_some_and(|next_ns| next_ns <= self.now_ns) {
                self.sessions.on_timeout(self.now_ns);
                self.act();
            }
            if self.now_ns == tick_ns {
                let tick = tick_ns / MS;
                self.clients.iter_mut().for_each(|client| client.keep_on(tick_ns));
                self.sessions.on_report(&(self.device)(tick), tick_ns);
                self.act();
            }
        }
    }

    fn deliver(&mut self) {
        for index in 0..self.clients.len() {
            self.clients[index].receive(self.now_ns);
            let id = self.clients[index].id;
            while let Some(packet) = self.clients[index].up.receive(self.now_ns) {
                match packet {
                    Packet::Datagram(bytes) => self.sessions.on_datagram(id, &bytes, self.now_ns),
                    Packet::Message(message) => self.sessions.on_message(id, message, self.now_ns),
                }
                self.act();
            }
        }
    }

    fn act(&mut self) {
        while let Some(output) = self.sessions.poll_output() {
            match output {
                Output::Datagram { to, bytes, .. } => self.send(to, Packet::Datagram(bytes)),
                Output::Message { to, message } => self.send(to, Packet::Message(message)),
                Output::Close { to, .. } => self.closed.push((to, self.now_ns)),
                Output::Setpoint(setpoint) => self.setpoints.push(*setpoint),
                Output::Rtt { rtt_ns, .. } => assert!(rtt_ns >= 2 * 100_000),
                Output::OneWay { direction, delay_ns, bound_ns } => {
                    self.delays.push((direction, delay_ns, bound_ns));
                }
                Output::Hand(_) => panic!("nobody pulls"),
            }
        }
    }

    fn send(&mut self, to: SessionId, packet: Packet) {
        let now_ns = self.now_ns;
        let client = self.clients.iter_mut().find(|client| client.id == to).unwrap();
        link::send(&mut client.down, packet, now_ns);
    }

    pub fn add(&mut self, role: Role, network: Impairment, seed: u64) -> usize {
        self.add_with(hello(&format!("client {seed}"), role), network, seed)
    }

    pub fn add_with(&mut self, hello: Hello, network: Impairment, seed: u64) -> usize {
        let client = Client::start(&mut self.sessions, hello, network, seed);
        self.clients.push(client);
        self.clients.len() - 1
    }

    pub fn check_setpoints(&self) {
        for pair in self.setpoints.windows(2) {
            let [before, after] = [&pair[0], &pair[1]].map(|s| (s.epoch, s.seq));
            assert!(before < after || before == after && pair[1].released);
            assert!(pair[0].received_ns <= pair[1].received_ns);
            assert!(pair[1].state_tick * MS <= pair[1].received_ns, "no State of the future");
        }
    }
}
