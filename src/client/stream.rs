//! The real-time stream from a client's side: State in, Commands out.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use tokio::time::{Interval, MissedTickBehavior};

use super::carrier::{Carrier, Heard};
use super::{ClientError, ConnectString, Transport};
use crate::proto::stream_message::Body as Message;
use crate::proto::{
    Ack, Bye, ByeReason, Command, Contact, Contacts, Event, ForceFieldCommand, HandTarget, Hello,
    Ping, Pong, Role, State, StreamMessage, Welcome, Workspace, WrenchCommand, command,
    datagram::Body,
};
use crate::wire::{self, PROTOCOL};

/// Pings of a client: often enough for a fresh figure, too few to matter.
const PING_INTERVAL: Duration = Duration::from_millis(100);

/// Until the server has answered, something is sent so often.
const STIR: Duration = Duration::from_millis(20);

/// How often a connection is tried that is lost before the server's answer.
const ATTEMPTS: u32 = 4;

/// Things that a State may find waiting behind it; the rest is for the next call.
const AT_ONCE: usize = 64;

/// Pings that may wait for their answer; one that is overtaken by so many is lost.
const WAITING_PINGS: usize = 4096;

/// How a session is asked for.
#[derive(Clone, Debug)]
pub struct Options {
    /// Shown in lists and refusals.
    pub client_name: String,
    /// Observer or controller.
    pub role: Role,
    /// What carries it.
    pub transport: Transport,
    /// `devices/NAME`; empty where the server has one device.
    pub device: String,
    /// How often commands will be sent.
    pub command_interval: Duration,
    /// How often State is wanted; zero: every tick.
    pub state_interval: Duration,
    /// Pings without being asked; without them only [`Client::send_ping`] sends any.
    pub pings: bool,
    /// A controller takes the lease from whoever holds it.
    pub takeover: bool,
    /// State carries every actuator.
    pub detail: bool,
    /// How the client's world lies over the device's; `None`: they are one.
    pub workspace: Option<Workspace>,
    /// Of a session that a call has opened: this stream joins it, on its terms. Else empty.
    pub ticket: Vec<u8>,
    /// Share of the rendered force that may change before State is sent again; 0: every State.
    pub deadband: f32,
    /// Every State that comes is told, in the order in which it came. Without it only the newest of
    /// those that have come: what acts on an old one acts late.
    pub every_state: bool,
}

impl Options {
    /// Every tick's State, commands as often, and a few pings.
    pub fn new(client_name: impl Into<String>, role: Role) -> Self {
        Self {
            client_name: client_name.into(),
            role,
            transport: Transport::Quic,
            device: String::new(),
            command_interval: Duration::from_millis(1),
            state_interval: Duration::ZERO,
            pings: true,
            takeover: false,
            detail: false,
            workspace: None,
            ticket: Vec::new(),
            deadband: 0.0,
            every_state: false,
        }
    }

    fn hello(&self, token: Option<&str>) -> Hello {
        let us = |duration: Duration| u32::try_from(duration.as_micros()).unwrap_or(u32::MAX);
        Hello {
            versions: vec![PROTOCOL.to_owned()],
            client_name: self.client_name.clone(),
            device: self.device.clone(),
            role: self.role.into(),
            command_interval_us: us(self.command_interval),
            state_interval_us: us(self.state_interval),
            max_datagram_bytes: 0,
            takeover: self.takeover,
            detail: self.detail,
            workspace: self.workspace.clone(),
            ticket: self.ticket.clone(),
            deadband: self.deadband,
            token: token.unwrap_or_default().to_owned(),
        }
    }
}

/// Something that came from the server.
#[derive(Clone, Debug, PartialEq)]
pub enum Incoming {
    /// A tick's State.
    State(Box<State>),
    /// Something happened.
    Event(Event),
    /// A Ping came back; the time it took.
    RoundTrip(Duration),
}

/// An open session.
#[derive(Debug)]
pub struct Client {
    carrier: Carrier,
    welcome: Welcome,
    /// `None`: pings only when told to.
    ping: Option<Interval>,
    started: Instant,
    command_seq: u64,
    states_received: u64,
    /// The newest State that was told.
    state_seq: u64,
    every_state: bool,
    /// What came behind a State and is told next.
    waiting: VecDeque<Result<Incoming, ClientError>>,
    ping_seq: u64,
    /// Numbers of the pings that are not answered, with when they were sent.
    unanswered: BTreeMap<u64, Instant>,
    /// The newest event that came on the stream; what is acknowledged.
    event_id: u64,
}

impl Client {
    /// Connects, says Hello and waits for the server's answer. Where the path loses so much that
    /// the connection is over before there is one, it begins again; not where something was
    /// used up by then, a ticket or the call that opens sealed UDP.
    pub async fn connect(target: &ConnectString, options: Options) -> Result<Self, ClientError> {
        let harmless = options.transport != Transport::Udp && options.ticket.is_empty();
        let mut left = if harmless { ATTEMPTS } else { 1 };
        loop {
            left -= 1;
            match Self::attempt(target, &options).await {
                Err(ClientError::Lost(_)) if left > 0 => {}
                ended => return ended,
            }
        }
    }

