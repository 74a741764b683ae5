//! The tick: whatever is sensed and wanted, commands are finite, within limits, and brakes get
//! capacities.
//!
//! Samples go from a handle that is moved about to counts that no linkage has; setpoints and
//! scenes from the usual to numbers that are none, because a recording may hold those. The
//! binary of this target also aborts on an allocation in a tick.

use std::sync::OnceLock;

use assert_no_alloc::assert_no_alloc;
use hapticd::actuation::{ActuatorKind, Strategy};
use hapticd::config::{BUILT_IN, DeviceDefinition, Scene, build_plan};
use hapticd::control::{
    ActuatorCommand, ControlCommand, ControlState, Decision, DeviceError, Limit, Mode, ModeCommand,
    Plan, Report, Sample, Setpoint, TickInput, Wrench, tick,
};
use hapticd::environment::{
    Contact, Corridor, Element, ForceField, Guide, Material, SceneItem, Shape, Surface,
};
use hapticd::notation::PlaneVector;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use crate::script::Script;

/// The built-in devices, each with its plan.
pub fn devices() -> &'static [(DeviceDefinition, Plan)] {
    static DEVICES: OnceLock<Vec<(DeviceDefinition, Plan)>> = OnceLock::new();
    DEVICES.get_or_init(|| {
        let load = |(name, _): &(&str, &str)| {
            let device = DeviceDefinition::load(name).expect("built in");
            let plan = build_plan(&device, &Scene::default());
            (device, plan)
        };
        let mut devices: Vec<_> = BUILT_IN.iter().map(load).collect();
        devices.sort_by_key(|(device, _)| device.name.as_str() != "cho-2005");
        devices
    })
}

/// What the encoders show of a handle at this place, if it can be there.
pub fn sample_at(plan: &Plan, x_m: f64, y_m: f64) -> Option<Sample> {
    let posture = plan.mechanism.posture_at(&PlaneVector::new(x_m, y_m, 0.0)).ok()?;
    let mut sample = Sample::default();
    for i in 0..plan.mechanism.actuators() {
        let counts = posture.shaft_rad[i] * plan.actuators.counts_per_revolution[i];
        sample.counts[i] = (counts / std::f64::consts::TAU).floor() as i64;
    }
    Some(sample)
}

/// What must be true of every decision.
pub fn check_commands(plan: &Plan, decision: &Decision) {
    let Decision { commands, report } = decision;
    for (i, command) in commands.iter().enumerate() {
        let most_Nm = plan.actuators.max_torque_Nm[i];
        let value_Nm = command.value_Nm();
        assert!(value_Nm.is_finite() && value_Nm.abs() <= most_Nm, "{i}: {command:?}");
        assert_eq!(value_Nm.to_bits(), report.commanded_Nm[i].to_bits(), "the report says so");
        match (plan.actuators.kinds[i], command) {
            (ActuatorKind::Brake, ActuatorCommand::Brake { capacity_Nm }) => {
                assert!(*capacity_Nm >= 0.0, "a brake never pushes: {capacity_Nm}");
            }
            (ActuatorKind::Motor, ActuatorCommand::Motor { .. }) => {}
            (kind, _) => panic!("actuator {i} is a {kind:?} and got {command:?}"),
        }
        let still = matches!(report.mode, Mode::Disabled | Mode::Fault);
        assert!(!still || value_Nm == 0.0, "{:?} commands nothing: {command:?}", report.mode);
    }
    assert_eq!(report.fault.is_some(), report.mode == Mode::Fault);
    let moves = plan.actuators.kinds[..plan.mechanism.actuators()].contains(&ActuatorKind::Motor);
    assert!(moves || !report.limits.contains(Limit::Passivity), "brakes feed nothing");
}

