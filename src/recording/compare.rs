//! The recorded hand on a simulated device, under the recorded law and under another.
//!
//! The hand is what is recorded, not its motion: a hand that meets another force goes another
//! way. With a force sensor it becomes a spring and a damper towards a target that follows
//! from the recording, derived here:
//!
//! ```text
//! F = k (x_target - x) - c v      x_target = x_rec + F_rec / k + (c / k) v_rec
//! ```
//!
//! so that on the recorded way it pulls exactly with the recorded force. Both laws meet this
//! hand on the same simulated device, with the encoders of the plan, a force sensor without
//! noise of its own (the recorded force has noise already), and the recorded commands, plans
//! and modes at their ticks. A client that would have answered another State otherwise is not
//! known here. A sample that was lost is lost in every run, and the hand goes on as it did
//! before. Without a force sensor the motion stays the recorded one.

use std::rc::Rc;

use nalgebra::Vector2;

use super::file::Recorded;
use super::measures::{Measures, Moment, measure};
use super::replay::{Built, Store, begins};
use super::report::report_entry;
use super::tick::inputs_of;
use crate::actuation::Strategy;
use crate::control::{ControlState, Decision, Inputs, Plan, Setpoint, TickInput, tick};
use crate::device::{
    ForceSensor, Grip, LONGEST_GAP_NS, Plant, PlantParameters, SUBSTEP_NS, Sensors,
};
use crate::mechanism::KinematicsError;
use crate::notation::{MAX_ACTUATORS, PlaneVector};
use crate::proto::RecordTick;

/// Two laws, one hand.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// NAME of the device.
    pub device: String,
    /// What the hand did in the simulated runs.
    pub hand: Hand,
    /// The recorded one, then the simulated ones.
    pub runs: Vec<Run>,
    /// The plan at the end, for its scene.
    pub plan: Plan,
    /// The last command with contacts, for their surfaces.
    pub setpoint: Option<Setpoint>,
}

/// What is known of the hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hand {
    /// It pulls towards where it wanted to go.
    Follows {
        /// Of its spring.
        stiffness_N_per_m: f64,
        /// Of its damper.
        damping_N_s_per_m: f64,
    },
    /// Its force was not measured.
    Unknown,
}

/// One run.
#[derive(Clone, Debug)]
pub struct Run {
    /// The law, and where it ran.
    pub name: String,
    /// Tick by tick.
    pub moments: Vec<Moment>,
    /// The figures.
    pub measures: Measures,
}

/// Why nothing can be compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// There is no tick to begin at.
    #[error("the recording has no state to begin with")]
    NoBeginning,
    /// Something does not make sense.
    #[error("tick {tick}: {why}")]
    Tick {
        /// Where.
        tick: u64,
        /// What.
        why: String,
    },
    /// The simulated handle cannot be where the recorded one was.
    #[error("the handle cannot begin where it was: {0}")]
    Start(#[from] KinematicsError),
}

/// One recorded tick, ready to be run.
struct Step {
    inputs: Inputs,
    now_ns: u64,
    built: Rc<Built>,
    setpoint: Rc<Setpoint>,
    /// Handle and its velocity in B.
    p_BH: PlaneVector,
    v_BH: PlaneVector,
    /// Where the sample was lost, what it was before.
    F_hand_BH_N: Option<PlaneVector>,
}

/// Runs the first stretch of a recording without a gap under its own law and under `law`.
pub fn compare(recorded: &Recorded, law: Strategy) -> Result<Comparison, CompareError> {
    let mut store = Store::new(recorded);
    let (state, steps, moments) = stretch(recorded, &mut store)?;
    let (Some(first), Some(last)) = (steps.first(), steps.last()) else {
        return Err(CompareError::NoBeginning);
    };
    let tick_s = first.built.plan.tick_s();
    let finished = |name: String, moments: Vec<Moment>| {
        let measures = measure(&moments, tick_s);
        Run { name, moments, measures }
    };
    let own = first.built.plan.strategy;
    let mut sensed = steps.iter().filter_map(|step| step.inputs.sample.ok()).peekable();
    let measured = sensed.peek().is_some() && sensed.all(|sample| sample.F_hand_BH_N.is_some());
    let mut runs = vec![finished(format!("recorded, {own}"), moments)];
    let hand = if measured {
        for law in [own, law] {
            let moments = closed_loop(&mut store, &state, &steps, law)?;
            runs.push(finished(format!("simulated, {law}"), moments));
        }
        let Grip { stiffness_N_per_m, damping_N_s_per_m, .. } = Grip::EASY;
        Hand::Follows { stiffness_N_per_m, damping_N_s_per_m }
    } else {
        let moments = open_loop(&mut store, &state, &steps, law)?;
        runs.push(finished(format!("answering, {law}"), moments));
        Hand::Unknown
    };
    let contacts = |step: &&Step| step.setpoint.contacts().next().is_some();
    Ok(Comparison {
        device: recorded.header.device.clone(),
        hand,
        runs,
        plan: last.built.plan.clone(),
        setpoint: steps.iter().rev().find(contacts).map(|step| *step.setpoint),
    })
}

