//! What a whole scene wants, and how little of it has to be looked at.

use nalgebra::UnitQuaternion;

use super::*;
use crate::environment::{Corridor, ForceField, MAX_OBJECTS, Material, Shape, ToolMotion};

fn tool_at(p_WT_m: Vector3<f64>, last: Option<&Tool>) -> Tool {
    let v_WT_m_per_s = Vector3::new(0.1, 0.2, 0.0);
    let motion = ToolMotion { p_WT_m, v_WT_m_per_s, ..ToolMotion::default() };
    let tool = Tool::new(&motion, &[], 0.0, 1e-3);
    last.map_or(tool, |last| tool.after(last))
}

/// Free at the origin, then at this place on x.
fn two_ticks(x_m: f64) -> [Tool; 2] {
    let before = tool_at(Vector3::zeros(), None);
    [before, tool_at(Vector3::new(x_m, 0.0, 0.0), Some(&before))]
}

fn wall(x_m: f64, stiffness_N_per_m: f64) -> Surface {
    Surface {
        shape: Shape::HalfSpace { point_W_m: Vector3::new(x_m, 0.0, 0.0), normal_W: -Vector3::x() },
        material: Material { stiffness_N_per_m, ..Material::default() },
        hollow: false,
        blend_s: 0.0,
    }
}

fn item(slot: usize, element: Element) -> SceneItem {
    SceneItem { slot: slot as u16, revision: 1, element }
}

#[test]
fn fields_add_up_once_whatever_the_tool_has_of_points() {
    let field = ForceField {
        origin_W_m: Vector3::zeros(),
        force_W_N: Vector3::zeros(),
        moment_W_Nm: Vector3::new(0.0, 0.0, 0.3),
        stiffness_N_per_m: nalgebra::Matrix3::identity() * 100.0,
        damping_Ns_per_m: nalgebra::Matrix3::zeros(),
        radius_m: f64::INFINITY,
    };
    let motion = ToolMotion {
        p_WT_m: Vector3::new(0.0, 0.0, 0.02),
        v_WT_m_per_s: Vector3::new(0.1, 0.2, 0.0),
        ..ToolMotion::default()
    };
    let tool = Tool::new(&motion, &[Vector3::x(), Vector3::y()], 0.0, 1e-3);
    let mut desired = Desired::default();
    for element in [
        Element::ConstantField { force_W_N: Vector3::new(1.0, 0.0, 0.0) },
        Element::ViscousField { damping_Ns_per_m: 10.0 },
        Element::ForceField(field),
    ] {
        for point in 0..2 {
            let mut state = SurfaceState::default();
            desired.add_item(&item(0, element.clone()), &mut state, &tool, point);
        }
    }
    assert!((desired.soft_W_N - Vector3::new(0.0, -2.0, -2.0)).norm() < 1e-12);
    assert_eq!(desired.soft_moment_W_Nm, Vector3::new(0.0, 0.0, 0.3));
    assert!(desired.constraints().is_empty());
}

#[test]
fn a_stiff_wall_is_kept_though_many_softer_ones_are_deeper() {
    let mut states = [SurfaceState::default(); 11];
    let mut desired = Desired::default();
    for tool in two_ticks(0.35) {
        desired = Desired::default();
        for (slot, state) in states.iter_mut().enumerate() {
            // The last is the shallowest and the stiffest.
            let stiffness = if slot == 10 { 1e6 } else { 10.0 + slot as f64 };
            let surface = wall(0.1 + 0.02 * slot as f64, stiffness);
            desired.add_item(&item(slot, Element::Surface(surface)), state, &tool, 0);
        }
    }
    assert_eq!((desired.constraints().len(), desired.left_out), (MAX_TOUCHES, 3));
    assert!(desired.constraints().iter().any(|kept| kept.id == 10));
    let weakest =
        desired.constraints().iter().map(|kept| kept.demand_N).fold(f64::INFINITY, f64::min);
    let of = |slot: usize| (10.0 + slot as f64) * (0.25 - 0.02 * slot as f64);
    let dropped = (0..10).filter(|slot| of(*slot) < weakest - 1e-12).count();
    assert_eq!(dropped, 3, "the strongest eight are kept");
}