    async fn attempt(target: &ConnectString, options: &Options) -> Result<Self, ClientError> {
        let hello = options.hello(target.token.as_deref());
        let mut client = Self {
            carrier: Carrier::open(target, options.transport, hello).await?,
            welcome: Welcome::default(),
            // Whoever acknowledges these acknowledges what came before them, too, or lacks it: on
            // a path that loses much a Hello is repeated sooner.
            ping: Some(every(STIR)),
            started: Instant::now(),
            command_seq: 0,
            states_received: 0,
            state_seq: 0,
            every_state: options.every_state,
            waiting: VecDeque::new(),
            ping_seq: 0,
            unanswered: BTreeMap::new(),
            event_id: 0,
        };
        client.welcome = loop {
            let heard = tokio::select! {
                heard = client.carrier.hear() => heard?,
                () = due(&mut client.ping) => {
                    unless_lost(client.send_ping())?;
                    continue;
                }
            };
            match heard {
                Heard::Message(Message::Welcome(welcome)) => break welcome,
                Heard::Message(Message::Bye(bye)) => return Err(said(&bye)),
                Heard::Message(Message::Hello(_) | Message::Event(_)) => {
                    return Err(ClientError::NoWelcome);
                }
                // It overtook the answer; a server that pings and hears nothing gives up.
                Heard::Datagram(datagram) => {
                    unless_lost(client.on_datagram(&datagram).map(|_| ()))?;
                }
            }
        };
        client.ping = options.pings.then(|| every(PING_INTERVAL));
        client.unanswered.clear();
        Ok(client)
    }

    /// What the server answered.
    pub fn welcome(&self) -> &Welcome {
        &self.welcome
    }

    /// The next thing from the server. Answers and sends pings on the way, so it wants to be
    /// called all the time. Cancel safe, but for a State that may be lost as if on the way.
    pub async fn next(&mut self) -> Result<Incoming, ClientError> {
        loop {
            if let Some(waiting) = self.waiting.pop_front() {
                return waiting;
            }
            let incoming = tokio::select! {
                biased;
                heard = self.carrier.hear() => self.take(heard?)?,
                () = due(&mut self.ping) => {
                    unless_lost(self.send_ping())?;
                    None
                }
            };
            match incoming {
                Some(Incoming::State(state)) if !self.every_state => {
                    if let Some(newest) = self.newest(state).await {
                        return Ok(Incoming::State(newest));
                    }
                }
                Some(incoming) => return Ok(incoming),
                None => {}
            }
        }
    }

    /// This State or a newer one that has come, too; `None` where it was overtaken on the way. It
    /// waits for nothing.
    async fn newest(&mut self, mut state: Box<State>) -> Option<Box<State>> {
        for _ in 0..AT_ONCE {
            let Some(heard) = self.carrier.hear_now().await else { break };
            match heard.and_then(|heard| self.take(heard)) {
                Ok(Some(Incoming::State(other))) if other.seq > state.seq => state = other,
                Ok(Some(Incoming::State(_)) | None) => {}
                Ok(Some(incoming)) => self.waiting.push_back(Ok(incoming)),
                Err(error) => {
                    self.waiting.push_back(Err(error));
                    break;
                }
            }
        }
        let newer = state.seq > self.state_seq;
        self.state_seq = self.state_seq.max(state.seq);
        newer.then_some(state)
    }

    /// What has to be told of what was heard.
    fn take(&mut self, heard: Heard) -> Result<Option<Incoming>, ClientError> {
        match heard {
            Heard::Datagram(datagram) => match self.on_datagram(&datagram) {
                Ok(Some(incoming)) => Ok(Some(incoming)),
                answered => unless_lost(answered.map(|_| ())).map(|()| None),
            },
            Heard::Message(Message::Event(event)) => {
                unless_lost(self.saw(event.id))?;
                Ok(Some(Incoming::Event(event)))
            }
            Heard::Message(Message::Bye(bye)) => Err(said(&bye)),
            // A server that repeats itself does no harm.
            Heard::Message(Message::Hello(_) | Message::Welcome(_)) => Ok(None),
        }
    }

    /// States that came until now, told or not.
    pub fn states_received(&self) -> u64 {
        self.states_received
    }

    /// Sends local models computed from State `state_seq`; they hold for `ttl_ms` (0: the
    /// server's default). Returns the command's number.
    pub fn send_contacts(
        &mut self,
        state_seq: u64,
        ttl_ms: u32,
        contacts: Vec<Contact>,
    ) -> Result<u64, ClientError> {
        self.send_command(state_seq, ttl_ms, command::Body::Contacts(Contacts { contacts }))
    }

    /// Sends a force (3 numbers), or force and moment (6), about the tool point.
    pub fn send_wrench(
        &mut self,
        state_seq: u64,
        ttl_ms: u32,
        wrench: Vec<f32>,
    ) -> Result<u64, ClientError> {
        self.send_command(state_seq, ttl_ms, command::Body::Wrench(WrenchCommand { wrench }))
    }

