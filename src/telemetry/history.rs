//! What happened on a device lately: its newest events with their numbers, for whoever asks.
//!
//! Bounded: beyond [`KEPT`] the oldest goes. Numbers have no gap of the device's own making,
//! so a reader sees from them what it missed, be it too slow here, lost on the way from the
//! loop, or more than a tick had room for. Times are those of the device clock.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::control::{Event, Report};

/// Events kept: minutes of ordinary use.
pub const KEPT: usize = 1024;

/// An event of the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Happened {
    /// Grows by one per event, from 1.
    pub id: u64,
    /// Device time of its tick.
    pub time_ns: u64,
    /// What it was.
    pub event: Event,
}

/// The newest events of a device.
#[derive(Clone, Debug, Default)]
pub struct EventHistory(Arc<Mutex<Kept>>);

#[derive(Debug, Default)]
struct Kept {
    events: VecDeque<Happened>,
    last: u64,
    ran_out_ns: Option<u64>,
}

impl EventHistory {
    /// Takes in what a tick reports.
    pub fn take_in(&self, report: &Report) {
        let mut kept = self.lock();
        kept.last = report.last_event;
        if report.command_seq != 0 {
            kept.ran_out_ns = None;
        }
        for (id, event) in report.events() {
            if event == Event::Stale {
                kept.ran_out_ns = Some(report.time_ns);
            }
            if kept.events.len() == KEPT {
                kept.events.pop_front();
            }
            kept.events.push_back(Happened { id, time_ns: report.time_ns, event });
        }
    }

    /// The events after number `seen`, the oldest first, at most so many.
    pub fn after(&self, seen: u64, most: usize) -> Vec<Happened> {
        let kept = self.lock();
        let first = kept.events.partition_point(|happened| happened.id <= seen);
        kept.events.range(first..).take(most).copied().collect()
    }

    /// Number of the last event ever, 0 for none.
    pub fn last(&self) -> u64 {
        self.lock().last
    }

    /// When a controller's command ran out, if none was in force since.
    pub fn ran_out_ns(&self) -> Option<u64> {
        self.lock().ran_out_ns
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::MAX_EVENTS;

    fn report(last_event: u64, events: &[Event], command_seq: u64) -> Report {
        let mut report =
            Report { last_event, command_seq, time_ns: last_event, ..Report::default() };
        report.events[..events.len()].iter_mut().zip(events).for_each(|(e, of)| *e = Some(*of));
        report
    }

    #[test]
    fn the_newest_are_kept_with_their_numbers() {
        let history = EventHistory::default();
        assert_eq!((history.last(), history.after(0, 9)), (0, Vec::new()));
        let mut last = 0;
        for _ in 0..200 {
            last += MAX_EVENTS as u64;
            history.take_in(&report(last, &[Event::StuckBegin; MAX_EVENTS], 0));
            history.take_in(&report(last, &[], 0));
        }
        assert_eq!(history.last(), 1600);
        let kept = history.after(0, usize::MAX);
        let ids: Vec<_> = kept.iter().map(|happened| happened.id).collect();
        assert_eq!(ids, (1600 - KEPT as u64 + 1..=1600).collect::<Vec<_>>());
        assert_eq!(history.after(1_000, 2).iter().map(|e| e.id).collect::<Vec<_>>(), [1001, 1002]);
        assert!(history.after(1600, 9).is_empty() && history.after(u64::MAX, 9).is_empty());
        assert_eq!(kept.last().unwrap().time_ns, 1600);
    }

    #[test]
    fn a_command_that_ran_out_is_remembered_until_the_next_one() {
        let history = EventHistory::default();
        history.take_in(&report(0, &[], 3));
        assert_eq!(history.ran_out_ns(), None);
        history.take_in(&report(5, &[Event::Stale], 0));
        history.take_in(&report(6, &[Event::StuckEnd], 0));
        assert_eq!(history.ran_out_ns(), Some(5));
        history.take_in(&report(6, &[], 4));
        assert_eq!(history.ran_out_ns(), None);
    }
}