/// What must be true of a report where nothing but checked numbers went in.
pub fn check_report(report: &Report) {
    let Report { requested, achievable, rendered, hand, .. } = report;
    let wrenches = [*requested, *achievable, *rendered, hand.unwrap_or_default()];
    for Wrench { force_N, moment_Nm } in wrenches {
        assert!(force_N.iter().chain(&moment_Nm).all(|part| part.is_finite()), "{report:?}");
    }
    let places = [report.p_WT_m, report.proxy_W_m, report.v_WT_m_per_s, report.omega_WT_rad_per_s];
    assert!(places.iter().flatten().all(|part| part.is_finite()), "{report:?}");
    assert!(report.q_WT.coords.iter().all(|part| part.is_finite()), "{report:?}");
    let scalars = [report.approximation_angle_rad, report.force_error_N];
    assert!(scalars.into_iter().flatten().all(|part| part.is_finite() && part >= 0.0));
    assert!(report.approximation_angle_rad.is_none_or(|angle_rad| angle_rad < 3.15));
    for contact in report.contacts() {
        assert!(contact.depth_m.is_finite() && contact.depth_m >= 0.0, "{contact:?}");
        assert!(contact.normal_N.is_finite() && contact.normal_N >= 0.0, "{contact:?}");
        assert!(contact.friction_N.is_finite() && contact.friction_N >= 0.0, "{contact:?}");
    }
}

/// A script of ticks.
pub fn check(data: &[u8]) {
    let script = &mut Script::new(data);
    let (device, plan) = &devices()[script.below(devices().len())];
    let mut plan = Box::new(plan.clone());
    plan.strategy = script.one_of(&Strategy::ALL);
    // Without wild numbers the report is checked as well.
    let wild = script.rarely(2);
    if script.rarely(2) {
        plan.scene = scene(script, wild);
    }
    if script.rarely(4) {
        plan.home_rad = None;
    }
    let mut state = ControlState::new(Mode::Disabled);
    let (mut setpoint, mut now_ns) = (Setpoint::NONE, u64::from(script.u32()));
    let mut place_m = device.start_m;
    let mut sample = sample_at(&plan, place_m[0], place_m[1]).expect("the start was checked");
    command(&mut state, &mut plan, ControlCommand::Home);
    command(&mut state, &mut plan, ControlCommand::Mode(ModeCommand::Enable));
    let mut ticks = 0;
    while !script.is_over() && ticks < 400 {
        ticks += 1;
        let mut lost = None;
        match script.below(16) {
            0..=3 => {} // the handle stands still
            4..=8 => {
                let step_m = [script.inside(-2e-3, 2e-3), script.inside(-2e-3, 2e-3)];
                let there = [place_m[0] + step_m[0], place_m[1] + step_m[1]];
                if let Some(moved) = sample_at(&plan, there[0], there[1]) {
                    sample.counts = moved.counts;
                    place_m = there;
                }
            }
            9 => {
                let shaft = script.below(sample.counts.len());
                let step = if script.rarely(4) {
                    script.u64() as i64
                } else {
                    i64::from(script.u8()) - 128
                };
                sample.counts[shaft] = sample.counts[shaft].wrapping_add(step);
            }
            10 => {
                let mut part =
                    || if wild { script.number(-50.0, 50.0) } else { script.inside(-50.0, 50.0) };
                sample.F_hand_BH_N = Some(PlaneVector::new(part(), part(), part() * 0.1));
            }
            11 => {
                sample.F_hand_BH_N = sample.F_hand_BH_N.filter(|_| script.rarely(2));
                sample.buttons = script.u32();
            }
            12 => lost = Some(script.one_of(&DeviceError::ALL)),
            13 | 14 => setpoint = next_setpoint(script, &setpoint, now_ns, wild),
            _ => edge(script, &mut state, &mut plan, wild),
        }
        now_ns = now_ns.saturating_add(if script.rarely(20) {
            script.u64() >> script.below(64)
        } else {
            plan.tick_ns
        });
        let overruns_in_row = if script.rarely(100) { script.u32() } else { 0 };
        let input = TickInput {
            sample: lost.map_or(Ok(sample), Err),
            setpoint: &setpoint,
            plan: &plan,
            now_ns,
            overruns_in_row,
        };
        let decision = assert_no_alloc(|| tick(&mut state, &input));
        check_commands(&plan, &decision);
        assert_eq!(decision.report.time_ns, now_ns);
        if !wild {
            check_report(&decision.report);
        }
    }
}