/// The recorded ticks from the first state on, up to the first gap.
fn stretch(
    recorded: &Recorded,
    store: &mut Store<'_>,
) -> Result<(ControlState, Vec<Step>, Vec<Moment>), CompareError> {
    let mut state = None;
    let (mut steps, mut moments) = (Vec::<Step>::new(), Vec::new());
    let mut last_tick = 0;
    for entry in recorded.ticks() {
        let at = |why: String| CompareError::Tick { tick: entry.tick, why };
        let inputs = inputs_of(&entry).map_err(|why| at(why.to_owned()))?;
        if state.is_none() && begins(&inputs) {
            state = store.state_before(&entry).map_err(at)?;
        } else if state.is_none() {
            continue;
        } else if entry.tick.checked_sub(1) != Some(last_tick) {
            break;
        }
        last_tick = entry.tick;
        let last = steps.last();
        // What is missing ends the stretch; what came before is good.
        let Ok((step, moment)) = step_of(store, &entry, inputs, last, steps.first()) else { break };
        steps.push(step);
        moments.push(moment);
    }
    Ok((state.ok_or(CompareError::NoBeginning)?, steps, moments))
}

fn step_of(
    store: &mut Store<'_>,
    entry: &RecordTick,
    inputs: Inputs,
    last: Option<&Step>,
    first: Option<&Step>,
) -> Result<(Step, Moment), String> {
    let built = store.plan(inputs.plan)?;
    let setpoint = match last.filter(|last| last.inputs.setpoint == inputs.setpoint) {
        Some(last) => Rc::clone(&last.setpoint),
        None => Rc::new(*store.setpoint(inputs.setpoint)?),
    };
    let report = entry.report.as_ref().ok_or("no report")?;
    let since_ns = entry.time_ns.saturating_sub(first.map_or(entry.time_ns, |first| first.now_ns));
    let moment = Moment::of(report, &built.plan, since_ns as f64 * 1e-9).ok_or("no position")?;
    let &[x, y, phi] = report.handle_plane.as_slice() else { return Err("no handle".into()) };
    let v_m_per_s = moment.v_m_per_s;
    let F_hand_BH_N = match inputs.sample {
        Ok(sample) => sample.F_hand_BH_N,
        Err(_) => last.and_then(|last| last.F_hand_BH_N),
    };
    let step = Step {
        inputs,
        now_ns: entry.time_ns,
        built,
        setpoint,
        p_BH: PlaneVector::new(x, y, phi),
        v_BH: PlaneVector::new(v_m_per_s.x, v_m_per_s.y, 0.0),
        F_hand_BH_N,
    };
    Ok((step, moment))
}

/// One tick under another law, with all that was obeyed before it.
fn decide(
    store: &mut Store<'_>,
    state: &mut ControlState,
    step: &Step,
    plan: &Plan,
    inputs: &Inputs,
    resumed: bool,
) -> Result<(Decision, Option<Moment>), CompareError> {
    let tick_number = state.ticks() + 1;
    let at = |why: String| CompareError::Tick { tick: tick_number, why };
    store.obey(state, inputs, resumed).map_err(at)?;
    let input = TickInput {
        sample: inputs.sample,
        setpoint: &step.setpoint,
        plan,
        now_ns: step.now_ns,
        overruns_in_row: inputs.overruns_in_row,
    };
    let decision = tick(state, &input);
    let moment = Moment::of(&report_entry(&decision.report), plan, 0.0);
    Ok((decision, moment))
}

/// Plans under another law, made once each.
struct Laws {
    law: Strategy,
    made: Option<Plan>,
}

impl Laws {
    fn plan(&mut self, built: &Built) -> &Plan {
        let law = self.law;
        if self.made.as_ref().is_some_and(|made| made.generation != built.plan.generation) {
            self.made = None;
        }
        self.made.get_or_insert_with(|| Plan { strategy: law, ..built.plan.clone() })
    }
}

fn open_loop(
    store: &mut Store<'_>,
    state: &ControlState,
    steps: &[Step],
    law: Strategy,
) -> Result<Vec<Moment>, CompareError> {
    let (mut state, mut laws) = (state.clone(), Laws { law, made: None });
    let mut moments = Vec::with_capacity(steps.len());
    for (i, step) in steps.iter().enumerate() {
        let plan = laws.plan(&step.built);
        let (_, moment) = decide(store, &mut state, step, plan, &step.inputs, i == 0)?;
        let time_s = step.now_ns.saturating_sub(steps[0].now_ns) as f64 * 1e-9;
        moments.extend(moment.map(|moment| Moment { time_s, ..moment }));
    }
    Ok(moments)
}

