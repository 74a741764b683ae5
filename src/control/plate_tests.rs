//! The box of `kim-2003` pushed by its corner: tick, plant and hand together, in virtual time.

use nalgebra::Vector3;

use super::*;
use crate::config::{DeviceDefinition, Scene, build_plan};
use crate::device::{Device, HandProgram, SimulatedDevice, SlideProgram};
use crate::environment::{Element, Material, SceneItem, Shape, Surface};
use crate::notation::{ActuatorVector, PlaneVector};

/// What a wall leaning by this much touches first is one corner alone.
const LEAN_RAD: f64 = 0.3;

struct Touch {
    wall_m: Vector3<f64>,
    normal: Vector3<f64>,
    stiffness_N_per_m: f64,
}

impl Touch {
    /// Wrench at H of the wall's pushes on the corners of a box at this pose, by plane
    /// trigonometry, and how many corners are pushed.
    fn wrench(&self, pose: &PlaneVector, corners_m: &[Vector3<f64>]) -> (PlaneVector, usize) {
        let (sin, cos) = pose.z.sin_cos();
        let (mut wrench, mut pushed) = (PlaneVector::zeros(), 0);
        for corner in corners_m {
            let arm = [cos * corner.x - sin * corner.y, sin * corner.x + cos * corner.y];
            let beyond_m = (self.wall_m.x - pose.x - arm[0]) * self.normal.x
                + (self.wall_m.y - pose.y - arm[1]) * self.normal.y;
            if beyond_m > 0.0 {
                let push_N = self.stiffness_N_per_m * beyond_m;
                let force_N = [push_N * self.normal.x, push_N * self.normal.y];
                let moment_Nm = arm[0] * force_N[1] - arm[1] * force_N[0];
                wrench += PlaneVector::new(force_N[0], force_N[1], moment_Nm);
                pushed += 1;
            }
        }
        (wrench, pushed)
    }
}

#[test]
fn a_box_pushed_by_its_corner_is_felt_as_a_moment_and_turns() {
    for side in [1.0, -1.0] {
        let device = DeviceDefinition::load("kim-2003").expect("built in");
        // Lightly, so that a wall as soft as this is entered by a few millimetres.
        let hand = HandProgram::PressAndSlide(SlideProgram { press_N: 3.0, ..Default::default() });
        let wall = device.demo_wall(hand);
        // Two corners that touch together are twice as stiff as one.
        let stiffness_N_per_m = 0.5 * wall.stiffness_N_per_m;
        let lean_rad = side * LEAN_RAD;
        let touch = Touch {
            // Through the corner that it will meet, where the hand slides along.
            wall_m: Vector3::new(wall.x_m, device.start_m[1] + side * 0.01, 0.0),
            normal: Vector3::new(-lean_rad.cos(), -lean_rad.sin(), 0.0),
            stiffness_N_per_m,
        };
        let material = Material { stiffness_N_per_m, ..Material::default() };
        let shape = Shape::HalfSpace { point_W_m: touch.wall_m, normal_W: touch.normal };
        let surface = Surface { shape, material, hollow: false, blend_s: 0.0 };
        let item = SceneItem { slot: 0, revision: 1, element: Element::Surface(surface) };
        let plan = Plan { scene: [item].into(), ..build_plan(&device, &Scene::default()) };
        let mut simulated = SimulatedDevice::new(device.simulation(hand), 1).expect("regular");
        let mut state = ControlState::new(Mode::Enabled);
        let (mut by_one_corner, mut most_Nm, mut most_rad) = (0, 0.0_f64, 0.0_f64);
        let mut last_Nm = ActuatorVector::zeros();
        for number in 0..900_u64 {
            let now_ns = 1_000_000 * (number + 1);
            let input = TickInput::uncommanded(simulated.read(now_ns), &plan, now_ns);
            let Decision { commands, report } = tick(&mut state, &input);
            simulated.write(&commands).expect("a simulated device takes anything");
            assert_eq!((report.fault, report.mode), (None, Mode::Enabled), "tick {number}");
            // The force grows in the first 200 ms after enabling.
            let (expected, pushed) = touch.wrench(&report.p_BH, plan.tool.points_T_m());
            if number < 250 || pushed == 0 {
                continue;
            }
            let posture = plan.mechanism.posture_at(&report.p_BH).expect("regular");
            let given = posture.reference * report.commanded_Nm;
            // The motors have steps, of which half a coarse one is 2.5 mN m; they follow one
            // another closely.
            assert!((given - expected).xy().norm() < 0.02, "tick {number}: {given} {expected}");
            assert!((given.z - expected.z).abs() < 1.5e-3, "tick {number}: {given} {expected}");
            let changed_Nm = (report.commanded_Nm - last_Nm).amax();
            assert!(changed_Nm < 0.1, "tick {number}: {changed_Nm} N m");
            last_Nm = report.commanded_Nm;
            assert!((report.requested.moment_Nm.z - expected.z).abs() < 1e-3);
            by_one_corner += usize::from(pushed == 1);
            if expected.z.abs() > most_Nm.abs() {
                most_Nm = expected.z;
            }
            let turn_rad = simulated.truth().p_BH.z;
            if turn_rad.abs() > most_rad.abs() {
                most_rad = turn_rad;
            }
        }
        assert!(by_one_corner > 100, "{by_one_corner}");
        // The corner on the leaning side is pushed back: the box turns to lie flat.
        assert!(side * most_Nm > 0.01, "side {side}: {most_Nm} N m");
        assert!(side * most_rad > 0.01 && most_rad.abs() < 0.6, "side {side}: {most_rad} rad");
    }
}
