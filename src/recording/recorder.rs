//! What becomes of Records: segments, which fill the black box and whoever records.
//!
//! One owner feeds it, tick by tick, and never waits here: files are written elsewhere, and
//! what finds no room on its way there is counted. Nothing is encoded while nobody wants it.
//!
//! ```text
//!  tick with a snapshot        tick with a snapshot
//!          │                           │
//!   ───────┼───────────────────────────┼──────────────▶
//!          │ plan, setpoint, ticks ... │ plan, setpoint, ticks ...
//!              ▲ the snapshot itself, some ticks late
//! ```
//!
//! Two snapshots may be on their way at a time, and each may come before its tick or after it,
//! so they are matched by number. One that is late goes into whatever segment is under way:
//! a reader looks for it in the whole file.
//!
//! The black box drops its oldest segment once the others reach back far enough, and is
//! handed over a moment after a fault.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError};

use super::exact::{framed, setpoint_entry};
use super::tick::tick_entry;
use crate::control::{Fault, Obeyed, Record, Setpoint};
use crate::proto::record_entry::Entry;

/// The black box goes on for this long after a fault: what the device did then is told too.
const AFTERMATH_NS: u64 = 200_000_000;

/// A segment that no snapshot ends is given up here; ten times what is usual.
const LARGEST_SEGMENT: usize = 64 << 20;

/// Plans that were announced and wait to be put in force.
const MOST_PLANS: usize = 16;

/// Snapshots that wait for their tick, and ticks that wait for theirs: whoever asks for one
/// waits for it, so there are as many as there are people who ask at a time.
const MOST_SNAPSHOTS: usize = 8;

/// What others tell the recorder.
#[derive(Debug)]
pub enum Message {
    /// A plan that is about to be put in force, as an entry.
    Plan {
        /// Its number.
        generation: u64,
        /// See [`super::plan_entry`].
        entry: Arc<[u8]>,
    },
    /// The state after a tick, as an entry.
    Snapshot {
        /// The tick.
        after_tick: u64,
        /// See [`super::snapshot_entry`].
        entry: Vec<u8>,
    },
    /// Somebody records from the next segment on.
    Begin(Sink),
    /// Somebody has enough.
    End {
        /// Number of the sink.
        id: u64,
    },
}

/// Somebody who records.
#[derive(Debug)]
pub struct Sink {
    /// Tells it from others.
    pub id: u64,
    /// Ends after this time.
    pub length_ns: u64,
    /// Where entries go. Closed at the end.
    pub to: SyncSender<Delivery>,
    /// Counts ticks that found no room there.
    pub lost: Arc<AtomicU64>,
}

/// Some entries.
#[derive(Clone, Debug)]
pub struct Delivery {
    /// Each with its length before it.
    pub bytes: Arc<[u8]>,
    /// How many of them are ticks.
    pub ticks: u64,
}

/// What the black box held at a fault.
#[derive(Clone, Debug)]
pub struct BlackBox {
    /// What happened.
    pub fault: Fault,
    /// When.
    pub tick: u64,
    /// Entries, oldest first; a header is not among them.
    pub segments: Vec<Vec<u8>>,
}

#[derive(Debug, Default)]
struct Segment {
    first_ns: u64,
    bytes: Vec<u8>,
}

#[derive(Debug)]
struct Client {
    sink: Sink,
    /// Device time at its end; `None`: it waits for a segment.
    until_ns: Option<u64>,
}

/// The recorder of one device.
#[derive(Debug)]
pub struct Recorder {
    setpoints: rtrb::Consumer<Setpoint>,
    inbox: Receiver<Message>,
    frozen: std::sync::mpsc::Sender<BlackBox>,
    keep_ns: u64,
    plans: VecDeque<(u64, Arc<[u8]>)>,
    /// The newest that a tick may have used.
    setpoint: Setpoint,
    /// Snapshots that came before their tick.
    early: VecDeque<(u64, Vec<u8>)>,
    /// Numbers of snapshots whose ticks are told already.
    awaited: VecDeque<u64>,
    /// Plans and the setpoint that the segment under way has.
    told_plans: Vec<u64>,
    told_setpoint: u64,
    /// True while a segment is under way.
    open: bool,
    batch: Vec<u8>,
    batch_ticks: u64,
    segments: VecDeque<Segment>,
    clients: Vec<Client>,
    /// The fault that latched last, its tick, and when the black box is handed over.
    fault: Option<Fault>,
    closing: Option<(Fault, u64, u64)>,
}