/// The simulated device of a plan.
fn plant_of(step: &Step) -> Result<Plant, KinematicsError> {
    let Built { plan, device } = step.built.as_ref();
    let parameters = PlantParameters {
        mechanism: plan.mechanism.clone(),
        kinds: plan.actuators.kinds,
        max_torque_Nm: plan.actuators.max_torque_Nm,
        lag_s: plan.actuators.lag_s,
        residual_Nm: device.residual_Nm,
        imperfections: device.imperfections,
        damping_N_m_s_per_rad: plan.actuators.damping_N_m_s_per_rad,
        resolution_Nm: plan.actuators.resolution_Nm,
    };
    Plant::new(parameters, &step.p_BH)
}

fn closed_loop(
    store: &mut Store<'_>,
    state: &ControlState,
    steps: &[Step],
    law: Strategy,
) -> Result<Vec<Moment>, CompareError> {
    let mut plant = plant_of(&steps[0])?;
    let counts = steps[0].built.plan.actuators.counts_per_revolution;
    let silent = ForceSensor { noise_rms_N: 0.0, bias_N: 0.0 };
    let mut sensors = Sensors::new(&counts, Some(silent), 0);
    let (mut state, mut laws) = (state.clone(), Laws { law, made: None });
    let mut zero = None;
    let first_counts = steps.iter().find_map(|step| step.inputs.sample.ok()).unwrap_or_default();
    let mut moments = Vec::with_capacity(steps.len());
    for (i, step) in steps.iter().enumerate() {
        let last = &steps[i.saturating_sub(1)];
        let F_hand_BH_N = advance(&mut plant, last, step.now_ns.saturating_sub(last.now_ns));
        let buttons = step.inputs.sample.map_or(0, |recorded| recorded.buttons);
        let mut sample = sensors.read(plant.shaft_rad(), &F_hand_BH_N, buttons);
        // Encoders count on from wherever they were.
        let zero = zero.get_or_insert_with(|| {
            std::array::from_fn::<i64, MAX_ACTUATORS, _>(|i| {
                first_counts.counts[i].wrapping_sub(sample.counts[i])
            })
        });
        for (count, zero) in sample.counts.iter_mut().zip(zero) {
            *count = count.wrapping_add(*zero);
        }
        let inputs = Inputs { sample: step.inputs.sample.map(|_| sample), ..step.inputs };
        let plan = laws.plan(&step.built);
        let (decision, moment) = decide(store, &mut state, step, plan, &inputs, i == 0)?;
        let posture = plan.mechanism.posture_at(plant.p_BH()).ok();
        let truth_N = posture.map(|posture| (posture.reference * plant.torque_Nm()).xy());
        plant.command(&decision.commands);
        let time_s = step.now_ns.saturating_sub(steps[0].now_ns) as f64 * 1e-9;
        moments.extend(moment.map(|moment| Moment { time_s, truth_N, ..moment }));
    }
    Ok(moments)
}

/// Lets time pass under the hand of a recorded tick; what the hand did in the end.
fn advance(plant: &mut Plant, recorded: &Step, elapsed_ns: u64) -> PlaneVector {
    let Grip { stiffness_N_per_m, damping_N_s_per_m, .. } = Grip::EASY;
    let hand = recorded.F_hand_BH_N.unwrap_or_default();
    let target_N = hand + stiffness_N_per_m * recorded.p_BH + damping_N_s_per_m * recorded.v_BH;
    let pull = |plant: &Plant| {
        let pull_N = target_N - stiffness_N_per_m * plant.p_BH() - damping_N_s_per_m * plant.v_BH();
        // Nothing is known of how a hand turns: its moment is the recorded one.
        PlaneVector::new(pull_N.x, pull_N.y, hand.z)
    };
    let elapsed_ns = elapsed_ns.min(LONGEST_GAP_NS);
    let steps = elapsed_ns.div_ceil(SUBSTEP_NS);
    for _ in 0..steps {
        plant.step(&pull(plant), elapsed_ns as f64 / steps as f64 * 1e-9);
    }
    pull(plant)
}

impl Comparison {
    /// The smallest rectangle with every place in it: its corners.
    pub(super) fn extent_m(&self) -> (Vector2<f64>, Vector2<f64>) {
        let places = self.runs.iter().flat_map(|run| &run.moments).map(|moment| moment.p_m);
        let none = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
        places.fold(none, |(low, high), p| (low.inf(&p), high.sup(&p)))
    }
}
