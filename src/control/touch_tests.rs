//! Touch at the level of a tick: encoder counts in, contacts, wrenches and torques out.

use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};

use super::*;
use crate::actuation::ActuatorKind;
use crate::config::{DeviceDefinition, Scene, build_plan};
use crate::environment::{Element, Material, SceneItem, Shape, Surface, SurfaceState};
use crate::mechanism::{KinematicsError, Mechanism, Outline, Posture};
use crate::notation::{ActuatorVector, HandleInertia, MAX_ACTUATORS, PlaneVector, ReferenceMatrix};

fn stiff(shape: Shape) -> Element {
    let material = Material { stiffness_N_per_m: 1e4, ..Material::default() };
    Element::Surface(Surface { shape, material, hollow: false, blend_s: 0.0 })
}

fn scene(elements: impl IntoIterator<Item = Element>) -> Box<[SceneItem]> {
    let item = |(slot, element)| SceneItem { slot: slot as u16, revision: 1, element };
    elements.into_iter().enumerate().map(item).collect()
}

/// A device under its law, moved by a hand that nothing can stop.
struct Rig {
    plan: Plan,
    state: ControlState,
    now_ns: u64,
}

impl Rig {
    fn new(plan: Plan) -> Self {
        Self { plan, state: ControlState::new(Mode::Enabled), now_ns: 0 }
    }

    fn cho(elements: impl IntoIterator<Item = Element>) -> Self {
        let device = DeviceDefinition::load("cho-2005").expect("built in");
        Self::new(Plan { scene: scene(elements), ..build_plan(&device, &Scene::default()) })
    }

    /// One tick with the handle at this pose, as the encoders tell it.
    fn at(&mut self, p_BH: PlaneVector, hand_N: Option<PlaneVector>) -> Report {
        let posture = self.plan.mechanism.posture_at(&p_BH).expect("within reach");
        let per_rad = self.plan.actuators.counts_per_revolution / std::f64::consts::TAU;
        let mut sample = Sample { F_hand_BH_N: hand_N, ..Sample::default() };
        for i in 0..self.plan.mechanism.actuators() {
            sample.counts[i] = (posture.shaft_rad[i] * per_rad[i]).round() as i64;
        }
        self.now_ns += self.plan.tick_ns;
        let input = TickInput::uncommanded(Ok(sample), &self.plan, self.now_ns);
        tick(&mut self.state, &input).report
    }
}

/// A plate of 2 mm across x at 350 mm.
fn plate() -> Element {
    stiff(Shape::Box {
        centre_W_m: Vector3::new(0.35, 0.0, 0.0),
        q_WS: UnitQuaternion::identity(),
        half_extents_m: Vector3::new(0.001, 0.2, 0.2),
    })
}

#[test]
fn a_plate_of_two_millimetres_is_felt_until_the_tool_comes_back() {
    for (speed, way) in [(0.5, 1.0), (1.0, 1.0), (2.0, 1.0), (1.0, -1.0), (2.0, -1.0)] {
        let mut rig = Rig::cho([plate()]);
        let mut felt = 0;
        for tick in 0..400 {
            // There for 200 ticks and back again.
            let gone_m = speed * 1e-3 * f64::from(if tick < 200 { tick } else { 400 - tick });
            let gone_m = gone_m.min(0.08);
            let x_m = 0.35 + way * (gone_m - 0.04);
            let report = rig.at(PlaneVector::new(x_m, 0.01, 0.0), None);
            let depth_m = gone_m - 0.04 + 0.001;
            let found_m = report.contacts().first().map_or(0.0, |contact| contact.depth_m);
            // A count is 34 um at this radius.
            assert!((found_m - depth_m.max(0.0)).abs() < 1e-4, "{tick}: {found_m} {depth_m}");
            if depth_m > 1e-3 {
                assert!(report.requested.force_N.x * way < -5.0, "{:?}", report.requested);
                felt += 1;
            }
        }
        assert!(felt > 50, "{felt}");
    }
}

