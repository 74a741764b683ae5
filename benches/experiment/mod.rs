//! A simulated device under the real law in virtual time, one tick after the other.
//!
//! The hand, the linkage and the sensors are those of `demo`; only the thread and the sockets
//! are left out. A controller answers every tick at once with the contacts it was given.

#![allow(dead_code)] // each bench takes what it needs

use std::hint::black_box;
use std::time::Duration;

use hapticd::config::{DeviceDefinition, Scene, build_plan};
use hapticd::control::{ControlState, Mode, Plan, Report, Sample, Setpoint, TickInput, tick};
use hapticd::device::{Device, HandProgram, SimulatedDevice};
use hapticd::environment::{Contact, Element, Material, SceneItem, Shape, Surface};
use hapticd::notation::ActuatorVector;
use nalgebra::Vector3;

use super::measure::timed;

/// Where the wall of the experiment stands, metres along x; its normal is -x.
pub const WALL_X_M: f64 = 0.3;

/// Stiffness of that wall, N/m.
pub const WALL_N_PER_M: f64 = 1e7;

/// A plane whose free side is where `normal_W` points.
pub fn plane(point_W_m: Vector3<f64>, normal_W: Vector3<f64>, friction: f64) -> Surface {
    let material = Material { stiffness_N_per_m: WALL_N_PER_M, ..Material::default() };
    let material = material.with_friction(friction);
    Surface {
        shape: Shape::HalfSpace { point_W_m, normal_W },
        material,
        hollow: false,
        blend_s: 0.0,
    }
}

/// The wall of the experiment.
pub fn wall(friction: f64) -> Surface {
    plane(Vector3::new(WALL_X_M, 0.0, 0.0), -Vector3::x(), friction)
}

/// The wall as a controller streams it.
pub fn wall_contact() -> Contact {
    Contact { id: 1, revision: 1, surface: wall(0.0) }
}

/// Elements as a scene, slot by slot.
pub fn scene(elements: impl IntoIterator<Item = Element>) -> Box<[SceneItem]> {
    let item = |(slot, element)| SceneItem { slot: slot as u16, revision: 1, element };
    elements.into_iter().enumerate().map(item).collect()
}

/// A device, its law, and a controller.
pub struct Experiment {
    device: SimulatedDevice,
    state: ControlState,
    plan: Plan,
    setpoint: Setpoint,
    tick: u64,
}

/// One tick of it.
pub struct Step {
    /// Time of `control::tick` alone.
    pub took: Duration,
    /// Time of one posture from the angles of the same tick, for comparison.
    pub posture: Duration,
    /// What the tick told.
    pub report: Report,
}

impl Experiment {
    /// A `cho-2005` at rest in its starting place.
    pub fn new(hand: HandProgram, scene: Box<[SceneItem]>, contacts: &[Contact]) -> Self {
        let definition = DeviceDefinition::load("cho-2005").expect("a built-in device");
        Self::of(&definition, hand, scene, contacts)
    }

    /// Any device, and the wall of its demo streamed to it.
    pub fn demo_of(name: &str) -> Self {
        let definition = DeviceDefinition::load(name).expect("a built-in device");
        let hand = HandProgram::default();
        let demo = definition.demo_wall(hand);
        let mut surface = plane(Vector3::new(demo.x_m, 0.0, 0.0), -Vector3::x(), 0.0);
        surface.material.stiffness_N_per_m = demo.stiffness_N_per_m;
        let contact = Contact { id: 1, revision: 1, surface };
        Self::of(&definition, hand, scene([]), &[contact])
    }

    fn of(
        definition: &DeviceDefinition,
        hand: HandProgram,
        scene: Box<[SceneItem]>,
        contacts: &[Contact],
    ) -> Self {
        let device = SimulatedDevice::new(definition.simulation(hand), 1).expect("a good start");
        let plan = Plan { scene, ..build_plan(definition, &Scene::default()) };
        let mut setpoint = Setpoint::NONE.with_contacts(contacts);
        setpoint.epoch = 1;
        setpoint.ttl_ns = definition.tick_ns;
        Self { device, state: ControlState::new(Mode::Enabled), plan, setpoint, tick: 0 }
    }

    /// The next tick; the device's part of it is not in the times.
    pub fn step(&mut self) -> Step {
        self.tick += 1;
        let now_ns = self.tick * self.plan.tick_ns;
        let sample = self.device.read(now_ns);
        self.setpoint.seq = self.tick;
        self.setpoint.state_tick = self.tick - 1;
        self.setpoint.received_ns = now_ns;
        let setpoint = &self.setpoint;
        let input = TickInput { sample, setpoint, plan: &self.plan, now_ns, overruns_in_row: 0 };
        let (took, decision) = timed(|| tick(&mut self.state, black_box(&input)));
        let shaft_rad = self.shaft_rad(&sample.unwrap_or_default());
        let mechanism = &self.plan.mechanism;
        let (posture, found) = timed(|| mechanism.posture_from_shafts(black_box(&shaft_rad)));
        assert!(found.is_ok(), "the experiment stays inside the workspace");
        self.device.write(&decision.commands).expect("a simulated device takes commands");
        Step { took, posture, report: decision.report }
    }

    fn shaft_rad(&self, sample: &Sample) -> ActuatorVector {
        let counts = self.plan.actuators.counts_per_revolution;
        ActuatorVector::from_fn(|i, _| sample.counts[i] as f64 * std::f64::consts::TAU / counts[i])
    }
}