/// Something at a tick's edge.
fn edge(script: &mut Script<'_>, state: &mut ControlState, plan: &mut Box<Plan>, wild: bool) {
    use ModeCommand::{ClearFault, Disable, Enable, Stop};
    match script.below(8) {
        0 => command(state, plan, ControlCommand::Home),
        1 => {
            let mut next = plan.clone();
            next.generation += 1;
            next.scene = scene(script, wild);
            command(state, plan, ControlCommand::SwapPlan(next));
        }
        2 => {
            let mut next = plan.clone();
            next.generation += 1;
            next.strategy = script.one_of(&Strategy::ALL);
            next.guards.force_gain = script.inside(0.0, 1.0);
            next.guards.passivity_reserve_J = script.inside(0.001, 0.5);
            next.guards.passivity_power_W = script.inside(0.0, 0.5);
            next.tool.radius_m = script.inside(0.0, 0.1);
            command(state, plan, ControlCommand::SwapPlan(next));
        }
        3..=5 => {
            command(state, plan, ControlCommand::Mode(ClearFault));
            command(state, plan, ControlCommand::Mode(Enable));
        }
        _ => command(state, plan, ControlCommand::Mode(script.one_of(&[Disable, Stop, Enable]))),
    }
}

fn command(state: &mut ControlState, plan: &mut Box<Plan>, command: ControlCommand) {
    let reply = assert_no_alloc(|| state.apply(command, plan));
    drop(reply); // a retired plan is freed here, by who asked
}

fn next_setpoint(script: &mut Script<'_>, last: &Setpoint, now_ns: u64, wild: bool) -> Setpoint {
    let mut next = match script.below(4) {
        0 => *last,
        1 => Setpoint::NONE.with_wrench(Wrench {
            force_N: vector(script, 20.0, wild),
            moment_Nm: vector(script, 2.0, wild),
        }),
        2 => Setpoint::NONE.with_field(field(script, wild)),
        _ => {
            let contacts: Vec<_> = (0..script.below(9))
                .map(|id| {
                    let revision = u32::from(script.u8() % 4);
                    Contact { id: id as u32, revision, surface: surface(script, wild) }
                })
                .collect();
            Setpoint::NONE.with_contacts(&contacts)
        }
    };
    next.released = script.rarely(8);
    next.clutched = script.rarely(20);
    next.epoch = last.epoch + u64::from(script.rarely(20));
    (next.seq, next.number) = (last.seq + 1, last.number + 1);
    next.state_tick = if script.rarely(8) { script.u64() } else { 0 };
    next.received_ns = if script.rarely(20) { script.u64() } else { now_ns };
    next.ttl_ns = u64::from(script.u8()) * 1_000_000;
    next
}

fn value(script: &mut Script<'_>, min: f64, max: f64, wild: bool) -> f64 {
    if wild { script.number(min, max) } else { script.inside(min, max) }
}

fn vector(script: &mut Script<'_>, most: f64, wild: bool) -> Vector3<f64> {
    Vector3::from_fn(|_, _| value(script, -most, most, wild))
}

/// Within reach of every device, near its plane.
fn place(script: &mut Script<'_>, wild: bool) -> Vector3<f64> {
    let place = vector(script, 0.4, wild);
    Vector3::new(place.x, place.y, 0.01 * place.z)
}

fn unit(script: &mut Script<'_>, wild: bool) -> Vector3<f64> {
    let unit = vector(script, 1.0, wild);
    let in_plane = if script.rarely(3) { unit } else { Vector3::new(unit.x, unit.y, 0.0) };
    if wild { in_plane } else { in_plane.try_normalize(1e-6).unwrap_or(-Vector3::x()) }
}