#[test]
fn what_a_disabled_device_went_through_is_not_felt_when_it_is_enabled() {
    let mut rig = Rig::cho([plate()]);
    rig.state = ControlState::new(Mode::Disabled);
    for x_mm in 300..400 {
        rig.at(PlaneVector::new(1e-3 * f64::from(x_mm), 0.0, 0.0), None);
    }
    rig.state.command(ModeCommand::Enable).expect("it was disabled");
    let report = rig.at(PlaneVector::new(0.4, 0.0, 0.0), None);
    assert_eq!((report.contact_count, report.requested), (0, Wrench::default()));
    let report = rig.at(PlaneVector::new(0.3505, 0.0, 0.0), None);
    assert!(report.requested.force_N.x > 4.0, "from its own side: {:?}", report.requested);
}

#[test]
fn friction_takes_its_load_from_the_hand_or_from_a_little() {
    let mut wall = plate();
    if let Element::Surface(surface) = &mut wall {
        surface.material = surface.material.with_friction(0.5);
    }
    for (press_N, load_N) in [(Some(4.0), 4.0f64), (None, 10.0)] {
        let mut rig = Rig::cho([wall.clone()]);
        let hand_N = press_N.map(|n| PlaneVector::new(n, 0.0, 0.0));
        rig.at(PlaneVector::new(0.34, 0.0, 0.0), hand_N);
        let mut report = Report::default();
        for tick in 0..40 {
            let y_m = 1e-4 * f64::from(tick);
            report = rig.at(PlaneVector::new(0.355, y_m, 0.0), hand_N);
            // 60 N is asked; the bristle bends at 5 N/mm.
            let most_N = (0.5 * load_N).min(5e3 * y_m + 0.5);
            assert!(report.contacts()[0].friction_N <= most_N + 1e-9, "{:?}", report.contacts());
            let bent_N = 5e3 * y_m - 0.5 * load_N;
            if tick > 1 && bent_N.abs() > 0.5 {
                assert_eq!(report.contacts()[0].sticking, bent_N < 0.0, "{tick}");
            }
        }
        assert!((report.contacts()[0].friction_N - 0.5 * load_N).abs() < 1e-9);
        assert!((report.requested.force_N.y + 0.5 * load_N).abs() < 1e-9, "against the drag");
        assert!((report.contacts()[0].normal_N - 60.0).abs() < 1.0);
    }
}

/// Motors that act on x, y and phi themselves.
#[derive(Debug)]
struct Gantry;

impl Mechanism for Gantry {
    fn name(&self) -> &'static str {
        "gantry"
    }
    fn freedoms(&self) -> usize {
        3
    }
    fn actuators(&self) -> usize {
        3
    }
    fn posture_at(&self, p_BH: &PlaneVector) -> Result<Posture, KinematicsError> {
        let mut shaft_rad = ActuatorVector::zeros();
        shaft_rad.fixed_rows_mut::<3>(0).copy_from(p_BH);
        Ok(Posture {
            p_BH: *p_BH,
            shaft_rad,
            reference: ReferenceMatrix::identity(),
            inertia: HandleInertia::identity(),
            closure_rad: ActuatorVector::zeros(),
            margin: 1.0,
        })
    }
    fn posture_from_shafts(&self, shaft_rad: &ActuatorVector) -> Result<Posture, KinematicsError> {
        self.posture_at(&shaft_rad.fixed_rows::<3>(0).into_owned())
    }
    fn outline(&self, _: &Posture, _: &mut Outline) -> usize {
        0
    }
    fn reach_m(&self) -> (f64, f64) {
        (0.0, 0.5)
    }
    fn inertia_varies(&self) -> bool {
        false
    }
}

const OFFSET_M: Vector3<f64> = Vector3::new(0.02, -0.01, 0.0);
const CORNERS_M: [[f64; 2]; 4] = [[0.03, 0.02], [-0.03, 0.02], [-0.03, -0.02], [0.03, -0.02]];

