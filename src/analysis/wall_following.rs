//! The wall-following experiment of Cho 2005, section 8, as one function: configuration in,
//! figures of one slide out; on the paper's wall and on what real scenes have.
//!
//! The loop is sample, tick, write, once a millisecond of virtual time. Frames are those of B,
//! in which the scene lies too. The same experiment gives the same figures, bit for bit; the
//! seed is that of the sensor's noise and of a millimetre by which the start differs.
//!
//! A researcher's own law ([`OwnLaw`]) sits where the built-in one sits: it sees what the tick
//! sensed, and its capacities go to the brakes instead.

pub mod beside;
pub mod course;
pub mod fit;
pub mod hand;
pub mod impact;
pub mod perfect;
mod watch;

#[cfg(test)]
mod tests;

pub use beside::Beside;
pub use course::{Course, CourseKind};
pub use fit::NoRoom;
pub use hand::{Flesh, HandSettings};
pub use impact::{Impact, least_depth_m};
pub use perfect::{Perfect, perfect};
pub use watch::{Figures, Moment};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::actuation::{ActuatorKind, Strategy, WallDemand};
use crate::config::{ConfigError, DeviceDefinition, Scene, build_plan};
use crate::control::{ActuatorCommand, ControlState, Decision, Mode, Plan, TickInput, tick};
use crate::device::{Device, HandProgram, SimulatedDevice};
use crate::environment::{Element, SceneItem};
use crate::mechanism::KinematicsError;
use crate::notation::{ActuatorVector, HandleInertia, PlaneVector, ReferenceMatrix};
use hand::CourseHand;
use watch::Watch;

/// Most ticks of one run: the hand gives up long before.
const MAX_TICKS: u64 = 60_000;

/// The start differs by at most this much from seed to seed.
const START_M: f64 = 1e-3;

/// One run.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// A built-in device, or the path of a device file.
    pub device: String,
    /// The law.
    pub strategy: Strategy,
    /// The scene and the path.
    pub course: CourseKind,
    /// What there is beside its walls.
    pub beside: Beside,
    /// What the hand does.
    pub hand: HandSettings,
    /// Stiffness of the walls.
    pub stiffness_N_per_m: f64,
    /// Brake lag of plant and plan; `None`: the device's.
    pub lag_s: Option<f64>,
    /// Encoder counts per turn; `None`: the device's.
    pub counts: Option<f64>,
    /// The hand force is measured.
    pub sensor: bool,
    /// Noise of the sensor, and the start.
    pub seed: u64,
}

impl Default for Experiment {
    fn default() -> Self {
        Self {
            device: "cho-2005".to_owned(),
            strategy: Strategy::Sliding,
            course: CourseKind::Straight,
            beside: Beside::Nothing,
            hand: HandSettings::default(),
            stiffness_N_per_m: 1e7,
            lag_s: None,
            counts: None,
            sensor: true,
            seed: 1,
        }
    }
}

