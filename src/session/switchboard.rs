//! All devices of a server: to which one a client belongs, without socket and clock.
//!
//! A newcomer waits with the first device, which judges silence and rubbish like those of its
//! own; the Hello that names another device takes it there. From then on only that device's
//! [`Sessions`] know it, so nothing that happens to one device is seen by another. Numbers of
//! sessions are unique in the server, because all of them are given by the first device.

use std::collections::HashMap;

use crate::proto::stream_message::Body;
use crate::proto::{ByeReason, Hello, StreamMessage, Welcome};
use crate::wire::FrameError;

use super::{
    CallRefusal, LeaseInfo, Output, SessionConfig, SessionId, SessionInfo, Sessions, Ticket,
    TooManySessions, Transport, handshake,
};

/// The sessions of every device of a server.
#[derive(Debug)]
pub struct Switchboard {
    /// Of each device; at least one.
    devices: Vec<Sessions>,
    /// Which of them knows a session.
    places: HashMap<SessionId, usize>,
    max_sessions: usize,
}

impl Switchboard {
    /// No sessions yet. `configs` has one for each device, and `max_sessions` of the first
    /// bounds those of all.
    pub fn new(configs: Vec<SessionConfig>) -> Self {
        let names: Vec<_> = configs.iter().map(|config| config.device.clone()).collect();
        let max_sessions = configs.first().map_or(0, |config| config.max_sessions);
        let sessions = |config| Sessions::new(SessionConfig { devices: names.clone(), ..config });
        let devices = configs.into_iter().map(sessions).collect();
        Self { devices, places: HashMap::new(), max_sessions }
    }

    /// The sessions of one device, in the order of [`Switchboard::new`].
    pub fn device(&mut self, device: usize) -> Option<&mut Sessions> {
        self.devices.get_mut(device)
    }

    /// The wall that was proposed stands elsewhere by now: the device was moved, or its tool
    /// changed.
    pub fn propose_nothing(&mut self, device: &str) {
        let moved = self.devices.iter_mut().filter(|sessions| sessions.config.device == device);
        moved.for_each(|sessions| sessions.config.example_wall = None);
    }

    /// The sessions of each device.
    pub fn devices(&self) -> impl Iterator<Item = &Sessions> {
        self.devices.iter()
    }

    /// A client connected; it has 10 s for its Hello.
    pub fn connect(
        &mut self,
        transport: Transport,
        now_ns: u64,
    ) -> Result<SessionId, TooManySessions> {
        self.check_room()?;
        let id = self.devices[0].connect(transport, now_ns)?;
        self.places.insert(id, 0);
        Ok(id)
    }

    /// Where there is no place left: strangers who say nothing keep nobody out. `choose` says who
    /// of those who have not said Hello goes, the oldest first.
    pub fn make_room(&mut self, choose: impl FnOnce(&[SessionId]) -> Option<usize>, now_ns: u64) {
        if self.check_room().is_ok() {
            return;
        }
        let mut newcomers: Vec<_> = self.devices.iter().flat_map(Sessions::newcomers).collect();
        newcomers.sort_unstable();
        if let Some(id) = choose(&newcomers).and_then(|place| newcomers.get(place)) {
            let said = "another client came before you said Hello, and there was no other place";
            self.send_away(*id, ByeReason::TooManySessions, said, now_ns);
        }
    }

    fn check_room(&self) -> Result<(), TooManySessions> {
        let open: usize = self.devices.iter().map(Sessions::connections).sum();
        let most = self.max_sessions;
        if open < most { Ok(()) } else { Err(TooManySessions { most }) }
    }

    /// Its connection is gone.
    pub fn disconnect(&mut self, id: SessionId, now_ns: u64) {
        if let Some(place) = self.places.remove(&id) {
            self.devices[place].disconnect(id, now_ns);
        }
    }

    /// The server ends: Bye to everyone.
    pub fn shutdown(&mut self, now_ns: u64) {
        self.devices.iter_mut().for_each(|device| device.shutdown(now_ns));
    }

    /// A message came on the reliable stream. Returns by which number the client is known from
    /// now on: another one where it joins a session that waits.
    pub fn on_message(&mut self, id: SessionId, message: StreamMessage, now_ns: u64) -> SessionId {
        if let Some(Body::Hello(hello)) = &message.body {
            if !hello.ticket.is_empty() {
                return self.join(id, hello, now_ns);
            }
            self.route(id, hello);
        }
        if let Some(device) = self.device_of(id) {
            device.on_message(id, message, now_ns);
        }
        id
    }

    /// The reliable stream cannot be read any more.
    pub fn on_broken_stream(&mut self, id: SessionId, error: FrameError, now_ns: u64) {
        if let Some(device) = self.device_of(id) {
            device.on_broken_stream(id, error, now_ns);
        }
    }

    /// A datagram came.
    pub fn on_datagram(&mut self, id: SessionId, bytes: &[u8], now_ns: u64) {
        if let Some(device) = self.device_of(id) {
            device.on_datagram(id, bytes, now_ns);
        }
    }

    /// When [`Switchboard::on_timeout`] has something to do.
    pub fn next_timeout(&self) -> Option<u64> {
        self.devices.iter().filter_map(Sessions::next_timeout).min()
    }

    /// Closes who was silent for too long, and pings the others.
    pub fn on_timeout(&mut self, now_ns: u64) {
        self.devices.iter_mut().for_each(|device| device.on_timeout(now_ns));
    }

