//! Homing at the level of a tick: counts from anywhere, and what is lost with the device.

use nalgebra::Vector3;

use super::*;
use crate::config::{DeviceDefinition, Scene, build_plan};
use crate::environment::{Element, Material, SceneItem, Shape, Surface};
use crate::notation::PlaneVector;

const HOME_M: [f64; 2] = [0.3, 0.1];

struct Rig {
    plan: Box<Plan>,
    state: ControlState,
    setpoint: Setpoint,
    now_ns: u64,
}

impl Rig {
    fn new() -> Self {
        let device = DeviceDefinition::load("cho-2005").expect("built in");
        let mut plan = Box::new(build_plan(&device, &Scene::default()));
        let home = PlaneVector::new(HOME_M[0], HOME_M[1], 0.0);
        plan.home_rad = Some(plan.mechanism.posture_at(&home).expect("inside").shaft_rad);
        let state = ControlState::new(Mode::Disabled);
        Self { plan, state, setpoint: Setpoint::NONE, now_ns: 0 }
    }

    fn tick(&mut self, sample: Result<Sample, DeviceError>) -> Report {
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

    /// Encoders that were switched on with these counts.
    fn at(&mut self, x_m: f64, y_m: f64) -> Report {
        let mut sample = Sample::at(&self.plan, &PlaneVector::new(x_m, y_m, 0.0));
        for (count, offset) in sample.counts.iter_mut().zip([77_000, -123_456, 5, 900_000_000]) {
            *count += offset;
        }
        self.tick(Ok(sample))
    }

    fn ask(&mut self, command: ControlCommand) -> Result<(), String> {
        match self.state.apply(command, &mut self.plan) {
            ControlReply::Home(answer) => answer.map_err(|refusal| refusal.to_string()),
            ControlReply::Mode(answer) => answer.map(drop).map_err(|refusal| refusal.to_string()),
            ControlReply::Retired(_) | ControlReply::Snapshot(_) => Ok(()),
        }
    }
}

#[test]
fn the_counts_of_the_moment_become_those_of_the_home_place() {
    let mut rig = Rig::new();
    assert!(rig.ask(ControlCommand::Home).unwrap_err().contains("no sample"));
    for _ in 0..200 {
        let report = rig.at(0.35, -0.1);
        assert_eq!((report.mode, report.fault, report.homed), (Mode::Disabled, None, false));
        assert!(report.p_WT_m.iter().all(|part| part.is_finite()));
    }
    let enable = || ControlCommand::Mode(ModeCommand::Enable);
    assert!(rig.ask(enable()).unwrap_err().contains("home the device first"));
    rig.at(HOME_M[0], HOME_M[1]);
    rig.ask(ControlCommand::Home).expect("disabled, and sensed");
    for (x_m, y_m) in [(HOME_M[0], HOME_M[1]), (0.25, -0.15), (0.4, 0.2)] {
        let report = rig.at(x_m, y_m);
        assert!(report.homed);
        let off_m = (report.p_WT_m.x - x_m).hypot(report.p_WT_m.y - y_m);
        assert!(off_m < 2e-4, "{off_m} m: more than the counts that are lost in rounding");
    }
    rig.ask(enable()).expect("homed");
    assert!(rig.ask(ControlCommand::Home).unwrap_err().contains("disable the device first"));
}

#[test]
fn a_lost_sample_keeps_the_home_place_and_a_lost_device_does_not() {
    let mut rig = Rig::new();
    rig.at(HOME_M[0], HOME_M[1]);
    rig.ask(ControlCommand::Home).expect("disabled, and sensed");
    rig.tick(Err(DeviceError::Timeout));
    assert!(rig.at(0.3, 0.0).homed);
    rig.ask(ControlCommand::Mode(ModeCommand::Enable)).expect("homed");
    rig.tick(Err(DeviceError::Disconnected));
    let mut report = Report::default();
    for _ in 0..20 {
        report = rig.at(0.3, 0.0);
    }
    assert_eq!((report.mode, report.fault), (Mode::Fault, Some(Fault::Device)));
    rig.ask(ControlCommand::Mode(ModeCommand::ClearFault)).expect("the device answers");
    assert!(!rig.at(0.3, 0.0).homed);
    assert!(rig.ask(ControlCommand::Mode(ModeCommand::Enable)).is_err(), "not before Home");
    rig.at(HOME_M[0], HOME_M[1]);
    rig.ask(ControlCommand::Home).expect("again");
    rig.ask(ControlCommand::Mode(ModeCommand::Enable)).expect("homed");
}

#[test]
fn absolute_encoders_refuse_home() {
    let mut rig = Rig::new();
    rig.plan.home_rad = None;
    rig.tick(Ok(Sample::at(&rig.plan, &PlaneVector::new(0.3, 0.1, 0.0))));
    assert!(rig.ask(ControlCommand::Home).unwrap_err().contains("encoders are absolute"));
}

/// The side that the rig comes from: what is beyond x = 0.35 m towards the base is solid.
fn wall_towards_the_base() -> Box<[SceneItem]> {
    let shape =
        Shape::HalfSpace { point_W_m: Vector3::new(0.35, 0.0, 0.0), normal_W: Vector3::x() };
    let material = Material { stiffness_N_per_m: 1e4, ..Material::default() };
    let surface = Surface { shape, material, hollow: false, blend_s: 0.0 };
    [SceneItem { slot: 3, revision: 1, element: Element::Surface(surface) }].into()
}

#[test]
fn a_device_that_lost_its_place_touches_nothing_and_has_no_command_in_force() {
    let mut rig = Rig::new();
    rig.plan.scene = wall_towards_the_base();
    rig.at(HOME_M[0], HOME_M[1]);
    rig.ask(ControlCommand::Home).expect("disabled, and sensed");
    rig.setpoint = Setpoint::NONE.with_wrench(Wrench::default());
    (rig.setpoint.epoch, rig.setpoint.seq, rig.setpoint.ttl_ns) = (1, 5, u64::MAX);
    rig.at(0.36, 0.0);
    let report = rig.at(0.34, 0.0);
    assert_eq!((report.contact_count, report.command_seq), (1, 5));
    let report = rig.tick(Err(DeviceError::Timeout));
    assert_eq!((report.contact_count, report.command_seq), (1, 5), "one sample is no matter");
    let report = rig.tick(Err(DeviceError::Disconnected));
    assert_eq!((report.contact_count, report.command_seq), (0, 0));
    let ended = Event::ContactEnd { source: crate::environment::Source::Scene, id: 3 };
    assert!(report.events.contains(&Some(ended)), "{:?}", report.events);
    let report = rig.at(0.34, 0.0);
    assert_eq!((report.homed, report.contact_count, report.command_seq), (false, 0, 0));
}

#[test]
fn the_way_from_the_old_place_to_the_home_place_touches_nothing() {
    let mut rig = Rig::new();
    rig.plan.scene = wall_towards_the_base();
    rig.at(HOME_M[0], HOME_M[1]);
    rig.ask(ControlCommand::Home).expect("disabled, and sensed");
    // Outside of the wall; then this place is said to be the home place, which is inside.
    assert_eq!(rig.at(0.4, 0.0).contact_count, 0);
    rig.ask(ControlCommand::Home).expect("disabled, and sensed");
    let report = rig.at(0.4, 0.0);
    assert!((report.p_WT_m.x - HOME_M[0]).abs() < 2e-4);
    assert!(report.requested.force_N.norm() < 1e-3, "{}", report.requested.force_N);
}
