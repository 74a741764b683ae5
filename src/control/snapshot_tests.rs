//! A state that is copied or stored goes on as the one it was taken from, to the last bit.

use super::*;
use crate::config::{DeviceDefinition, Scene, build_plan};
use crate::control::{
    ControlCommand, ControlReply, Limit, Mode, Report, Sample, Setpoint, TickInput, Wrench, tick,
};
use crate::device::{Device, HandProgram, SimulatedDevice};
use crate::environment::{Contact, Element, Material, SceneItem, Shape, Surface};
use nalgebra::Vector3;

const MS: u64 = 1_000_000;

fn wall(x_m: f64, stiffness_N_per_m: f64) -> Surface {
    let material = Material { stiffness_N_per_m, ..Material::default() };
    Surface {
        shape: Shape::HalfSpace { point_W_m: Vector3::new(x_m, 0.0, 0.0), normal_W: -Vector3::x() },
        material: material.with_friction(0.3),
        hollow: false,
        blend_s: 0.0,
    }
}

/// The wall-following hand against a wall of the scene and one of a controller.
struct World {
    device: SimulatedDevice,
    plan: Box<Plan>,
    setpoint: Setpoint,
    now_ns: u64,
}

impl World {
    fn new() -> Self {
        let definition = DeviceDefinition::load("cho-2005").unwrap();
        let simulation = definition.simulation(HandProgram::default());
        let device = SimulatedDevice::new(simulation, 3).unwrap();
        let mut plan = Box::new(build_plan(&definition, &Scene::default()));
        let element = Element::Surface(wall(0.3, 1e7));
        plan.scene = [SceneItem { slot: 200, revision: 1, element }].into();
        let contact = Contact { id: 9, revision: 1, surface: wall(0.2995, 3e3) };
        let mut setpoint = Setpoint::NONE.with_contacts(&[contact]);
        (setpoint.epoch, setpoint.seq, setpoint.ttl_ns) = (1, 1, 1_000_000 * MS);
        Self { device, plan, setpoint, now_ns: 0 }
    }

    fn sample(&mut self) -> Sample {
        self.now_ns += MS;
        self.device.read(self.now_ns).unwrap()
    }

    fn tick(&self, state: &mut ControlState, sample: Sample) -> Report {
        let input = TickInput {
            sample: Ok(sample),
            setpoint: &self.setpoint,
            plan: &self.plan,
            now_ns: self.now_ns,
            overruns_in_row: 0,
        };
        tick(state, &input).report
    }

    fn step(&mut self, state: &mut ControlState) -> Report {
        let sample = self.sample();
        let report = self.tick(state, sample);
        self.device.write(&state.commands).unwrap();
        report
    }
}

fn bits(report: &Report) -> Vec<u8> {
    postcard::to_stdvec(report).unwrap()
}