    /// The next thing to do, and for which device.
    pub fn poll_output(&mut self) -> Option<(usize, Output)> {
        let next = |(place, device): (usize, &mut Sessions)| Some((place, device.poll_output()?));
        let next = self.devices.iter_mut().enumerate().find_map(next);
        if let Some((_, Output::Close { to, .. })) = &next {
            self.places.remove(to);
        }
        next
    }

    /// The welcomed sessions of all devices.
    pub fn list(&self, now_ns: u64) -> impl Iterator<Item = SessionInfo<'_>> {
        self.devices.iter().flat_map(move |device| device.list(now_ns))
    }

    /// Opens a session for a stream that is to come with this ticket.
    pub fn open(
        &mut self,
        hello: &Hello,
        ticket: Ticket,
        now_ns: u64,
    ) -> Result<Welcome, CallRefusal> {
        self.check_room()?;
        let place = self.devices.iter().position(|device| device.is_called(&hello.device));
        // Where none is, the first device says which there are.
        let place = place.unwrap_or(0);
        let id = self.devices[0].next_id();
        let welcome = self.devices[place].open_by_call(id, hello, ticket, now_ns)?;
        self.places.insert(id, place);
        Ok(welcome)
    }

    /// Sends a session away, or a connection that is none yet.
    pub fn send_away(&mut self, id: SessionId, reason: ByeReason, detail: &str, now_ns: u64) {
        if let Some(device) = self.device_of(id) {
            device.send_away(id, reason, detail, now_ns);
        }
    }

    /// The resource name of the device that a Hello means; `None` where there is none.
    pub fn device_meant(&self, hello: &Hello) -> Option<String> {
        let alone = self.devices.len() == 1 && hello.device.is_empty();
        let known = alone || self.devices.iter().any(|device| device.is_called(&hello.device));
        let name = if alone { self.devices[0].device_name() } else { hello.device.clone() };
        known.then_some(name)
    }

    /// Whether this is a connection that has not said a good Hello yet.
    pub fn is_newcomer(&self, id: SessionId) -> bool {
        let device = self.places.get(&id).and_then(|place| self.devices.get(*place));
        device.is_some_and(|device| device.is_newcomer(id))
    }

    /// What lists show of one session; `None` where it is not welcomed.
    pub fn info(&self, id: SessionId, now_ns: u64) -> Option<SessionInfo<'_>> {
        self.devices.get(*self.places.get(&id)?)?.info(id, now_ns)
    }

    /// Sends a session away.
    pub fn close(&mut self, id: SessionId, now_ns: u64) -> Result<(), CallRefusal> {
        self.known(id)?.close_by_call(id, now_ns)
    }

    /// Makes a session the controller of its device.
    pub fn acquire_lease(
        &mut self,
        id: SessionId,
        takeover: bool,
        now_ns: u64,
    ) -> Result<LeaseInfo, CallRefusal> {
        self.known(id)?.acquire_lease(id, takeover, now_ns)
    }

    /// Makes the controller an observer.
    pub fn release_lease(&mut self, id: SessionId, now_ns: u64) -> Result<LeaseInfo, CallRefusal> {
        self.known(id)?.release_lease(id, now_ns)
    }

    fn known(&mut self, id: SessionId) -> Result<&mut Sessions, CallRefusal> {
        self.device_of(id).ok_or_else(|| CallRefusal::Unknown(id.to_string()))
    }

    /// A newcomer shows a ticket: it becomes the session that waits for it.
    fn join(&mut self, newcomer: SessionId, hello: &Hello, now_ns: u64) -> SessionId {
        let Some(from) = self.places.get(&newcomer).copied() else { return newcomer };
        let waiting = self.devices.iter().find_map(|device| device.waiting_with(&hello.ticket));
        let waiting = waiting.filter(|_| handshake::check_version(hello).is_ok());
        let to = waiting.and_then(|id| Some((id, *self.places.get(&id)?)));
        if let Some((id, place)) = to
            && let Some(peer) = self.devices[from].let_go(newcomer)
        {
            self.places.remove(&newcomer);
            self.devices[place].join_waiting(id, peer.transport, now_ns);
            return id;
        }
        self.devices[from].refuse_ticket(newcomer, hello, now_ns);
        newcomer
    }

    /// A client without a connection of its own has come for the session that waits for this
    /// ticket; it has its place already.
    pub fn join_by_ticket(
        &mut self,
        ticket: &Ticket,
        transport: Transport,
        now_ns: u64,
    ) -> Option<SessionId> {
        let id = self.devices.iter().find_map(|device| device.waiting_with(ticket))?;
        self.device_of(id)?.join_waiting(id, transport, now_ns);
        Some(id)
    }

    fn device_of(&mut self, id: SessionId) -> Option<&mut Sessions> {
        let place = *self.places.get(&id)?;
        self.devices.get_mut(place)
    }

    /// Takes a newcomer to the device that it names. One that names none, or none that is
    /// there, stays where it is, and is refused there.
    fn route(&mut self, id: SessionId, hello: &Hello) {
        let to = self.devices.iter().position(|device| device.is_called(&hello.device));
        let from = self.places.get(&id).copied();
        if let (Some(from), Some(to)) = (from, to)
            && from != to
            && let Some(newcomer) = self.devices[from].let_go(id)
        {
            self.devices[to].take_in(id, newcomer);
            self.places.insert(id, to);
        }
    }
}