impl Recorder {
    /// With a black box that keeps at least `keep_ns` (0: none) and goes to `frozen` at faults.
    pub fn new(
        setpoints: rtrb::Consumer<Setpoint>,
        inbox: Receiver<Message>,
        frozen: std::sync::mpsc::Sender<BlackBox>,
        keep_ns: u64,
    ) -> Self {
        Self {
            setpoints,
            inbox,
            frozen,
            keep_ns,
            plans: VecDeque::new(),
            setpoint: Setpoint::NONE,
            early: VecDeque::new(),
            awaited: VecDeque::new(),
            told_plans: Vec::new(),
            told_setpoint: 0,
            open: false,
            batch: Vec::new(),
            batch_ticks: 0,
            segments: VecDeque::new(),
            clients: Vec::new(),
            fault: None,
            closing: None,
        }
    }

    /// Takes one tick in. Call [`Self::flush`] after the last of those there are.
    pub fn observe(&mut self, record: &Record) {
        self.hear();
        self.find_setpoint(record.inputs.setpoint);
        // Generations grow: one that is over never comes back.
        while self.plans.front().is_some_and(|(known, _)| *known < oldest_plan(record)) {
            self.plans.pop_front();
        }
        if record.inputs.obeyed.contains(&Some(Obeyed::Snapshot)) {
            self.begin_segment(record);
        }
        if self.open {
            self.write(record);
        }
        self.end_clients(record.report.time_ns);
        self.watch(record);
    }

    /// Does what was asked meanwhile, also where the loop does not turn, and hands over what has
    /// been gathered.
    pub fn flush(&mut self) {
        self.hear();
        self.hand_over();
    }

    fn hand_over(&mut self) {
        if self.batch.is_empty() {
            return;
        }
        if let Some(segment) = self.segments.back_mut() {
            segment.bytes.extend_from_slice(&self.batch);
            if segment.bytes.len() > LARGEST_SEGMENT {
                self.segments.clear();
                self.open = false;
            }
        }
        let ticks = std::mem::take(&mut self.batch_ticks);
        if self.clients.iter().any(|client| client.until_ns.is_some()) {
            let bytes: Arc<[u8]> = self.batch.as_slice().into();
            self.clients
                .retain_mut(|client| client.until_ns.is_none() || client.take(&bytes, ticks));
        }
        self.batch.clear();
        self.close_unwanted();
    }

    /// What is written for nobody is written no longer: whoever comes begins a segment.
    fn close_unwanted(&mut self) {
        self.open &= self.wanted();
        if !self.open {
            self.awaited.clear();
        }
    }

    /// The loop has ended: everything is handed over.
    pub fn finish(&mut self) {
        self.hand_over();
        if let Some((fault, tick, _)) = self.closing.take() {
            self.freeze(fault, tick);
        }
        self.clients.clear();
    }

    fn hear(&mut self) {
        while let Ok(message) = self.inbox.try_recv() {
            match message {
                Message::Plan { generation, entry } => {
                    // The first may be in force.
                    if self.plans.len() == MOST_PLANS {
                        self.plans.remove(1);
                    }
                    self.plans.push_back((generation, entry));
                }
                Message::Snapshot { after_tick, entry } => self.hear_snapshot(after_tick, entry),
                Message::Begin(sink) => {
                    self.clients.push(Client { sink, until_ns: None });
                }
                Message::End { id } => {
                    self.hand_over();
                    self.clients.retain(|client| client.sink.id != id);
                    self.close_unwanted();
                }
            }
        }
    }

    /// One for a tick that is yet to come waits for it.
    fn hear_snapshot(&mut self, after_tick: u64, entry: Vec<u8>) {
        if let Some(place) = self.awaited.iter().position(|tick| *tick == after_tick) {
            self.awaited.remove(place);
            self.batch.extend_from_slice(&entry);
            return;
        }
        if self.early.len() == MOST_SNAPSHOTS {
            self.early.pop_front();
        }
        self.early.push_back((after_tick, entry));
    }

    /// The snapshot of a segment that begins is written if it is there, or waited for.
    fn begin_with(&mut self, after_tick: u64) {
        // Those of earlier ticks that were told have been written; the others never will be.
        self.early.retain(|(tick, _)| *tick >= after_tick);
        if let Some(place) = self.early.iter().position(|(tick, _)| *tick == after_tick) {
            let (_, entry) = self.early.remove(place).unwrap_or_default();
            self.batch.extend_from_slice(&entry);
            return;
        }
        if self.awaited.len() == MOST_SNAPSHOTS {
            self.awaited.pop_front();
        }
        self.awaited.push_back(after_tick);
    }

