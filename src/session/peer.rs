//! One connected client: when it was heard, and once welcomed, what was agreed with it.

use crate::proto::{ByeReason, SessionState};
use crate::units::FieldError;

use super::cadence::Cadence;
use super::deadband::Deadband;
use super::handshake::Terms;
use super::liveness::{Liveness, SILENCE_NS};
use super::offset::{Clock, Offset};
use super::pace::Pace;
use super::ping::Pinger;
use super::quality::Judge;
use super::state::Echo;
use super::workspace::Workspace;
use super::{Quality, Role, SessionId, Ticket, Transport};

/// Time for the Hello: over a path that loses half of all datagrams it takes seconds. Where there is
/// no room for a newcomer, who has not said it yet makes some.
const HELLO_NS: u64 = 10_000_000_000;

/// A session that was opened by a call is forgotten when no stream joins it in this time.
const WAITING_NS: u64 = 10_000_000_000;

/// A connection, welcomed or not yet.
#[derive(Debug)]
pub(super) struct Peer {
    pub transport: Transport,
    connected_ns: u64,
    heard_ns: u64,
    /// What a good Hello opened.
    pub open: Option<Open>,
    /// Opened by a call, it waits for the stream that shows this.
    pub waiting: Option<Ticket>,
}

/// A welcomed session.
#[derive(Debug)]
pub(super) struct Open {
    pub client_name: String,
    pub role: Role,
    command_interval_ns: u64,
    pub cadence: Cadence,
    pub liveness: Liveness,
    pub pinger: Pinger,
    pub pace: Pace,
    pub offset: Offset,
    /// Of its commands or targets; of pings where it sends neither.
    pub judge: Judge,
    pub workspace: Workspace,
    /// States that it can do without are not sent.
    pub deadband: Option<Deadband>,
    /// Its State has every actuator.
    pub detail: bool,
    pub welcomed_ns: u64,
    /// The newest event that it acknowledged, or that was when it came.
    pub seen_event: u64,
    /// The last command or target taken, 0 for none.
    pub last_seq: u64,
    pub echo: Option<Echo>,
    pub last_refusal: Option<FieldError>,
}

impl Open {
    /// A session on these terms; `newest_event` happened before it.
    pub fn new(terms: Terms, newest_event: u64, now_ns: u64) -> Self {
        Self {
            client_name: terms.client_name,
            role: terms.role,
            command_interval_ns: terms.command_interval_ns,
            cadence: Cadence::new(terms.state_interval_ns),
            liveness: Liveness::new(terms.role, terms.command_interval_ns),
            pinger: Pinger::new(now_ns),
            pace: Pace::new(),
            offset: Offset::default(),
            judge: Judge::new(),
            workspace: terms.workspace,
            deadband: terms.deadband,
            detail: terms.detail,
            welcomed_ns: now_ns,
            seen_event: newest_event,
            last_seq: 0,
            echo: None,
            last_refusal: None,
        }
    }

    /// It has the lease from now on.
    pub fn promote(&mut self) {
        self.role = Role::Controller;
        self.liveness = Liveness::new(Role::Controller, self.command_interval_ns);
        self.judge = Judge::new();
    }

    /// It has the lease no more: it stays, and watches.
    pub fn demote(&mut self) {
        self.role = Role::Observer;
        self.liveness.demote();
        self.judge = Judge::new();
        self.workspace.let_go();
    }

    /// This event and all before it were seen; those after `newest` do not exist yet.
    pub fn acknowledge(&mut self, event: u64, newest: u64) -> bool {
        let known = event <= newest;
        if known {
            self.seen_event = self.seen_event.max(event);
        }
        known
    }
}

impl Peer {
    /// A connection that has said nothing yet.
    pub fn new(transport: Transport, now_ns: u64) -> Self {
        Self { transport, connected_ns: now_ns, heard_ns: now_ns, open: None, waiting: None }
    }

    /// A session that is opened by a call.
    pub fn waiting(ticket: Ticket, now_ns: u64) -> Self {
        let heard_ns = now_ns + (WAITING_NS - SILENCE_NS);
        Self { heard_ns, waiting: Some(ticket), ..Self::new(Transport::Quic, now_ns) }
    }

