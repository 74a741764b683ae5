//! A controller and an intruder on a bad network, for seconds of virtual time.

use super::link::{Impairment, Link, Packet};
use super::*;
use crate::proto::{Pong, SessionState};

const GOOD: Impairment = Impairment { loss: 0.0, duplicates: 0.0, delay_ns: 100_000, jitter_ns: 0 };

const BAD: Impairment =
    Impairment { loss: 0.2, duplicates: 0.1, delay_ns: 20 * MS, jitter_ns: 15 * MS };

/// A scripted client: says Hello, answers every State with a wall, and every Ping.
struct Client {
    id: SessionId,
    up: Link,
    down: Link,
    welcomed: bool,
    refused: Option<ByeReason>,
    next_seq: u64,
    newest_state: u64,
    states: u64,
    rtts_ns: Vec<u64>,
    states_seen: Vec<SessionState>,
    /// Silent from then on.
    dies_ns: u64,
}

impl Client {
    fn start(sessions: &mut Sessions, role: Role, network: Impairment, seed: u64) -> Self {
        let id = sessions.connect(Transport::Quic, 0).unwrap();
        let mut up = Link::new(network, seed);
        let hello = hello(&format!("client {seed}"), role);
        up.send(Packet::Message(say(Body::Hello(hello))), 0);
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
            dies_ns: u64::MAX,
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
                    received_ns: now_ns,
                    returned_ns: now_ns,
                };
                let bytes = wire::encode(&DatagramBody::Pong(pong));
                self.up.send(Packet::Datagram(bytes), now_ns);
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
        if state.echo_client_time_ns != 0 {
            let hold_ns = u64::from(state.echo_hold_ns);
            self.rtts_ns.push(now_ns - state.echo_client_time_ns - hold_ns);
        }
        let command = wall_command(self.next_seq, now_ns, state.seq);
        self.next_seq += 1;
        self.up.send(Packet::Datagram(datagram(command)), now_ns);
    }
}

/// A device that ticks, its sessions, and their clients.
struct World {
    sessions: Sessions,
    clients: Vec<Client>,
    setpoints: Vec<Setpoint>,
    closed: Vec<(SessionId, u64)>,
    now_ns: u64,
}

impl World {
    fn new() -> Self {
        Self {
            sessions: sessions(),
            clients: Vec::new(),
            setpoints: Vec::new(),
            closed: Vec::new(),
            now_ns: 0,
        }
    }

    fn run_until(&mut self, end_ns: u64) {
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
                self.sessions.on_report(&report(tick), tick_ns);
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
            }
        }
    }

    fn send(&mut self, to: SessionId, packet: Packet) {
        let now_ns = self.now_ns;
        let client = self.clients.iter_mut().find(|client| client.id == to).unwrap();
        client.down.send(packet, now_ns);
    }

    fn add(&mut self, role: Role, network: Impairment, seed: u64) -> usize {
        let client = Client::start(&mut self.sessions, role, network, seed);
        self.clients.push(client);
        self.clients.len() - 1
    }

    fn check_setpoints(&self) {
        for pair in self.setpoints.windows(2) {
            let [before, after] = [&pair[0], &pair[1]].map(|s| (s.epoch, s.seq));
            assert!(before < after || before == after && pair[1].released);
            assert!(pair[0].received_ns <= pair[1].received_ns);
            assert!(pair[1].state_tick * MS <= pair[1].received_ns, "no State of the future");
        }
    }
}

#[test]
fn on_a_good_network_every_state_is_answered_and_every_answer_taken() {
    let mut world = World::new();
    let client = world.add(Role::Controller, GOOD, 1);
    world.run_until(3 * S);
    world.check_setpoints();
    let client = &world.clients[client];
    assert!(client.welcomed);
    assert!(client.states > 2990 && world.setpoints.len() > 2990);
    assert!(client.rtts_ns.iter().all(|rtt_ns| *rtt_ns == 200_000), "the echo gives the path");
    let idle = client.states_seen.iter().filter(|s| **s == SessionState::Idle).count();
    assert!(idle <= 2 && client.states_seen.last() == Some(&SessionState::Commanding));
    assert_eq!(count(&world.sessions, Outcome::Old), 0);
}

#[test]
fn loss_delay_reordering_and_duplicates_only_cost_what_they_take() {
    for seed in 0..4 {
        let mut world = World::new();
        let client = world.add(Role::Controller, BAD, 100 * seed);
        world.run_until(4 * S);
        world.check_setpoints();
        let taken = world.setpoints.len();
        let old = count(&world.sessions, Outcome::Old);
        assert!(taken > 500 && old > 100, "{taken} taken, {old} old");
        assert_eq!(count(&world.sessions, Outcome::Malformed), 0);
        assert_eq!(count(&world.sessions, Outcome::Invalid), 0);
        let client = &world.clients[client];
        assert!(client.rtts_ns.iter().all(|rtt_ns| (40 * MS..=70 * MS).contains(rtt_ns)));
        let commanding = client.states_seen.iter().filter(|s| **s == SessionState::Commanding);
        assert!(commanding.count() * 10 > client.states_seen.len() * 9);
        assert!(world.closed.is_empty());
    }
}

#[test]
fn an_intruder_gets_no_setpoint_out_and_a_vanished_controller_is_replaced() {
    let mut world = World::new();
    let first = world.add(Role::Controller, GOOD, 1);
    world.run_until(S);
    let second = world.add(Role::Controller, GOOD, 10);
    let observer = world.add(Role::Observer, BAD, 20);
    world.run_until(2 * S);
    assert_eq!(world.clients[second].refused, Some(ByeReason::LeaseHeld));
    assert!(world.clients[observer].states > 100);
    assert!(count(&world.sessions, Outcome::NotAllowed) > 50, "it tried");
    assert!(world.setpoints.iter().all(|setpoint| setpoint.epoch == 1));

    world.clients[first].dies_ns = world.now_ns;
    let last_taken_ns = world.setpoints.last().unwrap().received_ns;
    world.run_until(5 * S);
    let (closed, closed_ns) = *world.closed.last().unwrap();
    assert_eq!(closed, world.clients[first].id);
    assert!((2 * S..=2 * S + 200 * MS).contains(&(closed_ns - last_taken_ns)));
    let released = world.setpoints.iter().any(|setpoint| setpoint.released);
    assert!(!released, "its time-to-live had taken its force long before");

    world.add(Role::Controller, BAD, 30);
    world.run_until(7 * S);
    world.check_setpoints();
    let last = world.setpoints.last().unwrap();
    assert_eq!((last.epoch, last.released), (2, false));
}

#[test]
fn the_same_seed_gives_the_same_run() {
    let run = || {
        let mut world = World::new();
        world.add(Role::Controller, BAD, 5);
        world.add(Role::Observer, BAD, 6);
        world.run_until(2 * S);
        world.setpoints
    };
    assert_eq!(run(), run());
}