    /// The setpoint of this number becomes the present one, if it came.
    fn find_setpoint(&mut self, number: u64) {
        while self.setpoint.number < number {
            match self.setpoints.pop() {
                Ok(setpoint) => self.setpoint = setpoint,
                // It found no room: the recording lacks it, and replay will say so.
                Err(_) => break,
            }
        }
    }

    /// By the black box, or by somebody whose first segment has begun.
    fn wanted(&self) -> bool {
        self.keep_ns > 0 || self.clients.iter().any(|client| client.until_ns.is_some())
    }

    /// True while ticks are encoded.
    #[cfg(test)]
    pub(super) fn is_open(&self) -> bool {
        self.open
    }

    fn begin_segment(&mut self, record: &Record) {
        self.hand_over();
        self.told_plans.clear();
        self.told_setpoint = 0;
        let now_ns = record.report.time_ns;
        for client in self.clients.iter_mut().filter(|client| client.until_ns.is_none()) {
            client.until_ns = Some(now_ns.saturating_add(client.sink.length_ns));
        }
        self.open = self.wanted();
        if !self.open {
            return;
        }
        if self.keep_ns > 0 {
            let enough = |second: &Segment| second.first_ns + self.keep_ns <= now_ns;
            while self.segments.get(1).is_some_and(enough) {
                self.segments.pop_front();
            }
            self.segments.push_back(Segment { first_ns: now_ns, bytes: Vec::new() });
        }
        self.begin_with(record.report.tick.saturating_sub(1));
    }

    fn write(&mut self, record: &Record) {
        let inputs = &record.inputs;
        let swapped = inputs.obeyed.iter().flatten().filter_map(|obeyed| match obeyed {
            Obeyed::Plan(generation) => Some(*generation),
            _ => None,
        });
        for generation in swapped.chain([inputs.plan]) {
            if self.told_plans.contains(&generation) {
                continue;
            }
            if let Some((_, entry)) = self.plans.iter().find(|(known, _)| *known == generation) {
                self.batch.extend_from_slice(entry);
                self.told_plans.push(generation);
            }
        }
        if inputs.setpoint != self.told_setpoint && inputs.setpoint == self.setpoint.number {
            self.batch.extend_from_slice(&setpoint_entry(&self.setpoint));
            self.told_setpoint = inputs.setpoint;
        }
        self.batch.extend_from_slice(&framed(Entry::Tick(tick_entry(record))));
        self.batch_ticks += 1;
    }

    fn end_clients(&mut self, now_ns: u64) {
        let over = |client: &Client| client.until_ns.is_some_and(|until_ns| until_ns <= now_ns);
        if self.clients.iter().any(over) {
            self.hand_over();
            self.clients.retain(|client| !over(client));
            self.close_unwanted();
        }
    }

    /// Looks for a fault, and hands the black box over when its time has come.
    fn watch(&mut self, record: &Record) {
        let report = &record.report;
        if let Some(fault) = report.fault.filter(|_| self.fault.is_none() && self.keep_ns > 0) {
            self.closing = Some((fault, report.tick, report.time_ns + AFTERMATH_NS));
        }
        self.fault = report.fault;
        if let Some((fault, tick, _)) =
            self.closing.filter(|(_, _, at_ns)| report.time_ns >= *at_ns)
        {
            self.closing = None;
            self.hand_over();
            self.freeze(fault, tick);
        }
    }

    /// What was kept goes, and the next segment begins anew.
    fn freeze(&mut self, fault: Fault, tick: u64) {
        let segments = std::mem::take(&mut self.segments);
        let segments = segments.into_iter().map(|segment| segment.bytes).collect();
        // Where nobody listens any more the server is ending.
        let _ = self.frozen.send(BlackBox { fault, tick, segments });
    }
}

/// The first plan that a tick refers to.
fn oldest_plan(record: &Record) -> u64 {
    let swapped = record.inputs.obeyed.iter().flatten().filter_map(|obeyed| match obeyed {
        Obeyed::Plan(generation) => Some(*generation),
        _ => None,
    });
    swapped.fold(record.inputs.plan, u64::min)
}

impl Client {
    /// False when nobody takes it any more.
    fn take(&mut self, bytes: &Arc<[u8]>, ticks: u64) -> bool {
        let delivery = Delivery { bytes: Arc::clone(bytes), ticks };
        match self.sink.to.try_send(delivery) {
            Ok(()) => true,
            Err(TrySendError::Full(_)) => {
                self.sink.lost.fetch_add(ticks, Ordering::Relaxed);
                true
            }
            Err(TrySendError::Disconnected(_)) => false,
        }
    }
}