/// A box on a gantry whose plane is turned and moved in W.
fn box_rig(element: impl Fn(&Mount) -> Element) -> Rig {
    let device = DeviceDefinition::load("cho-2005").expect("built in");
    let mut plan = build_plan(&device, &Scene::default());
    plan.mechanism = Arc::new(Gantry);
    plan.actuators = Actuators {
        kinds: [ActuatorKind::Motor; MAX_ACTUATORS],
        max_torque_Nm: ActuatorVector::repeat(1e3),
        counts_per_revolution: ActuatorVector::repeat(1e8),
        lag_s: ActuatorVector::zeros(),
        resolution_Nm: ActuatorVector::zeros(),
        weight: ActuatorVector::repeat(1.0),
        hysteresis_Nm: ActuatorVector::zeros(),
        damping_N_m_s_per_rad: ActuatorVector::repeat(1e6),
    };
    plan.mount = Mount {
        p_WB_m: Vector3::new(0.1, 0.2, 0.3),
        q_WB: UnitQuaternion::from_euler_angles(0.3, -0.4, 0.5),
    };
    plan.tool.offset_B_m = OFFSET_M;
    for (point, [x, y]) in plan.tool.points_T_m.iter_mut().zip(CORNERS_M) {
        *point = Vector3::new(x, y, 0.0);
    }
    plan.tool.point_count = 4;
    plan.scene = scene([element(&plan.mount)]);
    Rig::new(plan)
}

/// What is beyond y = 0.1 m in the device's plane.
fn wall_above(mount: &Mount) -> Element {
    stiff(Shape::HalfSpace {
        point_W_m: mount.p_WB_m + mount.q_WB * Vector3::new(0.0, 0.1, 0.0),
        normal_W: mount.q_WB * -Vector3::y(),
    })
}

/// Place of a corner in B for this pose of the handle, by plane trigonometry.
fn corner_B_m(pose: &PlaneVector, [x, y]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = pose.z.sin_cos();
    let (x, y) = (OFFSET_M.x + x, OFFSET_M.y + y);
    [pose.x + cos * x - sin * y, pose.y + sin * x + cos * y]
}

#[test]
fn a_box_pushed_by_its_corner_yields_the_right_moment() {
    let mut rig = box_rig(wall_above);
    let mount = rig.plan.mount;
    for tick in 0..200 {
        let pose = PlaneVector::new(0.05, 0.05 + 1.4e-4 * f64::from(tick), 0.4);
        let report = rig.at(pose, None);
        // By hand: the wall pushes each corner beyond it down with k times its depth.
        let (mut force_N, mut about_T_Nm, mut about_H_Nm) = (0.0, 0.0, 0.0);
        let [t_x, _] = corner_B_m(&pose, [0.0, 0.0]);
        for corner in CORNERS_M {
            let [x, y] = corner_B_m(&pose, corner);
            let push_N = -1e4 * (y - 0.1).max(0.0);
            force_N += push_N;
            about_T_Nm += (x - t_x) * push_N;
            about_H_Nm += (x - pose.x) * push_N;
        }
        let requested_B = rig.plan.mount.q_WB.inverse() * report.requested.force_N;
        assert!((requested_B - Vector3::new(0.0, force_N, 0.0)).norm() < 0.01);
        let moment_B = mount.q_WB.inverse() * report.requested.moment_Nm;
        assert!((moment_B - Vector3::new(0.0, 0.0, about_T_Nm)).norm() < 1e-3);
        // Motors give it all: their torques are the wrench at H, the report's is about T.
        let given = report.commanded_Nm.fixed_rows::<3>(0).into_owned();
        assert!((given - PlaneVector::new(0.0, force_N, about_H_Nm)).norm() < 0.01, "{given}");
        assert!((report.achievable.moment_Nm - report.requested.moment_Nm).norm() < 1e-3);
        assert!(!report.limits.contains(Limit::Freedom));
        assert!(report.contact_count <= 1, "one surface, however many corners");
        if tick == 199 {
            assert!(force_N < -50.0 && about_T_Nm.abs() > 1.0, "{force_N} {about_T_Nm}");
        }
    }
}

