//! The bridges between the real-time thread and everybody else, generic over what they carry.
//!
//! ```text
//!                    ┌── setpoint, newest value ◀── stream thread
//!   real-time thread ├── reports, ring ──────────▶ stream thread
//!                    ├── records, ring ──────────▶ telemetry thread
//!                    ├── commands, ring ◀───────── supervisor
//!                    └── replies, ring ──────────▶ supervisor
//! ```
//!
//! Every bridge has exactly one producer and one consumer and fixed room; nobody waits for
//! the other side. What finds no room is dropped and counted; a reader that comes late takes
//! all there is and acts on the newest. Waking the other side is not done here.
#![cfg_attr(
    not(test),
    deny(clippy::disallowed_types, clippy::disallowed_methods, clippy::disallowed_macros)
)]

use rtrb::{Consumer, Producer, RingBuffer};
use triple_buffer::{Input, Output, TripleBuffer};

/// Reports that may wait for the stream thread: a quarter of a second at 1 kHz, so that a
/// stall of the machine costs States but no event.
const REPORTS: usize = 256;
/// Records that may wait for the telemetry thread: two seconds at 1 kHz.
const RECORDS: usize = 2048;
/// Commands under way; the supervisor sends one at a time.
const COMMANDS: usize = 4;

/// The real-time thread's end.
pub struct RtEnd<S: Send, R, K, C, P> {
    setpoint: Output<S>,
    reports: Producer<R>,
    records: Producer<K>,
    commands: Consumer<C>,
    replies: Producer<P>,
    dropped: u64,
}

/// The stream thread's end.
#[derive(Debug)]
pub struct StreamEnd<S: Send, R> {
    /// Where the newest command goes.
    pub setpoint: Input<S>,
    /// What each tick reports.
    pub reports: Consumer<R>,
}

/// The supervisor's end.
#[derive(Debug)]
pub struct SupervisorEnd<C, P> {
    /// To the device.
    pub commands: Producer<C>,
    /// From the device.
    pub replies: Consumer<P>,
}

/// Makes the bridges of one device: ends of the real-time thread, the stream thread, the
/// telemetry thread and the supervisor.
#[allow(clippy::type_complexity)] // four ends, each named above
pub fn bridge<S: Clone + Send, R, K, C, P>(
    initial: &S,
) -> (RtEnd<S, R, K, C, P>, StreamEnd<S, R>, Consumer<K>, SupervisorEnd<C, P>) {
    let (setpoint_in, setpoint_out) = TripleBuffer::new(initial).split();
    let (reports_in, reports_out) = RingBuffer::new(REPORTS);
    let (records_in, records_out) = RingBuffer::new(RECORDS);
    let (commands_in, commands_out) = RingBuffer::new(COMMANDS);
    let (replies_in, replies_out) = RingBuffer::new(COMMANDS);
    let rt = RtEnd {
        setpoint: setpoint_out,
        reports: reports_in,
        records: records_in,
        commands: commands_out,
        replies: replies_in,
        dropped: 0,
    };
    let stream = StreamEnd { setpoint: setpoint_in, reports: reports_out };
    let supervisor = SupervisorEnd { commands: commands_in, replies: replies_out };
    (rt, stream, records_out, supervisor)
}

impl<S: Send, R, K, C, P> RtEnd<S, R, K, C, P> {
    /// The newest setpoint.
    pub fn setpoint(&mut self) -> &S {
        self.setpoint.read()
    }

    /// The next command, but only while there is room for its reply: a reply may carry
    /// memory back that must not be freed here.
    pub fn next_command(&mut self) -> Option<C> {
        if self.replies.is_full() {
            return None;
        }
        self.commands.pop().ok()
    }

    /// Answers a command.
    pub fn reply(&mut self, reply: P) {
        // `next_command` saw the room, and nobody else fills it.
        let _ = self.replies.push(reply);
    }

    /// Hands over what a tick did.
    pub fn publish(&mut self, report: R, record: K) {
        self.dropped += u64::from(self.reports.push(report).is_err());
        // A record that finds no room shows as a gap in the numbers of those that do.
        let _ = self.records.push(record);
    }

    /// Reports that found no room.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_setpoint_wins_and_stays() {
        let (mut rt, mut stream, _records, _supervisor) = bridge::<u32, (), (), (), ()>(&0);
        assert_eq!(*rt.setpoint(), 0);
        stream.setpoint.write(1);
        stream.setpoint.write(2);
        assert_eq!(*rt.setpoint(), 2);
        assert_eq!(*rt.setpoint(), 2);
    }

    #[test]
    fn a_reader_that_sleeps_costs_reports_and_never_the_writer() {
        let (mut rt, mut stream, mut records, _supervisor) = bridge::<(), u32, u32, (), ()>(&());
        for tick in 0..1000 {
            rt.publish(tick, tick);
        }
        assert_eq!(rt.dropped(), 1000 - REPORTS as u64);
        assert_eq!(stream.reports.pop(), Ok(0));
        assert_eq!(std::iter::from_fn(|| records.pop().ok()).count(), 1000);
    }

    #[test]
    fn a_command_waits_until_its_reply_has_room() {
        let (mut rt, _stream, _records, mut supervisor) = bridge::<(), (), (), u32, u32>(&());
        for _ in 0..COMMANDS {
            rt.reply(7);
        }
        supervisor.commands.push(1).unwrap();
        assert_eq!(rt.next_command(), None);
        assert_eq!(supervisor.replies.pop(), Ok(7));
        assert_eq!(rt.next_command(), Some(1));
    }
}