    /// Sends a force field that the device renders at its own rate.
    pub fn send_force_field(
        &mut self,
        state_seq: u64,
        ttl_ms: u32,
        field: ForceFieldCommand,
    ) -> Result<u64, ClientError> {
        self.send_command(state_seq, ttl_ms, command::Body::ForceField(field))
    }

    /// Says that the workspace is lifted off the device; any other command sets it down.
    pub fn send_clutched(&mut self, state_seq: u64, ttl_ms: u32) -> Result<u64, ClientError> {
        let clutched = Command { clutched: true, state_seq, ttl_ms, ..Command::default() };
        self.number_and_send(clutched)
    }

    fn send_command(
        &mut self,
        state_seq: u64,
        ttl_ms: u32,
        body: command::Body,
    ) -> Result<u64, ClientError> {
        let command = Command { state_seq, ttl_ms, body: Some(body), ..Command::default() };
        self.number_and_send(command)
    }

    fn number_and_send(&mut self, command: Command) -> Result<u64, ClientError> {
        self.command_seq += 1;
        self.send(&Body::Command(Command {
            seq: self.command_seq,
            client_time_ns: self.now_ns(),
            event_ack: self.event_id,
            ..command
        }))?;
        Ok(self.command_seq)
    }

    /// Pulls the handle of a simulated device there, or lets go; for role hand.
    pub fn send_hand(
        &mut self,
        position_m: [f32; 3],
        held: bool,
        buttons: u32,
    ) -> Result<u64, ClientError> {
        self.command_seq += 1;
        self.send(&Body::HandTarget(HandTarget {
            seq: self.command_seq,
            position_m: position_m.to_vec(),
            held,
            buttons,
            client_time_ns: self.now_ns(),
        }))?;
        Ok(self.command_seq)
    }

    /// Acknowledges an event that came on the stream. What rides in State alone is left to
    /// come on the stream as well.
    fn saw(&mut self, event_id: u64) -> Result<(), ClientError> {
        if event_id > self.event_id {
            self.event_id = event_id;
            self.send(&Body::Ack(Ack { event_id }))?;
        }
        Ok(())
    }

    /// This client's clock, as it stands in `Command.client_time_ns`; never 0, which would
    /// say that it has none.
    pub fn now_ns(&self) -> u64 {
        u64::try_from(self.started.elapsed().as_nanos()).unwrap_or(u64::MAX).max(1)
    }

    /// Says Bye and waits until the server has it.
    pub async fn close(self) {
        let bye = Bye { reason: ByeReason::Done.into(), detail: String::new() };
        self.carrier.close(StreamMessage { body: Some(Message::Bye(bye)) }).await;
    }

    fn on_datagram(&mut self, bytes: &[u8]) -> Result<Option<Incoming>, ClientError> {
        match wire::decode(bytes) {
            Ok(Body::State(state)) => {
                self.states_received += 1;
                Ok(Some(Incoming::State(Box::new(state))))
            }
            Ok(Body::Ping(ping)) => {
                let now_ns = self.now_ns();
                let Ping { seq, sent_ns } = ping;
                self.send(&Body::Pong(Pong {
                    seq,
                    sent_ns,
                    received_ns: now_ns,
                    returned_ns: now_ns,
                    states_received: self.states_received,
                }))?;
                Ok(None)
            }
            // One that nobody waits for, or that came before, is no answer.
            Ok(Body::Pong(pong)) => {
                let sent = self.unanswered.remove(&pong.seq);
                Ok(sent.map(|sent| Incoming::RoundTrip(sent.elapsed())))
            }
            // The newest wins: what cannot be read is as good as lost.
            Ok(Body::Command(_) | Body::HandTarget(_) | Body::Ack(_)) | Err(_) => Ok(None),
        }
    }

    /// Sends a Ping now; its round trip comes from [`Client::next`].
    pub fn send_ping(&mut self) -> Result<(), ClientError> {
        self.ping_seq += 1;
        let ping = Ping { seq: self.ping_seq, sent_ns: self.now_ns() };
        self.unanswered.insert(self.ping_seq, Instant::now());
        if self.unanswered.len() > WAITING_PINGS {
            self.unanswered.pop_first();
        }
        self.send(&Body::Ping(ping))
    }

    fn send(&mut self, body: &Body) -> Result<(), ClientError> {
        self.carrier.send(wire::encode(body))
    }
}

fn said(bye: &Bye) -> ClientError {
    ClientError::Bye { reason: bye.reason(), detail: bye.detail.clone() }
}

/// What cannot be sent because the connection is over is no news: why, and the last words of the
/// server, are heard next.
fn unless_lost(sent: Result<(), ClientError>) -> Result<(), ClientError> {
    match sent {
        Err(ClientError::Lost(_)) => Ok(()),
        sent => sent,
    }
}

/// The first time after a period.
fn every(period: Duration) -> Interval {
    let mut interval = tokio::time::interval_at(tokio::time::Instant::now() + period, period);
    interval.set_missed_tick_behavior(MissedTickBehavior::Delay);
    interval
}

/// Done when a ping is due.
async fn due(ping: &mut Option<Interval>) {
    match ping {
        Some(ping) => drop(ping.tick().await),
        None => std::future::pending().await,
    }
}
