//! What happened, as messages on the reliable stream.
//!
//! The device numbers its own events without a gap, so a client sees what it missed. A
//! change of the lease is no event of the device and has no number.

use crate::control::Event;
use crate::proto::{self, EventKind, StreamMessage, stream_message::Body};

use super::mapping::surface_id;

/// An event of the device.
pub(super) fn of_device(id: u64, time_ns: u64, event: Event) -> StreamMessage {
    let (kind, value) = match event {
        Event::ContactBegin { source, id } => (EventKind::ContactBegin, surface_id(source, id)),
        Event::ContactEnd { source, id } => (EventKind::ContactEnd, surface_id(source, id)),
        Event::StuckBegin => (EventKind::StuckBegin, 0),
        Event::StuckEnd => (EventKind::StuckEnd, 0),
        Event::Mode(mode) => (EventKind::Mode, proto::Mode::from(mode) as u32),
        Event::Stale => (EventKind::Stale, 0),
        Event::Fault(fault) => (EventKind::Fault, proto::Fault::from(fault) as u32),
        Event::Button(mask) => (EventKind::Button, mask),
    };
    message(id, time_ns, kind, value)
}

/// The lease passed: the epoch in force, 0 for none (its low 32 bits).
pub(super) fn of_lease(now_ns: u64, epoch: u64) -> StreamMessage {
    message(0, now_ns, EventKind::Lease, epoch as u32)
}

fn message(id: u64, device_time_ns: u64, kind: EventKind, value: u32) -> StreamMessage {
    StreamMessage {
        body: Some(Body::Event(proto::Event { id, device_time_ns, kind: kind.into(), value })),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Fault, Mode};
    use crate::environment::Source;

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
            let expected = message(7, 8, kind, value);
            assert_eq!(of_device(7, 8, event), expected, "{event:?}");
        }
    }
}