/// Why an experiment did not begin, or did not end.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// There is no such device.
    #[error(transparent)]
    Device(#[from] ConfigError),
    /// Its handle cannot begin where it should.
    #[error("the handle cannot begin there: {0}")]
    Start(#[from] KinematicsError),
    /// The courses are for brakes in the plane.
    #[error("device {name}: wall following needs brakes alone and two freedoms")]
    NotBraked { name: String },
    /// The course does not fit.
    #[error(transparent)]
    NoRoom(#[from] NoRoom),
    /// The researcher's own law failed.
    #[error("the law: {0}")]
    Law(String),
}

/// What a researcher's own law is told in each tick, as the sensors have it; in B.
#[derive(Clone, Debug)]
pub struct Seen<'a> {
    /// Virtual time.
    pub time_s: f64,
    /// The handle.
    pub p_BH_m: PlaneVector,
    /// Its velocity.
    pub v_BH_m_per_s: PlaneVector,
    /// What the hand puts on it; `None`: unknown.
    pub F_hand_BH_N: Option<PlaneVector>,
    /// Handle force per torque.
    pub reference: &'a ReferenceMatrix,
    /// Inertia at the handle.
    pub inertia: &'a HandleInertia,
    /// Walls that are entered.
    pub walls: &'a [WallDemand],
    /// Number of brakes.
    pub actuators: usize,
    /// The most that each can be told.
    pub max_torque_Nm: &'a ActuatorVector,
    /// Their time constants.
    pub lag_s: &'a ActuatorVector,
    /// Time until the next tick.
    pub tick_s: f64,
}

/// A law from outside: capacities of the brakes, N m, from what the tick sensed.
pub trait OwnLaw {
    /// One tick; an error ends the experiment.
    fn capacities(&mut self, seen: &Seen) -> Result<ActuatorVector, String>;
}

/// Runs one slide, from first touch to its end. Refuses a device that does not exist or cannot
/// begin where it should.
pub fn run(experiment: &Experiment) -> Result<Figures, ExperimentError> {
    run_with(experiment, None, |_| ())
}

/// The same under somebody's own law, or watched millisecond by millisecond.
pub fn run_with(
    experiment: &Experiment,
    mut own: Option<&mut dyn OwnLaw>,
    mut watcher: impl FnMut(&Moment),
) -> Result<Figures, ExperimentError> {
    let mut definition = DeviceDefinition::load(&experiment.device)?;
    check(&definition)?;
    if let Some(lag_s) = experiment.lag_s {
        definition.actuators.lag_s = ActuatorVector::repeat(lag_s);
    }
    if let Some(counts) = experiment.counts {
        definition.actuators.counts_per_revolution = ActuatorVector::repeat(counts);
    }
    definition.strategy = experiment.strategy;
    if !experiment.sensor {
        definition.force_sensor = None;
    }
    let course = course_of(experiment, &definition)?;
    let mut device = begin(experiment, &definition, &course)?;
    let mut plan = build_plan(&definition, &Scene::default());
    let items = course.elements.iter().chain(&course.beside).cloned().zip(0..);
    plan.scene = items.map(|(element, slot)| SceneItem { slot, revision: 1, element }).collect();
    let mut state = ControlState::new(Mode::Enabled);
    let mut watch = Watch::default();
    for number in 1..=MAX_TICKS {
        let now_ns = number * plan.tick_ns;
        let sample = device.read(now_ns);
        let truth = device.truth();
        if watch.over(&truth) {
            break;
        }
        let mechanism = definition.mechanism.as_ref();
        watcher(&watch.see(&truth, mechanism, &course, now_ns as f64 * 1e-9));
        let input = TickInput::uncommanded(sample, &plan, now_ns);
        let mut decision = tick(&mut state, &input);
        if let Some(law) = own.as_deref_mut() {
            obey(law, &mut decision, &plan, &course)?;
        }
        // A simulated device takes every command.
        let _ = device.write(&decision.commands);
    }
    Ok(watch.figures(&course, plan.tick_s()))
}

/// Refuses a device that the courses are not for.
pub fn check(definition: &DeviceDefinition) -> Result<(), ExperimentError> {
    let mechanism = definition.mechanism.as_ref();
    let kinds = &definition.actuators.kinds[..mechanism.actuators()];
    let braked = kinds.iter().all(|kind| *kind == ActuatorKind::Brake);
    if mechanism.freedoms() == 2 && braked {
        Ok(())
    } else {
        Err(ExperimentError::NotBraked { name: definition.name.to_string() })
    }
}

/// The course where the device has room for it, with what is beside its walls.
pub fn course_of(
    experiment: &Experiment,
    definition: &DeviceDefinition,
) -> Result<Course, ExperimentError> {
    let Experiment { course, stiffness_N_per_m, beside, .. } = experiment;
    let mechanism = definition.mechanism.as_ref();
    Ok(Course::on(*course, *stiffness_N_per_m, mechanism)?.with(beside))
}

/// The device with the hand at the beginning of the course.
fn begin(
    experiment: &Experiment,
    definition: &DeviceDefinition,
    course: &Course,
) -> Result<SimulatedDevice, ExperimentError> {
    let mut simulation = definition.simulation(HandProgram::Hold);
    simulation.start_m = course.start_m(experiment.hand.clearance_m);
    let mut rng = ChaCha8Rng::seed_from_u64(experiment.seed);
    for (place_m, along) in simulation.start_m.iter_mut().zip(course.legs[0].at(0.0).tangent.iter())
    {
        *place_m += along * rng.random_range(0.0..START_M);
    }
    let mut device = SimulatedDevice::new(simulation, experiment.seed)?;
    device.hand_over(Box::new(CourseHand::new(experiment.hand, course)));
    Ok(device)
}

/// Replaces what the built-in law decided by what `law` says.
fn obey(
    law: &mut dyn OwnLaw,
    decision: &mut Decision,
    plan: &Plan,
    course: &Course,
) -> Result<(), ExperimentError> {
    let report = &decision.report;
    let Ok(posture) = plan.mechanism.posture_at(&report.p_BH) else { return Ok(()) };
    let stiffness_N_per_m = course.elements.iter().find_map(stiffness).unwrap_or(0.0);
    let entered = course.walls_at(&report.p_BH).filter(|(_, depth_m)| *depth_m > 0.0);
    let walls: Vec<WallDemand> = entered
        .map(|(normal, depth_m)| {
            let force_N = (stiffness_N_per_m * depth_m).min(plan.guards.force_limit_N);
            WallDemand { normal, force_N, depth_m }
        })
        .collect();
    let planar = |force: &nalgebra::Vector3<f64>| plan.W_to_plane(force).0;
    let seen = Seen {
        time_s: report.time_ns as f64 * 1e-9,
        p_BH_m: report.p_BH,
        v_BH_m_per_s: planar(&report.v_WT_m_per_s),
        F_hand_BH_N: report.hand.map(|hand| planar(&hand.force_N)),
        reference: &posture.reference,
        inertia: &posture.inertia,
        walls: &walls,
        actuators: plan.mechanism.actuators(),
        max_torque_Nm: &plan.actuators.max_torque_Nm,
        lag_s: &plan.actuators.lag_s,
        tick_s: plan.tick_s(),
    };
    let capacity_Nm = law.capacities(&seen).map_err(ExperimentError::Law)?;
    for (i, command) in decision.commands.iter_mut().enumerate().take(seen.actuators) {
        *command = ActuatorCommand::Brake { capacity_Nm: capacity_Nm[i] };
    }
    Ok(())
}

fn stiffness(element: &Element) -> Option<f64> {
    match element {
        Element::Surface(surface) => Some(surface.material.stiffness_N_per_m),
        Element::Corridor(corridor) => Some(corridor.material.stiffness_N_per_m),
        _ => None,
    }
}
