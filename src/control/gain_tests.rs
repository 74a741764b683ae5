//! How much of what is asked is given: the gain, and the growth after Enable.

use nalgebra::Vector3;

use super::*;
use crate::actuation::ActuatorKind;
use crate::config::{DeviceDefinition, Scene, build_plan};
use crate::environment::{Element, Material, SceneItem, Shape, Surface};
use crate::notation::{MAX_ACTUATORS, PlaneVector};

/// A device of motors, which give what is asked, held at one place by nobody in particular.
struct Rig {
    plan: Plan,
    state: ControlState,
    now_ns: u64,
    setpoint: Setpoint,
}

impl Rig {
    fn new(element: Element) -> Self {
        let device = DeviceDefinition::load("cho-2005").expect("built in");
        let mut plan = build_plan(&device, &Scene::default());
        plan.actuators.kinds = [ActuatorKind::Motor; MAX_ACTUATORS];
        plan.scene = [SceneItem { slot: 0, revision: 1, element }].into();
        let state = ControlState::new(Mode::Enabled);
        Self { plan, state, now_ns: 0, setpoint: Setpoint::NONE }
    }

    fn tick_at(&mut self, x_m: f64) -> Report {
        self.now_ns += self.plan.tick_ns;
        let input = TickInput {
            sample: Ok(Sample::at(&self.plan, &PlaneVector::new(x_m, 0.05, 0.0))),
            setpoint: &self.setpoint,
            plan: &self.plan,
            now_ns: self.now_ns,
            overruns_in_row: 0,
        };
        tick(&mut self.state, &input).report
    }

    /// The last of so many ticks.
    fn ticks(&mut self, count: usize) -> Report {
        (0..count).map(|_| self.tick_at(0.3)).last().expect("some")
    }
}

const FIELD_N: f64 = 10.0;

fn field() -> Element {
    Element::ConstantField { force_W_N: Vector3::new(FIELD_N, 0.0, 0.0) }
}

/// Entered by 1 mm where the rig stands.
fn wall() -> Element {
    let shape =
        Shape::HalfSpace { point_W_m: Vector3::new(0.299, 0.0, 0.0), normal_W: -Vector3::x() };
    let material = Material { stiffness_N_per_m: 1e4, ..Material::default() };
    Element::Surface(Surface { shape, material, hollow: false, blend_s: 0.0 })
}

#[test]
fn a_gain_scales_fields_walls_and_commands_and_leaves_the_request_as_it_was() {
    for gain in [0.0, 0.25, 1.0] {
        for element in [field(), wall()] {
            let mut rig = Rig::new(element);
            rig.plan.guards.force_gain = gain;
            rig.tick_at(0.298); // the wall is entered from outside
            let report = rig.ticks(50);
            let (asked, given) = (report.requested.force_N, report.achievable.force_N);
            assert!((asked.norm() / FIELD_N - 1.0).abs() < 0.05, "{asked}");
            assert!((given - asked * gain).norm() < 1e-6, "{given} of {asked} at {gain}");
        }
        let mut rig = Rig::new(Element::ViscousField { damping_Ns_per_m: 0.0 });
        rig.plan.guards.force_gain = gain;
        let force_N = Vector3::new(0.0, 6.0, 0.0);
        rig.setpoint = Setpoint::NONE.with_wrench(Wrench { force_N, ..Wrench::default() });
        (rig.setpoint.epoch, rig.setpoint.seq, rig.setpoint.ttl_ns) = (1, 1, u64::MAX);
        let report = rig.ticks(50);
        assert_eq!(report.requested.force_N, force_N);
        assert!((report.achievable.force_N - force_N * gain).norm() < 1e-6, "{report:?}");
    }
}

#[test]
fn a_gain_acts_before_anything_is_clipped() {
    let mut rig = Rig::new(field());
    rig.plan.guards.force_limit_N = 4.0;
    for (gain, given_N, clipped) in [(1.0, 4.0, true), (0.5, 4.0, true), (0.3, 3.0, false)] {
        rig.plan.guards.force_gain = gain;
        let report = rig.ticks(50);
        assert!((report.achievable.force_N.x - given_N).abs() < 1e-6, "{report:?}");
        assert_eq!(report.limits.contains(Limit::Force), clipped, "{gain}");
    }
}

#[test]
fn after_enable_the_force_grows_from_nothing_and_letting_go_is_at_once() {
    let mut rig = Rig::new(field());
    assert!(!rig.ticks(20).limits.contains(Limit::Activation), "opened enabled");
    for _ in 0..2 {
        rig.state.command(ModeCommand::Disable).expect("enabled");
        assert_eq!(rig.ticks(1).achievable, Wrench::default());
        rig.state.command(ModeCommand::Enable).expect("disabled");
        for tick in 0..250 {
            let report = rig.ticks(1);
            let share = (f64::from(tick) / 200.0).min(1.0);
            let given_N = report.achievable.force_N.x;
            assert!((given_N - share * FIELD_N).abs() < 1e-6, "{tick}: {given_N}");
            assert_eq!(report.limits.contains(Limit::Activation), share < 1.0);
            assert_eq!(report.requested.force_N.x, FIELD_N);
        }
    }
}

#[test]
fn a_command_that_runs_out_while_the_force_grows_fades_from_what_was_given() {
    let mut rig = Rig::new(Element::ViscousField { damping_Ns_per_m: 0.0 });
    let force_N = Vector3::new(0.0, 8.0, 0.0);
    rig.setpoint = Setpoint::NONE.with_wrench(Wrench { force_N, ..Wrench::default() });
    (rig.setpoint.epoch, rig.setpoint.seq) = (1, 1);
    rig.setpoint.ttl_ns = 120_000_000;
    rig.state = ControlState::new(Mode::Disabled);
    rig.state.command(ModeCommand::Enable).expect("disabled");
    let (mut last_N, mut most_N) = (0.0, 0.0f64);
    for _ in 0..250 {
        let given_N = rig.ticks(1).achievable.force_N.y;
        assert!((given_N - last_N).abs() < 0.15, "a step from {last_N} to {given_N} N");
        (last_N, most_N) = (given_N, most_N.max(given_N));
    }
    assert!(most_N > 4.0 && most_N < 5.5 && last_N == 0.0, "{most_N} {last_N}");
}