    /// The stream that it waited for is there.
    pub fn join(&mut self, transport: Transport, now_ns: u64) {
        (self.waiting, self.transport, self.heard_ns) = (None, transport, now_ns);
        if let Some(open) = &mut self.open {
            // Its commands are judged from now on, as if this were its Hello.
            (open.welcomed_ns, open.pinger) = (now_ns, Pinger::new(now_ns));
            open.pace = Pace::new();
        }
    }

    /// Something came from it, whatever it was.
    pub fn heard(&mut self, now_ns: u64) {
        self.heard_ns = self.heard_ns.max(now_ns);
    }

    /// When it is closed unless it speaks; a client that never says Hello gains nothing by
    /// saying other things.
    fn silent_ns(&self) -> u64 {
        match self.open {
            Some(_) => self.heard_ns.saturating_add(SILENCE_NS),
            None => self.connected_ns.saturating_add(HELLO_NS),
        }
    }

    /// Why it has to be closed now, if it has.
    pub fn expired(&self, now_ns: u64) -> Option<(ByeReason, &'static str)> {
        (now_ns >= self.silent_ns()).then_some(match self.open {
            Some(_) if self.waiting.is_some() => {
                (ByeReason::Silent, "no stream joined within 10 s")
            }
            Some(_) => (ByeReason::Silent, "nothing was heard for 2 s"),
            None => (ByeReason::Silent, "no Hello came within 10 s"),
        })
    }

    /// When something is to be done for it.
    pub fn next_timeout(&self) -> u64 {
        let open = self.open.as_ref().filter(|_| self.waiting.is_none());
        let ping_ns = open.map_or(u64::MAX, |open| open.pinger.next_ns());
        ping_ns.min(self.silent_ns())
    }

    /// What lists show of it, once it is welcomed.
    pub fn info(&self, id: SessionId, now_ns: u64) -> Option<SessionInfo<'_>> {
        self.open.as_ref().map(|open| SessionInfo {
            id,
            role: open.role,
            transport: self.transport,
            client_name: &open.client_name,
            state: open.liveness.state(now_ns),
            quality: open.judge.quality(),
            loss: open.judge.path().loss(),
            variation_ns: open.judge.path().variation_ns(),
            rtt_ns: open.pinger.rtt_ns,
            slowed_by: open.pace.slowed_by(),
            clock: open.offset.clock,
            felt_stiffness_ratio: open.workspace.felt_stiffness_ratio(),
            clutched: open.workspace.is_clutched(),
            waiting: self.waiting.is_some(),
            last_refusal: open.last_refusal.as_ref(),
        })
    }
}

/// What lists and metrics show of a welcomed session.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SessionInfo<'a> {
    /// Its name is `sessions/ID`.
    pub id: SessionId,
    /// What it may do.
    pub role: Role,
    /// How it is connected, once its stream has come.
    pub transport: Transport,
    /// What it calls itself.
    pub client_name: &'a str,
    /// Whether it commands.
    pub state: SessionState,
    /// How good its path is.
    pub quality: Quality,
    /// Share of what it sent that never came.
    pub loss: f64,
    /// By how much the one-way delays of neighbours differ, nanoseconds.
    pub variation_ns: f64,
    /// It gets one in so many of the States that it asked for: its path loses them, or lets them
    /// wait.
    pub slowed_by: u32,
    /// Its last round trip, `None` before the first.
    pub rtt_ns: Option<u64>,
    /// Its clock and the two halves of that round trip, estimated.
    pub clock: Option<Clock>,
    /// What is felt of its stiffness and damping: the scale of its workspace.
    pub felt_stiffness_ratio: f64,
    /// Its workspace is lifted off the device.
    pub clutched: bool,
    /// Opened by a call, and no stream has joined it yet.
    pub waiting: bool,
    /// Why its last invalid command was refused: datagrams are not answered.
    pub last_refusal: Option<&'a FieldError>,
}
