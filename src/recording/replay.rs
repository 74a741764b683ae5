//! Runs recorded ticks again and compares every bit of every report.
//!
//! A replay begins at a snapshot and goes on as long as it knows everything that a tick was
//! given; where it does not, it says so and waits for the next snapshot. It ends at the first
//! difference: whatever comes after follows from it.

use std::collections::BTreeMap;
use std::rc::Rc;

use super::exact::{plan_of, setpoint_of, snapshot_of};
use super::file::{End, Recorded};
use super::report::{first_difference, report_entry};
use super::tick::inputs_of;
use crate::config::DeviceDefinition;
use crate::control::{ControlState, Inputs, Obeyed, Plan, Setpoint, TickInput, tick};
use crate::proto::RecordTick;

/// What came of a replay.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// Ticks in the file.
    pub ticks: u64,
    /// Ticks whose reports were found equal, bit by bit.
    pub equal: u64,
    /// The first that is not.
    pub difference: Option<Difference>,
    /// Where something was missing.
    pub gaps: Vec<Gap>,
    /// How the file ends.
    pub end: End,
}

impl Verdict {
    /// True when every tick in the file was compared and found equal; nothing of nothing is not.
    pub fn is_bit_equal(&self) -> bool {
        self.difference.is_none() && self.equal > 0 && self.equal == self.ticks
    }

    fn gap(&mut self, tick: u64, why: String) {
        self.gaps.push(Gap { tick, why });
    }
}

/// Where a replay went another way.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// In this tick.
    pub tick: u64,
    /// In this field of its report.
    pub field: &'static str,
    /// What the file has.
    pub recorded: String,
    /// What came out now.
    pub replayed: String,
}

/// Ticks that could not be run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Gap {
    /// The first of them.
    pub tick: u64,
    /// Why.
    pub why: String,
}

/// A plan and the device it is for.
#[derive(Debug)]
pub(super) struct Built {
    pub plan: Plan,
    pub device: DeviceDefinition,
}

/// Hands out what ticks refer to by number.
pub(super) struct Store<'a> {
    recorded: &'a Recorded,
    plans: BTreeMap<u64, Rc<Built>>,
    setpoint: Setpoint,
}

impl<'a> Store<'a> {
    pub fn new(recorded: &'a Recorded) -> Self {
        Self { recorded, plans: BTreeMap::new(), setpoint: Setpoint::NONE }
    }

    pub fn plan(&mut self, generation: u64) -> Result<Rc<Built>, String> {
        if let Some(plan) = self.plans.get(&generation) {
            return Ok(Rc::clone(plan));
        }
        let entry = self.recorded.plans.get(&generation);
        let entry = entry.ok_or_else(|| format!("plan {generation} is not in the recording"))?;
        let (plan, device) = plan_of(entry).map_err(|why| format!("plan {generation}: {why}"))?;
        let built = Rc::new(Built { plan, device });
        self.plans.insert(generation, Rc::clone(&built));
        Ok(built)
    }

    pub fn setpoint(&mut self, number: u64) -> Result<&Setpoint, String> {
        if number == 0 {
            self.setpoint = Setpoint::NONE;
        } else if number != self.setpoint.number {
            let entry = self.recorded.setpoints.get(&number);
            let entry =
                entry.ok_or_else(|| format!("setpoint {number} is not in the recording"))?;
            self.setpoint =
                setpoint_of(entry).map_err(|why| format!("setpoint {number}: {why}"))?;
            self.setpoint.number = number;
        }
        Ok(&self.setpoint)
    }

    /// The state before a tick, where the recording has it, as of its snapshot.
    pub fn state_before(&self, entry: &RecordTick) -> Result<Option<ControlState>, String> {
        let after_tick = entry.tick.wrapping_sub(1);
        let snapshot = self.recorded.snapshots.get(&after_tick).map(snapshot_of).transpose();
        snapshot.map_err(|why| format!("snapshot after tick {after_tick}: {why}"))
    }

