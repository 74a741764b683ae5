//! What a tick remembers for the next one. Bounded, plain, owned by the real-time thread.

use serde::{Deserialize, Serialize};

use super::activation::Activation;
use super::estimate::Estimator;
use super::passivity::Account;
use super::stale::{Authority, Before};
use super::{ActuatorCommands, ContactResult, Event, Fault, Mode, ModeCommand, ModeRefusal};
use super::{Plan, RELEASED, Report};
use crate::actuation::{LawState, StuckDetector};
use crate::environment::{
    Contact, MAX_CONTACTS, MAX_OBJECTS, MAX_POINTS, MAX_TOUCHES, SurfaceState, Tool,
};
use crate::notation::PlaneVector;

/// Ticks whose sensing time is remembered, to tell the age of a command.
const TIMES: usize = 256;

/// Run-time state of one device's control.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ControlState {
    pub(super) tick: u64,
    pub(super) mode: Mode,
    pub(super) fault: Option<Fault>,
    pub(super) estimator: Estimator,
    pub(super) authority: Authority,
    pub(super) activation: Activation,
    /// The device was enabled: surfaces lose their past before the first tick that renders.
    pub(super) begins: bool,
    pub(super) stuck: StuckDetector,
    /// What the wall law remembers.
    pub(super) law: LawState,
    pub(super) was_stuck: bool,
    /// Of each point of the tool, by slot.
    #[serde(with = "super::snapshot::surfaces")]
    pub(super) scene: Box<[[SurfaceState; MAX_OBJECTS]]>,
    /// Slots of `scene` that may have a past, at the points that the tool has now; every other
    /// state there is as new.
    pub(super) used: Slots,
    pub(super) contacts: ContactStates,
    /// The tool in the last tick, and what it was made from; `None`: surfaces have no past.
    pub(super) tool: Option<(Tool, super::Mount, super::Tool)>,
    /// Epoch and number of the command last in force.
    pub(super) command: (u64, u64),
    /// What was asked in the last tick.
    pub(super) before: Before,
    pub(super) soft_BH_N: PlaneVector,
    /// What the controller fed to the handle.
    pub(super) account: Account,
    pub(super) commands: ActuatorCommands,
    pub(super) last: Report,
    pub(super) touched: ([ContactResult; MAX_TOUCHES], usize),
    /// Ticks in a row without an estimate.
    pub(super) blind_ticks: u32,
    pub(super) events: EventLog,
    #[serde(with = "super::snapshot::times")]
    pub(super) times_ns: [u64; TIMES],
}

impl ControlState {
    /// A device that has just been opened, in this mode.
    pub fn new(mode: Mode) -> Self {
        Self {
            tick: 0,
            mode,
            fault: None,
            estimator: Estimator::default(),
            authority: Authority::default(),
            activation: Activation::default(),
            begins: false,
            stuck: StuckDetector::default(),
            law: LawState::default(),
            was_stuck: false,
            scene: Self::new_surfaces(),
            used: Slots::default(),
            contacts: ContactStates::default(),
            tool: None,
            command: (0, 0),
            before: Before::default(),
            soft_BH_N: PlaneVector::zeros(),
            account: Account::default(),
            commands: RELEASED,
            last: Report::default(),
            touched: ([ContactResult::default(); MAX_TOUCHES], 0),
            blind_ticks: 0,
            events: EventLog::default(),
            times_ns: [0; TIMES],
        }
    }

    /// Surfaces that nothing has touched yet.
    #[expect(clippy::disallowed_macros, reason = "allocates once, before the first tick")]
    pub(super) fn new_surfaces() -> Box<[[SurfaceState; MAX_OBJECTS]]> {
        vec![[SurfaceState::default(); MAX_OBJECTS]; MAX_POINTS].into()
    }

    /// The mode now.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// The latched fault.
    pub fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// Changes the mode, at a tick's edge.
    pub(super) fn command(&mut self, command: ModeCommand) -> Result<Mode, ModeRefusal> {
        let mode = self.mode.after(command)?;
        if command == ModeCommand::ClearFault {
            self.fault = None;
            self.blind_ticks = 0;
            self.estimator.reset();
        }
        self.enter(mode);
        Ok(mode)
    }

    /// Latches a fault; the first one stays.
    pub(super) fn latch(&mut self, fault: Fault) {
        if self.fault.is_none() {
            self.fault = Some(fault);
            self.events.push(Event::Fault(fault));
        }
        self.enter(Mode::Fault);
    }

    /// A slot that is free may next hold another object, which has no past.
    pub fn forget_slots_not_in(&mut self, plan: &Plan) {
        let mut kept = Slots::default();
        plan.scene.iter().for_each(|item| kept.insert(usize::from(item.slot)));
        self.forget_slots(self.used.without(kept));
    }

