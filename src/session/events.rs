//! What happened: as messages on the reliable stream, and riding in State until seen.
//!
//! The device numbers its own events without a gap, so a client sees what it missed. A
//! change of the lease is no event of the device and has no number; it does not ride. What
//! rides is bounded in number and in time: a client that never acknowledges pays with a few
//! bytes for a few seconds, and misses nothing on the stream.

use crate::control::Event;
use crate::proto::{self, EventKind, StreamMessage, stream_message::Body};
use crate::wire::EventPart;

use super::mapping::surface_id;

/// Most events that ride.
const RIDING: usize = 8;

/// How long an event rides.
const RIDES_NS: u64 = 5_000_000_000;

/// The newest events of the device, the oldest first.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Riding {
    newest: u64,
    parts: [EventPart; RIDING],
    times_ns: [u64; RIDING],
    count: usize,
}

impl Riding {
    /// An event of the device, newer than those before; the oldest goes where there is no
    /// room.
    pub fn push(&mut self, id: u64, time_ns: u64, event: Event) {
        if self.count == RIDING {
            self.drop_first(1);
        }
        let (kind, value) = kind_and_value(event);
        self.parts[self.count] = EventPart { id, kind: kind as u32, value };
        self.times_ns[self.count] = time_ns;
        self.count += 1;
        self.newest = self.newest.max(id);
    }

    /// Lets those go that have ridden long enough.
    pub fn expire(&mut self, now_ns: u64) {
        let times_ns = &self.times_ns[..self.count];
        let old = times_ns.iter().take_while(|time_ns| now_ns.saturating_sub(**time_ns) > RIDES_NS);
        self.drop_first(old.count());
    }

    /// Those after `seen`, the oldest first.
    pub fn after(&self, seen: u64) -> &[EventPart] {
        let parts = &self.parts[..self.count];
        &parts[parts.partition_point(|part| part.id <= seen)..]
    }

    /// Number of the newest event ever, 0 for none.
    pub fn newest(&self) -> u64 {
        self.newest
    }

    fn drop_first(&mut self, count: usize) {
        self.parts.copy_within(count..self.count, 0);
        self.times_ns.copy_within(count..self.count, 0);
        self.count -= count;
    }
}

/// An event of the device.
pub(super) fn of_device(id: u64, time_ns: u64, event: Event) -> StreamMessage {
    StreamMessage { body: Some(Body::Event(event_to_proto(id, time_ns, event))) }
}

/// An event of the device as the contract has it.
pub fn event_to_proto(id: u64, device_time_ns: u64, event: Event) -> proto::Event {
    let (kind, value) = kind_and_value(event);
    proto::Event { id, device_time_ns, kind: kind.into(), value }
}

fn kind_and_value(event: Event) -> (EventKind, u32) {
    match event {
        Event::ContactBegin { source, id } => (EventKind::ContactBegin, surface_id(source, id)),
        Event::ContactEnd { source, id } => (EventKind::ContactEnd, surface_id(source, id)),
        Event::StuckBegin => (EventKind::StuckBegin, 0),
        Event::StuckEnd => (EventKind::StuckEnd, 0),
        Event::Mode(mode) => (EventKind::Mode, proto::Mode::from(mode) as u32),
        Event::Stale => (EventKind::Stale, 0),
        Event::Fault(fault) => (EventKind::Fault, proto::Fault::from(fault) as u32),
        Event::Button(mask) => (EventKind::Button, mask),
    }
}

/// The lease passed: the epoch in force, 0 for none (its low 32 bits).
pub(super) fn of_lease(now_ns: u64, epoch: u64) -> StreamMessage {
    let (id, kind, value) = (0, EventKind::Lease.into(), epoch as u32);
    let event = proto::Event { id, device_time_ns: now_ns, kind, value };
    StreamMessage { body: Some(Body::Event(event)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Fault, Mode};
    use crate::environment::Source;

    #[test]
    fn events_ride_until_they_are_seen_old_or_too_many() {
        let mut riding = Riding::default();
        for id in 1..=12 {
            riding.push(id, id * 1_000_000_000, Event::Button(id as u32));
        }
        let ids = |riding: &Riding, seen| -> Vec<u64> {
            riding.after(seen).iter().map(|part| part.id).collect()
        };
        assert_eq!(ids(&riding, 0), [5, 6, 7, 8, 9, 10, 11, 12]);
        assert_eq!((ids(&riding, 10), riding.after(10)[0].value), (vec![11, 12], 11));
        assert!(ids(&riding, 12).is_empty());
        riding.expire(14_500_000_000);
        assert_eq!(ids(&riding, 0), [10, 11, 12]);
        riding.expire(99_000_000_000);
        assert_eq!((ids(&riding, 0), riding.newest()), (vec![], 12));
    }

    #[test]
    fn every_event_has_its_kind_and_value() {
        let contact = |id| Event::ContactBegin { source: Source::Controller, id };
        let left = Event::ContactEnd { source: Source::Scene, id: 2 };
        let table = [
            (contact(4), EventKind::ContactBegin, 4),
            (left, EventKind::ContactEnd, 0x8000_0002),
            (Event::StuckBegin, EventKind::StuckBegin, 0),
            (Event::StuckEnd, EventKind::StuckEnd, 0),
            (Event::Mode(Mode::Fault), EventKind::Mode, 4),
            (Event::Stale, EventKind::Stale, 0),
            (Event::Fault(Fault::Overrun), EventKind::Fault, 6),
            (Event::Button(5), EventKind::Button, 5),
        ];
        for (event, kind, value) in table {
            let expected = proto::Event { id: 7, device_time_ns: 8, kind: kind.into(), value };
            assert_eq!(event_to_proto(7, 8, event), expected, "{event:?}");
        }
    }
}
