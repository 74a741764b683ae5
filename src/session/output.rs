//! What a session core wants done, in a queue that hostile input cannot grow.
//!
//! The caller drains the queue after every call. What may be lost (datagrams, measurements,
//! events) finds no room in a full queue and is dropped; what must be said (answers to a
//! handshake, Bye, Close) always finds room: there are at most a few of them per session.

use std::collections::VecDeque;

use super::hand::HandTarget;
use super::{Direction, SessionId, Transport};
use crate::control::Setpoint;
use crate::proto::{ByeReason, StreamMessage};

/// One thing to do.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// Send a datagram; a late one is worse than a lost one.
    Datagram { to: SessionId, transport: Transport, bytes: Vec<u8> },
    /// Send on the reliable stream.
    Message { to: SessionId, message: StreamMessage },
    /// Flush the reliable stream and close the connection. The session is forgotten already.
    Close { to: SessionId, reason: ByeReason, detail: String },
    /// Hand this to the next tick, in place of the one before.
    Setpoint(Box<Setpoint>),
    /// A round trip was measured: network only, the client's own delay taken off.
    Rtt { transport: Transport, rtt_ns: u64 },
    /// One half of a round trip was estimated; off by at most `bound_ns`.
    OneWay { direction: Direction, delay_ns: u64, bound_ns: u64 },
    /// Pull the handle of the simulated device there, or let go, from now on.
    Hand(HandTarget),
}

/// Most outputs that wait before what may be lost is lost.
const ROOM: usize = 1024;

/// Outputs in the order they were made.
#[derive(Debug, Default)]
pub(super) struct Outbox(VecDeque<Output>);

impl Outbox {
    /// Adds what must be said.
    pub fn must(&mut self, output: Output) {
        self.0.push_back(output);
    }

    /// Adds what may be lost; false when it was.
    pub fn may(&mut self, output: Output) -> bool {
        let room = self.0.len() < ROOM;
        if room {
            self.0.push_back(output);
        }
        room
    }

    /// The oldest output.
    pub fn pop(&mut self) -> Option<Output> {
        self.0.pop_front()
    }
}