#[test]
fn a_corner_that_turns_into_a_wall_is_felt_with_its_own_velocity() {
    let damped = |mount: &Mount| {
        let Element::Surface(mut surface) = wall_above(mount) else { panic!("it is a surface") };
        surface.material.damping_Ns_per_m = 50.0;
        Element::Surface(surface)
    };
    let mut rig = box_rig(damped);
    let mut last = Report::default();
    let rate = 0.5;
    let pose_at = |tick: i32| PlaneVector::new(0.05, 0.088, rate * 1e-3 * f64::from(tick));
    for tick in 0..=160 {
        last = rig.at(pose_at(tick), None);
    }
    let pose = pose_at(160);
    let push_N = CORNERS_M.map(|corner| {
        let [x, y] = corner_B_m(&pose, corner);
        if y > 0.1 { 1e4 * (y - 0.1) + 50.0 * rate * (x - pose.x) } else { 0.0 }
    });
    let force_B = rig.plan.mount.q_WB.inverse() * last.requested.force_N;
    let expected_N: f64 = push_N.iter().sum();
    assert!(expected_N > 1.0 && (force_B.y + expected_N).abs() < 0.02, "{force_B} {expected_N}");
}

#[test]
fn a_field_of_moments_needs_the_third_freedom() {
    let field = crate::environment::ForceField {
        origin_W_m: Vector3::zeros(),
        force_W_N: Vector3::zeros(),
        moment_W_Nm: Vector3::new(0.0, 0.0, 0.25),
        stiffness_N_per_m: nalgebra::Matrix3::zeros(),
        damping_Ns_per_m: nalgebra::Matrix3::zeros(),
        radius_m: f64::INFINITY,
    };
    let mut rig = box_rig(|_| Element::ForceField(field));
    rig.plan.mount = Mount::default();
    let mut report = Report::default();
    for _ in 0..20 {
        report = rig.at(PlaneVector::new(0.05, 0.05, 0.3), None);
    }
    assert!((report.commanded_Nm[2] - 0.25).abs() < 1e-9, "{}", report.commanded_Nm);
    assert!(!report.limits.contains(Limit::Freedom));
    let mut flat = Rig::cho([Element::ForceField(field)]);
    let report = flat.at(PlaneVector::new(0.35, 0.0, 0.0), None);
    assert_eq!(report.requested.moment_Nm.z, 0.25);
    assert!(report.limits.contains(Limit::Freedom), "it cannot turn the handle");
}

#[test]
fn a_slot_that_a_plan_leaves_out_has_no_past_and_the_others_keep_theirs() {
    let mut rig = box_rig(wall_above);
    let item = |slot| SceneItem { slot, ..rig.plan.scene[0].clone() };
    let (both, one) = ([item(70), item(255)].into(), [item(70)].into());
    rig.plan.scene = both;
    for y in [0.05, 0.08] {
        rig.at(PlaneVector::new(0.05, y, 0.4), None);
    }
    let before = rig.state.scene.clone();
    let new = SurfaceState::default();
    for point in 0..4 {
        assert!(before[point][70] != new && before[point][255] != new, "point {point}");
    }
    let next = Plan { scene: one, ..rig.plan.clone() };
    rig.state.apply(ControlCommand::SwapPlan(Box::new(next)), &mut Box::new(rig.plan.clone()));
    for (now, before) in rig.state.scene.iter().zip(&before) {
        assert!(now[70] == before[70] && now[255] == new);
    }
    rig.state.forget_surfaces();
    assert!(rig.state.scene.iter().flatten().all(|state| *state == new));
}