    /// Writes only what may have a past: all states together are half a megabyte.
    fn forget_slots(&mut self, slots: Slots) {
        let points = self.tool.as_ref().map_or(0, |(tool, ..)| tool.points().len());
        for layer in self.scene.iter_mut().take(points) {
            slots.iter().for_each(|slot| layer[slot].reset());
        }
        self.used = self.used.without(slots);
    }

    /// Surfaces have no past: what the tool is inside of now is given away.
    pub(super) fn forget_surfaces(&mut self) {
        self.forget_slots(self.used);
        self.contacts = ContactStates::default();
    }

    fn enter(&mut self, mode: Mode) {
        if self.mode != mode {
            self.mode = mode;
            self.activation.enter(mode);
            self.begins = mode == Mode::Enabled;
            self.events.push(Event::Mode(mode));
        }
    }

    pub(super) fn remember_time(&mut self, now_ns: u64) {
        self.times_ns[self.tick as usize % TIMES] = now_ns;
    }

    /// From the sensing of `tick` to now; saturates at the oldest tick remembered.
    pub(super) fn since_tick_ns(&self, tick: u64, now_ns: u64) -> u64 {
        let oldest = self.tick.saturating_sub(TIMES as u64 - 1);
        now_ns.saturating_sub(self.times_ns[tick.max(oldest) as usize % TIMES])
    }
}

/// A set of slots of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub(super) struct Slots([u64; MAX_OBJECTS.div_ceil(64)]);

impl Slots {
    /// Adds one; there is none beyond the last slot.
    pub fn insert(&mut self, slot: usize) {
        if slot < MAX_OBJECTS {
            self.0[slot / 64] |= 1 << (slot % 64);
        }
    }

    /// Those that are not in the other set.
    fn without(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] & !other.0[i]))
    }

    fn iter(self) -> impl Iterator<Item = usize> {
        (0..MAX_OBJECTS).filter(move |slot| self.0[slot / 64] >> (slot % 64) & 1 == 1)
    }
}

/// Surface states of the controller's contacts, by contact id.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ContactStates {
    epoch: u64,
    ids: [Option<u32>; MAX_CONTACTS],
    /// Of each point of the tool, in the order of `ids`.
    states: [[SurfaceState; MAX_CONTACTS]; MAX_POINTS],
}

impl Default for ContactStates {
    fn default() -> Self {
        Self {
            epoch: 0,
            ids: [None; MAX_CONTACTS],
            states: [[SurfaceState::default(); MAX_CONTACTS]; MAX_POINTS],
        }
    }
}

impl ContactStates {
    /// Keeps the states of these contacts, in their order, and forgets all others. Another
    /// controller's ids (another lease epoch) mean other surfaces.
    pub fn follow<'a>(&mut self, epoch: u64, contacts: impl Iterator<Item = &'a Contact>) {
        let mut ids = [None; MAX_CONTACTS];
        ids.iter_mut().zip(contacts).for_each(|(id, contact)| *id = Some(contact.id));
        if (epoch, ids) == (self.epoch, self.ids) {
            return;
        }
        let before = if epoch == self.epoch { self.ids } else { [None; MAX_CONTACTS] };
        for layer in &mut self.states {
            let old = *layer;
            for (state, id) in layer.iter_mut().zip(ids) {
                let place = before.iter().position(|known| id.is_some() && *known == id);
                *state = place.map_or_else(SurfaceState::default, |place| old[place]);
            }
        }
        (self.epoch, self.ids) = (epoch, ids);
    }

    /// The states at one point of the tool, in the order last followed.
    pub fn at_point(&mut self, point: usize) -> &mut [SurfaceState] {
        self.states.get_mut(point).map_or(&mut [], |layer| layer)
    }

    /// The state of one contact at one point of the tool.
    pub fn get_mut(&mut self, point: usize, id: u32) -> Option<&mut SurfaceState> {
        let place = self.ids.iter().position(|known| *known == Some(id))?;
        self.states.get_mut(point)?.get_mut(place)
    }
}

/// Events of the tick under way.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct EventLog {
    pub(super) last: u64,
    events: [Option<Event>; super::MAX_EVENTS],
    pub(super) count: usize,
}

impl EventLog {
    /// Adds one; beyond the room of a tick the oldest goes.
    pub fn push(&mut self, event: Event) {
        self.last += 1;
        if self.count == super::MAX_EVENTS {
            self.events.copy_within(1.., 0);
            self.count -= 1;
        }
        self.events[self.count] = Some(event);
        self.count += 1;
    }

    /// Hands the events over with the number of the last.
    pub fn take(&mut self) -> (u64, [Option<Event>; super::MAX_EVENTS]) {
        self.count = 0;
        (self.last, std::mem::take(&mut self.events))
    }
}