fn material(script: &mut Script<'_>, wild: bool) -> Material {
    let kinetic_friction = value(script, 0.0, 2.0, wild);
    let most = script.one_of(&[1e3, 1e5, 1e7, 1e9]);
    Material {
        stiffness_N_per_m: value(script, 0.0, most, wild),
        damping_Ns_per_m: value(script, 0.0, 1e3, wild),
        kinetic_friction,
        static_friction: kinetic_friction + value(script, 0.0, 1.0, wild),
        surface_velocity_W_m_per_s: if script.rarely(4) {
            vector(script, 0.5, wild)
        } else {
            Vector3::zeros()
        },
    }
}

fn field(script: &mut Script<'_>, wild: bool) -> ForceField {
    ForceField {
        origin_W_m: place(script, wild),
        force_W_N: vector(script, 20.0, wild),
        moment_W_Nm: vector(script, 2.0, wild),
        stiffness_N_per_m: Matrix3::from_fn(|_, _| value(script, -1e3, 1e3, wild)),
        damping_Ns_per_m: Matrix3::from_fn(|_, _| value(script, -50.0, 50.0, wild)),
        radius_m: if script.rarely(2) { f64::INFINITY } else { value(script, 1e-3, 0.5, wild) },
    }
}

fn surface(script: &mut Script<'_>, wild: bool) -> Surface {
    let radius_m = value(script, 1e-4, 0.3, wild);
    let shape = match script.below(9) {
        0..=2 => Shape::HalfSpace { point_W_m: place(script, wild), normal_W: unit(script, wild) },
        3 => Shape::Sphere { centre_W_m: place(script, wild), radius_m },
        4 => Shape::Box {
            centre_W_m: place(script, wild),
            q_WS: turned(script),
            half_extents_m: Vector3::from_fn(|_, _| value(script, 1e-4, 0.3, wild)),
        },
        5 => Shape::Capsule { ends_W_m: [place(script, wild), place(script, wild)], radius_m },
        6 => Shape::Guide { path: Guide::Point { point_W_m: place(script, wild) }, radius_m },
        7 => {
            let path =
                Guide::Line { point_W_m: place(script, wild), direction_W: unit(script, wild) };
            Shape::Guide { path, radius_m: if script.rarely(2) { 0.0 } else { radius_m } }
        }
        _ => {
            let path =
                Guide::Plane { point_W_m: place(script, wild), normal_W: unit(script, wild) };
            Shape::Guide { path, radius_m: if script.rarely(2) { 0.0 } else { radius_m } }
        }
    };
    let hollow = script.rarely(4) && !matches!(shape, Shape::Guide { .. });
    let blend_s = if script.rarely(4) { value(script, 0.0, 1.0, wild) } else { 0.0 };
    Surface { shape, material: material(script, wild), hollow, blend_s }
}

fn turned(script: &mut Script<'_>) -> UnitQuaternion<f64> {
    let mut part = || script.inside(-1.0, 1.0);
    let raw = Quaternion::new(part(), part(), part(), part());
    UnitQuaternion::try_new(raw, 1e-3).unwrap_or_default()
}

fn scene(script: &mut Script<'_>, wild: bool) -> Box<[SceneItem]> {
    let count = if script.rarely(10) { script.below(256) } else { script.below(6) };
    (0..count as u16)
        .map(|slot| {
            let element = match script.below(8) {
                0..=3 => Element::Surface(surface(script, wild)),
                4 => corridor(script, wild),
                5 => Element::ConstantField { force_W_N: vector(script, 20.0, wild) },
                6 => Element::ViscousField { damping_Ns_per_m: value(script, 0.0, 100.0, wild) },
                _ => Element::ForceField(field(script, wild)),
            };
            SceneItem { slot, revision: u64::from(script.u8() % 4), element }
        })
        .collect()
}

fn corridor(script: &mut Script<'_>, wild: bool) -> Element {
    let points: Box<[_]> = (0..2 + script.below(63)).map(|_| place(script, wild)).collect();
    let radius_m = if script.rarely(2) { 0.0 } else { value(script, 0.0, 0.1, wild) };
    let corridor = Corridor::new(points, radius_m, material(script, wild), 0.0);
    Element::Corridor(corridor.expect("2 to 64 points"))
}
