//! What a tick does to the sessions: State to those whose turn it is, and events.
//!
//! Most of a State is the same for everybody and filled in once; the controller's goes out
//! first. An event goes to every welcomed session on the reliable stream at once, and rides
//! in State until it is acknowledged.

use super::deadband::Marks;
use super::peer::Peer;
use super::state::{DeepestFirst, Own, address, fill, fill_detail};
use super::{Output, Sessions, events, send};
use crate::control::{Event, Report};
use crate::proto::StreamMessage;
use crate::wire::{self, StateParts};

impl Sessions {
    /// A tick was done, and its report came when there was a newer one already: its events to
    /// everyone, but no State, which would be old.
    pub fn on_late_report(&mut self, report: &Report) {
        self.note(report);
    }

    /// A tick was done: State to those whose turn it is, the controller first, and its
    /// events to everyone.
    pub fn on_report(&mut self, report: &Report, now_ns: u64) {
        self.note(report);
        self.riding.expire(now_ns);
        fill(&mut self.state, report);
        fill_detail(&mut self.detail, report, self.config.actuators as usize);
        let contacts = DeepestFirst::of(report);
        for to_controller in [true, false] {
            self.send_states(to_controller, report, contacts, now_ns);
        }
    }

    fn note(&mut self, report: &Report) {
        if report.tick > self.history.newest() {
            self.p_WT_m = report.p_WT_m;
        }
        self.history.note(report.tick, report.time_ns);
        self.scene_revision = report.scene_revision;
        let clutched = self.peers.values_mut().filter_map(|peer| peer.open.as_mut());
        clutched.for_each(|open| open.workspace.follow(&self.p_WT_m));
        for (number, event) in report.events() {
            if event == Event::Stale && self.setpoint.seq != 0 && !self.setpoint.released {
                self.counters.count_stale(self.ending);
            }
            self.riding.push(number, report.time_ns, event);
            self.tell_all(&events::of_device(number, report.time_ns, event));
        }
    }

    fn send_states(
        &mut self,
        to_controller: bool,
        report: &Report,
        contacts: DeepestFirst,
        now_ns: u64,
    ) {
        let holder = self.lease.holder();
        for (id, peer) in &mut self.peers {
            let Some(open) = peer.open.as_mut().filter(|_| peer.waiting.is_none()) else {
                continue;
            };
            if (holder == Some(*id)) != to_controller
                || !open.cadence.due(report.tick, self.config.tick_ns, open.pace.slowed_by())
            {
                continue;
            }
            let (session, quality) = (open.liveness.state(now_ns), open.judge.quality());
            if let Some(deadband) = &mut open.deadband {
                let marks = Marks::of(report, session, quality, self.riding.newest());
                if !deadband.due(report, marks, open.pace.slowed_by().into()) {
                    continue;
                }
            }
            let own = Own { session, quality, echo: open.echo, workspace: &open.workspace };
            address(&mut self.state, report, &own, now_ns);
            let contacts = contacts.seen_in(&open.workspace);
            let parts = StateParts {
                deepest_first: contacts.as_slice(),
                oldest_first: self.riding.after(open.seen_event),
                detail: open.detail.then_some(&self.detail),
            };
            let bytes = wire::encode_state(&mut self.state, &parts);
            open.pace.state_sent();
            let to = (*id, peer.transport);
            send(&mut self.outbox, &mut self.counters, to, bytes);
        }
    }

    /// To every welcomed session.
    pub(super) fn tell_all(&mut self, message: &StreamMessage) {
        let there = |peer: &Peer| peer.open.is_some() && peer.waiting.is_none();
        for (id, _) in self.peers.iter().filter(|(_, peer)| there(peer)) {
            self.outbox.may(Output::Message { to: *id, message: message.clone() });
        }
    }
}
