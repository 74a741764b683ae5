//! All devices of a server: to which one a client belongs, without socket and clock.
//!
//! A newcomer waits with the first device, which judges silence and rubbish like those of its
//! own; the Hello that names another device takes it there. From then on only that device's
//! [`Sessions`] know it, so nothing that happens to one device is seen by another. Numbers of
//! sessions are unique in the server, because all of them are given by the first device.

use std::collections::HashMap;

use crate::proto::stream_message::Body;
use crate::proto::{Hello, StreamMessage};
use crate::wire::FrameError;

use super::{Output, SessionConfig, SessionId, SessionInfo, Sessions, TooManySessions, Transport};

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

    /// A client connected; it has 2 s for its Hello.
    pub fn connect(
        &mut self,
        transport: Transport,
        now_ns: u64,
    ) -> Result<SessionId, TooManySessions> {
        let most = self.max_sessions;
        let open: usize = self.devices.iter().map(Sessions::connections).sum();
        let first = self.devices.first_mut().filter(|_| open < most);
        let id = first.ok_or(TooManySessions { most })?.connect(transport, now_ns)?;
        self.places.insert(id, 0);
        Ok(id)
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

    /// A message came on the reliable stream.
    pub fn on_message(&mut self, id: SessionId, message: StreamMessage, now_ns: u64) {
        if let Some(Body::Hello(hello)) = &message.body {
            self.route(id, hello);
        }
        if let Some(device) = self.device_of(id) {
            device.on_message(id, message, now_ns);
        }
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
        self.devices.iter_mut().enumerate().find_map(next)
    }

    /// The welcomed sessions of all devices.
    pub fn list(&self, now_ns: u64) -> impl Iterator<Item = SessionInfo<'_>> {
        self.devices.iter().flat_map(move |device| device.list(now_ns))
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
