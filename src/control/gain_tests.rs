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
        plan.actuators.damping_N_m_s_per_rad.fill(100.0);
        plan.scene = [SceneItem { slot: 0, revision: 1, element }].into();
        let state = ControlState::new(Mode::Enabled);
        Self { plan, state, now_ns: 0, setpoint: Setpoint::NONE }
    }

    fn tick_at(&mut self, x_m: f64) -> Report {
        self.tick_with(Ok(Sample::at(&self.plan, &PlaneVector::new(x_m, 0.05, 0.0))))
    }

    fn tick_with(&mut self, sample: Result<Sample, DeviceError>) -> Report {
        self.now_ns += self.plan.tick_ns;
        let input = TickInput {
            sample,
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

/// A wall that is pressed, under these settings, and what is given against it.
fn pressed(change: impl Fn(&mut Guards)) -> (Rig, f64) {
    let mut rig = Rig::new(wall());
    change(&mut rig.plan.guards);
    rig.tick_at(0.298);
    let given_N = rig.ticks(50).achievable.force_N.norm();
    (rig, given_N)
}

/// Ticks until all of it is given, and no tick that steps: neither up nor down.
fn grows_from(rig: &mut Rig, mut last_N: f64, until_tick: usize) {
    let whole_N = 1.05 * FIELD_N;
    for tick in 0..=until_tick {
        let report = rig.ticks(1);
        let given_N = report.achievable.force_N.norm();
        let change_N = given_N - last_N;
        assert!((-1e-6..1.5 * whole_N / 200.0).contains(&change_N), "{tick}: {last_N} {given_N}");
        assert_eq!(report.limits.contains(Limit::Activation), tick < until_tick, "{tick}");
        last_N = given_N;
    }
    assert!((last_N / FIELD_N - 1.0).abs() < 0.05, "{last_N} N in the end");
}

#[test]
fn a_gain_or_a_limit_that_is_raised_against_a_pressed_wall_grows_along_the_ramp() {
    let (mut rig, given_N) = pressed(|guards| guards.force_gain = 0.0);
    assert_eq!(given_N, 0.0);
    rig.plan.guards.force_gain = 1.0;
    grows_from(&mut rig, given_N, 200);
    let (mut rig, given_N) = pressed(|guards| guards.force_limit_N = 5.0);
    assert!((given_N - 5.0).abs() < 1e-6, "{given_N}");
    rig.plan.guards.force_limit_N = 1000.0;
    let to_go = 1.0 - given_N / rig.state.last.requested.force_N.norm();
    grows_from(&mut rig, given_N, (to_go * 200.0).ceil() as usize);
    rig.plan.guards.force_gain = 0.5;
    let given_N = rig.ticks(1).achievable.force_N.norm();
    assert!((given_N / FIELD_N - 0.5).abs() < 0.05, "letting go is at once: {given_N} N");
}

#[test]
fn a_ramp_that_is_set_to_nothing_during_a_growth_does_not_end_it() {
    let (mut rig, _) = pressed(|guards| guards.activation_ramp_ns = 10_000_000_000);
    rig.state.command(ModeCommand::Disable).expect("enabled");
    rig.tick_at(0.298);
    rig.state.command(ModeCommand::Enable).expect("disabled");
    rig.tick_at(0.298);
    let mut last_N = rig.ticks(500).achievable.force_N.norm();
    assert!((last_N / FIELD_N - 0.05).abs() < 0.01, "{last_N} N at 5 %");
    rig.plan.guards.activation_ramp_ns = 0;
    for step in 0..100 {
        // A raise in the middle of it is no way around it either.
        rig.plan.guards.force_limit_N = if step < 50 { 1000.0 } else { 2000.0 };
        let given_N = rig.ticks(1).achievable.force_N.norm();
        assert!((given_N - last_N).abs() < 0.01, "{last_N} to {given_N} N, step {step}");
        last_N = given_N;
    }
}

#[test]
fn what_is_inside_a_wall_is_given_away_even_when_the_first_tick_after_enable_senses_nothing() {
    for lost in [0, 1, 3] {
        let mut rig = Rig::new(wall());
        rig.plan.guards.activation_ramp_ns = 0;
        rig.state = ControlState::new(Mode::Disabled);
        rig.tick_at(0.298);
        assert_eq!(rig.ticks(20).contact_count, 1, "it is tracked while disabled");
        rig.state.command(ModeCommand::Enable).expect("disabled");
        for _ in 0..lost {
            rig.tick_with(Err(DeviceError::Timeout));
        }
        let report = rig.ticks(1);
        assert_eq!(report.mode, Mode::Enabled);
        assert!(report.achievable.force_N.norm() < 1e-3, "{lost}: {}", report.achievable.force_N);
        let deeper_N = rig.tick_at(0.301).achievable.force_N.norm();
        assert!(deeper_N > 0.5 * FIELD_N, "and deeper it is there: {deeper_N} N");
    }
}