fn copy_of(state: &mut ControlState, plan: &mut Box<Plan>) -> ControlState {
    let copy = Box::new(ControlState::new(Mode::Disabled));
    match state.apply(ControlCommand::Snapshot(copy), plan) {
        ControlReply::Snapshot(copy) => *copy,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_copy_and_what_was_stored_of_it_go_on_bit_by_bit() {
    let mut world = World::new();
    let mut state = ControlState::new(Mode::Enabled);
    let mut touched = 0;
    for _ in 0..4_000 {
        touched = world.step(&mut state).contact_count;
        if touched == 2 && world.now_ns > 2_500 * MS {
            break;
        }
    }
    assert_eq!(touched, 2, "both walls are touched, so there is something to remember");
    let copy = copy_of(&mut state, &mut world.plan);
    let stored = postcard::to_stdvec(&copy).unwrap();
    assert_eq!(stored, postcard::to_stdvec(&state).unwrap(), "the copy lacks nothing");
    assert!(stored.len() < 20_000, "{} bytes", stored.len());
    let restored: ControlState = postcard::from_bytes(&stored).unwrap();
    assert!(restored.is_sound());
    let (mut copy, mut restored) = (copy, restored);
    let mut moved = false;
    for _ in 0..1_000 {
        let sample = world.sample();
        let report = world.tick(&mut state, sample);
        world.device.write(&state.commands).unwrap();
        assert_eq!(bits(&report), bits(&world.tick(&mut copy, sample)), "tick {}", report.tick);
        assert_eq!(bits(&report), bits(&world.tick(&mut restored, sample)), "tick {}", report.tick);
        moved |= report.achievable.force_N.norm() > 1.0;
    }
    assert!(moved, "the law had something to do");
}

#[test]
fn a_state_that_lost_its_surfaces_goes_another_way() {
    let mut world = World::new();
    let mut state = ControlState::new(Mode::Enabled);
    // While the handle slides: at rest friction has nothing to remember.
    while world.step(&mut state).contact_count < 2 || world.now_ns < 2_500 * MS {}
    let mut copy = copy_of(&mut state, &mut world.plan);
    copy.scene = ControlState::new_surfaces();
    let differs = (0..200).any(|_| {
        let sample = world.sample();
        let report = world.tick(&mut state, sample);
        world.device.write(&state.commands).unwrap();
        bits(&report) != bits(&world.tick(&mut copy, sample))
    });
    assert!(differs, "surfaces are part of the state");
}

#[test]
fn a_state_that_lost_what_was_fed_goes_another_way() {
    let definition = DeviceDefinition::load("singh").unwrap();
    let simulation = definition.simulation(HandProgram::default());
    let mut world = World {
        device: SimulatedDevice::new(simulation, 3).unwrap(),
        plan: Box::new(build_plan(&definition, &Scene::default())),
        setpoint: Setpoint::NONE,
        now_ns: 0,
    };
    let mut state = ControlState::new(Mode::Enabled);
    let pushed = |world: &mut World, report: &Report| {
        // Along the motion, wherever it goes.
        let along = report.v_WT_m_per_s.try_normalize(1e-3).unwrap_or_else(Vector3::x);
        let wrench = Wrench { force_N: 5.0 * along, ..Wrench::default() };
        world.setpoint = Setpoint::NONE.with_wrench(wrench);
        (world.setpoint.epoch, world.setpoint.seq) = (1, 1);
        world.setpoint.ttl_ns = 1_000_000 * MS;
    };
    let mut report = Report::default();
    while !report.limits.contains(Limit::Passivity) {
        pushed(&mut world, &report);
        report = world.step(&mut state);
        assert!(report.tick < 5_000, "something is held back");
    }
    let (copy, mut lost) =
        (copy_of(&mut state, &mut world.plan), copy_of(&mut state, &mut world.plan));
    let stored = postcard::to_stdvec(&copy).unwrap();
    assert_eq!(stored, postcard::to_stdvec(&state).unwrap(), "the copy lacks nothing");
    let mut restored: ControlState = postcard::from_bytes(&stored).unwrap();
    lost.account = Default::default();
    let mut differs = false;
    for _ in 0..200 {
        pushed(&mut world, &report);
        let sample = world.sample();
        report = world.tick(&mut state, sample);
        world.device.write(&state.commands).unwrap();
        assert_eq!(bits(&report), bits(&world.tick(&mut restored, sample)));
        differs |= bits(&report) != bits(&world.tick(&mut lost, sample));
    }
    assert!(differs, "what was fed is part of the state");
}

#[test]
fn a_stored_state_that_no_tick_leaves_behind_is_not_sound() {
    let broken: [fn(&mut ControlState); 4] = [
        |state| state.touched.1 = MAX_TOUCHES + 1,
        |state| state.events.count = MAX_EVENTS + 1,
        |state| state.tick = u64::MAX,
        |state| state.events.last = u64::MAX,
    ];
    assert!(ControlState::new(Mode::Enabled).is_sound());
    for breaks in broken {
        let mut state = ControlState::new(Mode::Enabled);
        breaks(&mut state);
        assert!(!state.is_sound());
    }
}