#[test]
fn a_touch_carries_its_arm_its_point_and_the_velocity_there() {
    let motion = ToolMotion {
        p_WT_m: Vector3::new(0.2, 0.0, 0.0),
        omega_WT_rad_per_s: Vector3::new(0.0, 0.0, -2.0),
        ..ToolMotion::default()
    };
    let corners = [Vector3::new(-0.05, 0.04, 0.0), Vector3::new(0.05, 0.04, 0.0)];
    let mut states = [SurfaceState::default(); 2];
    let mut desired = Desired::default();
    let mut surface = wall(0.24, 100.0);
    surface.material.damping_Ns_per_m = 10.0;
    let before = Tool::new(&ToolMotion { p_WT_m: Vector3::zeros(), ..motion }, &corners, 0.0, 1e-3);
    for tool in [before, Tool::new(&motion, &corners, 0.0, 1e-3).after(&before)] {
        desired = Desired::default();
        for (point, state) in states.iter_mut().enumerate() {
            desired.add_item(&item(3, Element::Surface(surface)), state, &tool, point);
        }
    }
    let [constraint] = desired.constraints() else { panic!("one corner is inside") };
    assert_eq!((constraint.point, constraint.arm_W_m, constraint.id), (1, corners[1], 3));
    // 10 mm deep, and the corner comes on with 2 rad/s times 40 mm.
    assert!((constraint.demand_N - (1.0 + 0.8)).abs() < 1e-12, "{}", constraint.demand_N);
}

/// A block of small objects, every kind of body among them, 50 mm apart.
fn crowd() -> Vec<SceneItem> {
    let body = |i: usize| {
        let centre_W_m = Vector3::new((i % 16) as f64, (i / 16) as f64, 0.0) * 0.05;
        let shape = match i % 4 {
            0 => Shape::Sphere { centre_W_m, radius_m: 0.01 },
            1 => Shape::Box {
                centre_W_m,
                q_WS: UnitQuaternion::from_euler_angles(0.1, 0.2, i as f64),
                half_extents_m: Vector3::new(0.01, 0.008, 0.005),
            },
            2 => Shape::Capsule {
                ends_W_m: [centre_W_m, centre_W_m + Vector3::new(0.01, 0.0, 0.0)],
                radius_m: 0.005,
            },
            _ => {
                let points = [centre_W_m, centre_W_m + 0.01 * Vector3::x()].into();
                let material = Material::default();
                return Corridor::new(points, 1.5, material, 0.0).map(Element::Corridor);
            }
        };
        Some(Element::Surface(Surface { shape, ..wall(0.0, 1e4) }))
    };
    let full = 0..MAX_OBJECTS;
    full.map(|i| item(i, body(i).expect("two points make a corridor"))).collect()
}

#[test]
fn what_is_out_of_reach_is_not_looked_at() {
    let scene = crowd();
    let mut states = vec![SurfaceState::default(); MAX_OBJECTS];
    let mut tool: Option<Tool> = None;
    let (mut looked_at, mut most, mut touched, mut missed) = (0, 0, 0, 0);
    let ticks = 2000;
    for tick in 0..ticks {
        // 0.4 m/s through the crowd, in and out of it.
        let phase = f64::from(tick) * 1e-3;
        let p = Vector3::new(0.4 * phase, 0.37 + 0.05 * (9.0 * phase).sin(), 0.0);
        let now = tool_at(p, tool.as_ref());
        tool = Some(now);
        let mut desired = Desired::default();
        for item in &scene {
            desired.add_item(item, &mut states[usize::from(item.slot)], &now, 0);
        }
        // Against everything, by the shapes themselves.
        let inside = |item: &&SceneItem| match &item.element {
            Element::Surface(surface) => surface.shape.nearest(&p).distance_m < -1e-9,
            _ => false,
        };
        let felt = |item: &SceneItem| {
            desired.constraints().iter().any(|touch| touch.id == u32::from(item.slot))
        };
        missed += scene.iter().filter(inside).filter(|item| !felt(item)).count();
        touched += desired.constraints().len();
        if tick > 0 {
            looked_at += desired.looked_at;
            most = most.max(desired.looked_at);
        } else {
            assert_eq!(desired.looked_at, MAX_OBJECTS, "at first nothing is known");
        }
    }
    assert_eq!(missed, 0, "nothing that was entered is missed");
    assert!(touched > 100, "{touched}");
    let mean = f64::from(looked_at as u32) / f64::from(ticks);
    assert!(mean < 4.0 && most < 20, "{mean} in the mean, {most} at most, of {MAX_OBJECTS}");
}

#[test]
fn a_revised_object_is_looked_at_again() {
    let mut state = SurfaceState::default();
    let mut looked_at = |revision: u64, tool: &Tool| {
        let mut desired = Desired::default();
        let far = SceneItem { revision, ..item(0, Element::Surface(wall(0.3, 1e4))) };
        desired.add_item(&far, &mut state, tool, 0);
        desired.looked_at
    };
    let [tool, near] = two_ticks(0.31);
    assert_eq!([1, 1, 2, 2].map(|revision| looked_at(revision, &tool)), [1, 0, 1, 0]);
    assert_eq!(looked_at(2, &near), 1);
}