    /// Carries out what was obeyed before a tick. `resumed`: the state is that of the snapshot
    /// among it, so that what came before is in it already.
    pub fn obey(
        &mut self,
        state: &mut ControlState,
        inputs: &Inputs,
        resumed: bool,
    ) -> Result<(), String> {
        let is_snapshot = |obeyed: &Option<Obeyed>| *obeyed == Some(Obeyed::Snapshot);
        let done = inputs.obeyed.iter().rposition(is_snapshot).filter(|_| resumed);
        for obeyed in &inputs.obeyed[done.map_or(0, |place| place + 1)..] {
            let Some(obeyed) = obeyed else { continue };
            match obeyed {
                // A refusal changes nothing, as it did then.
                Obeyed::Mode(command) => {
                    let _ = state.switch(*command, &self.plan(inputs.plan)?.plan);
                }
                Obeyed::Home => {
                    let _ = state.home(&self.plan(inputs.plan)?.plan);
                }
                Obeyed::Plan(generation) => {
                    state.forget_slots_not_in(&self.plan(*generation)?.plan);
                }
                Obeyed::Snapshot => {}
            }
        }
        Ok(())
    }
}

/// True where a tick begins with a snapshot.
pub(super) fn begins(inputs: &Inputs) -> bool {
    inputs.obeyed.contains(&Some(Obeyed::Snapshot))
}

/// Runs the whole recording again.
pub fn replay(recorded: &Recorded) -> Verdict {
    let mut store = Store::new(recorded);
    let mut state: Option<ControlState> = None;
    let mut verdict = Verdict {
        ticks: recorded.len() as u64,
        equal: 0,
        difference: None,
        gaps: Vec::new(),
        end: recorded.end.clone(),
    };
    let mut last_tick = None;
    // Whether the stretch that cannot be run is told already.
    let mut told = false;
    for entry in recorded.ticks() {
        if let Some(gap) = last_tick.replace(entry.tick).and_then(|last| between(last, entry.tick))
        {
            state = None;
            told = true;
            verdict.gaps.push(gap);
        }
        match step(&mut store, &mut state, &entry) {
            Ok(Step::Equal) => {
                verdict.equal += 1;
                told = false;
            }
            Ok(Step::Waiting) if told => {}
            Ok(Step::Waiting) => {
                told = true;
                verdict.gap(entry.tick, "there is no state to begin with".to_owned());
            }
            Ok(Step::Different(difference)) => {
                verdict.difference = Some(difference);
                break;
            }
            Err(why) => {
                state = None;
                told = true;
                verdict.gap(entry.tick, why);
            }
        }
    }
    verdict
}

/// What is wrong between two ticks that follow each other in the file.
fn between(last: u64, this: u64) -> Option<Gap> {
    if this <= last {
        let why = format!("the numbers go back: tick {this} comes after tick {last}");
        return Some(Gap { tick: this, why });
    }
    let (first, end) = (last.saturating_add(1), this.saturating_sub(1));
    let why = || format!("ticks {first} to {end} are not in the recording");
    (first != this).then(|| Gap { tick: first, why: why() })
}

enum Step {
    Equal,
    /// For a snapshot.
    Waiting,
    Different(Difference),
}

fn step(
    store: &mut Store<'_>,
    state: &mut Option<ControlState>,
    entry: &RecordTick,
) -> Result<Step, String> {
    let inputs = inputs_of(entry).map_err(|why| format!("a tick that makes no sense: {why}"))?;
    let resumed = state.is_none() && begins(&inputs);
    if resumed {
        let after_tick = entry.tick.wrapping_sub(1);
        let missing = || format!("the state after tick {after_tick} is not in the recording");
        *state = Some(store.state_before(entry)?.ok_or_else(missing)?);
    }
    let Some(state) = state else { return Ok(Step::Waiting) };
    store.obey(state, &inputs, resumed)?;
    let built = store.plan(inputs.plan)?;
    let setpoint = store.setpoint(inputs.setpoint)?;
    let Inputs { sample, overruns_in_row, .. } = inputs;
    let now_ns = entry.time_ns;
    let input = TickInput { sample, setpoint, plan: &built.plan, now_ns, overruns_in_row };
    let report = tick(state, &input).report;
    let recorded = entry.report.as_ref().ok_or("a tick without a report")?;
    let differs = |(field, recorded, replayed)| {
        Step::Different(Difference { tick: entry.tick, field, recorded, replayed })
    };
    if report.tick != entry.tick {
        return Ok(differs(("tick", entry.tick.to_string(), report.tick.to_string())));
    }
    Ok(first_difference(recorded, &report_entry(&report)).map_or(Step::Equal, differs))
}
