//! The bound against brute force, and on the plant: walls that are too stiff are softened until
//! a handle comes to rest on them, and not much more than that.

use std::sync::Arc;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::actuation::{ActuatorKind, Strategy};
use crate::config::{DeviceDefinition, Scene, build_plan};
use crate::control::{ControlState, Decision, Limit, Mode, Report, Sample, Setpoint, TickInput};
use crate::device::{HandProgram, Plant, PlantParameters};
use crate::environment::{Element, Material, SceneItem, Shape, Surface};
use crate::notation::MAX_ACTUATORS;

fn any_matrix(rng: &mut ChaCha8Rng, rank: usize) -> Matrix3<f64> {
    let mut sum = Matrix3::zeros();
    for _ in 0..rank {
        let v = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
        sum += v * v.transpose();
    }
    sum
}

#[test]
fn the_largest_eigenvalue_is_that_of_an_iterative_solver() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for i in 0..2_000 {
        let matrix = any_matrix(&mut rng, i % 4) * 10f64.powf(rng.random_range(-6.0..6.0));
        let found = largest_eigenvalue(&matrix);
        let exact = matrix.symmetric_eigenvalues().max();
        assert!((found - exact).abs() <= 1e-7 * exact.abs(), "{matrix}: {found} {exact}");
    }
    assert_eq!(largest_eigenvalue(&Matrix3::from_diagonal_element(3.0)), 3.0);
}

#[test]
fn what_is_fed_most_is_found_by_looking_in_every_direction() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    for i in 0..50 {
        let (late, felt) = (any_matrix(&mut rng, 1 + i % 3), any_matrix(&mut rng, 4));
        let fed = most_fed(&late, &felt).expect("damped in every direction");
        let mut seen = 0.0_f64;
        for _ in 0..20_000 {
            let way = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
            seen = seen.max(way.dot(&(late * way)) / way.dot(&(felt * way)));
        }
        assert!(seen <= fed * (1.0 + 1e-9) && seen > 0.8 * fed, "{seen} {fed}");
    }
    assert_eq!(most_fed(&Matrix3::identity(), &any_matrix(&mut rng, 2)), None);
}

#[test]
fn the_least_damping_is_that_of_the_worst_force() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for _ in 0..50 {
        let felt = any_matrix(&mut rng, 5);
        let arm = PlaneVector::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), 0.0);
        let give = felt.try_inverse().expect("regular");
        let worst = (0..3600).map(|tenth| {
            let (sin, cos) = f64::from(tenth).mul_add(1e-1, 0.0).to_radians().sin_cos();
            let push = PlaneVector::new(cos, sin, arm.x * sin - arm.y * cos);
            1.0 / push.dot(&(give * push))
        });
        let (worst, found) =
            (worst.fold(f64::INFINITY, f64::min), least_damping_N_s_per_m(&felt, &arm));
        assert!((found / worst - 1.0).abs() < 1e-5, "{found} {worst}");
    }
}

/// A motor device and a hand that presses with a constant force and damps nothing.
struct Bounce {
    plan: Plan,
    plant: Plant,
    state: ControlState,
    push: PlaneVector,
}

impl Bounce {
    /// `believed` times the drag that the shafts have is what the tick reckons with.
    fn new(name: &str, walls: &[(Vector3<f64>, f64)], push: PlaneVector, believed: f64) -> Self {
        let device = DeviceDefinition::load(name).expect("built in");
        let simulated = device.simulation(HandProgram::default());
        let parameters = PlantParameters {
            mechanism: Arc::clone(&simulated.mechanism),
            kinds: simulated.kinds,
            max_torque_Nm: simulated.max_torque_Nm,
            lag_s: simulated.lag_s,
            residual_Nm: simulated.residual_Nm,
            imperfections: simulated.imperfections,
            damping_N_m_s_per_rad: simulated.damping_N_m_s_per_rad,
            resolution_Nm: simulated.resolution_Nm,
        };
        let start = PlaneVector::new(device.start_m[0], device.start_m[1], 0.0);
        let scene = walls.iter().enumerate().map(|(slot, (normal_W, stiffness_N_per_m))| {
            let edge_m = Vector3::new(start.x, start.y, 0.0) - 0.002 * normal_W;
            let furthest = device.tool.points_T_m().iter().map(|point| -point.dot(normal_W));
            let ahead_m = furthest.fold(device.tool.radius_m, f64::max);
            let shape =
                Shape::HalfSpace { point_W_m: edge_m - ahead_m * normal_W, normal_W: *normal_W };
            let material =
                Material { stiffness_N_per_m: *stiffness_N_per_m, ..Material::default() };
            let surface = Surface { shape, material, hollow: false, blend_s: 0.0 };
            let element = Element::Surface(surface);
            SceneItem { slot: slot as u16, revision: 1, element }
        });
        let mut plan = Plan { scene: scene.collect(), ..build_plan(&device, &Scene::default()) };
        plan.actuators.damping_N_m_s_per_rad *= believed;
        plan.guards.activation_ramp_ns = 0;
        let plant = Plant::new(parameters, &start).expect("regular");
        Self { plan, plant, state: ControlState::new(Mode::Enabled), push }
    }

    /// Runs for two seconds: the speed (rms) of the last tenth, m/s, and the last report.
    fn settle(&mut self) -> (f64, Report) {
        let (mut squares, mut last) = (0.0, Report::default());
        for number in 0..2_000_u64 {
            let per_rad = self.plan.actuators.counts_per_revolution / std::f64::consts::TAU;
            let mut sample = Sample::default();
            for i in 0..MAX_ACTUATORS {
                sample.counts[i] = (self.plant.shaft_rad()[i] * per_rad[i]).round() as i64;
            }
            let input = TickInput {
                sample: Ok(sample),
                setpoint: &Setpoint::NONE,
                plan: &self.plan,
                now_ns: 1_000_000 * (number + 1),
                overruns_in_row: 0,
            };
            let Decision { commands, report } = crate::control::tick(&mut self.state, &input);
            self.plant.command(&commands);
            for _ in 0..10 {
                self.plant.step(&self.push, 1e-4);
            }
            if number >= 1_800 {
                squares += self.plant.v_BH().xy().norm_squared() / 200.0;
            }
            last = report;
        }
        (squares.sqrt(), last)
    }
}

const STIFF_N_PER_M: f64 = 1e7;

/// At the bound nothing is fed and nothing is taken: what is left of the bounce rings out on
/// whatever damps the hand, and here nothing does.
const RESTS_M_PER_S: f64 = 0.03;
const BUZZES_M_PER_S: f64 = 0.06;

#[test]
fn a_wall_of_any_stiffness_rings_out_and_with_a_bound_eight_times_as_high_it_buzzes() {
    let around: &[f64] = &[0.0, 1.0, 2.5, 4.0];
    // A plate that comes to lie askew against its stops does not bounce at all.
    for (name, push_N, bearings_rad) in [("singh", 4.0, around), ("kim-2003", 2.0, &[0.0])] {
        for &bearing_rad in bearings_rad {
            let (sin, cos) = f64::sin_cos(bearing_rad);
            let walls = [(Vector3::new(-cos, -sin, 0.0), STIFF_N_PER_M)];
            let push = PlaneVector::new(push_N * cos, push_N * sin, 0.0);
            let run = |believed| Bounce::new(name, &walls, push, believed).settle();
            let (speed, report) = run(1.0);
            assert!(speed < RESTS_M_PER_S, "{name} at {bearing_rad}: {speed} m/s");
            assert!(report.limits.contains(Limit::Stiffness), "{:?}", report.limits);
            let (buzzing, _) = run(8.0);
            assert!(buzzing > BUZZES_M_PER_S, "{name} at {bearing_rad}: only {buzzing} m/s");
            println!("{name} at {bearing_rad}: {speed} m/s, eight times {buzzing} m/s");
            if name == "kim-2003" {
                continue; // the plate turns: which corners are how deep is another story
            }
            let depth_m = report.contacts()[0].depth_m;
            assert!((1e-4..2e-2).contains(&depth_m), "{name}: {depth_m}");
            // What the springs give holds the hand: the motors are far from their ends.
            assert!((report.contacts()[0].normal_N - push_N).abs() < 0.3 * push_N, "{report:?}");
        }
    }
}

#[test]
fn walls_on_top_of_each_other_and_corners_are_softened_as_one() {
    let (into_x, into_y) = (-Vector3::x(), -Vector3::y());
    let push = PlaneVector::new(3.0, 0.0, 0.0);
    let stiffness = |walls: &[(Vector3<f64>, f64)], push| {
        let (speed, report) = Bounce::new("singh", walls, push, 1.0).settle();
        assert!(speed < RESTS_M_PER_S, "{walls:?}: {speed} m/s");
        let felt_N: f64 = report.contacts().iter().map(|contact| contact.normal_N).sum();
        (felt_N / report.contacts()[0].depth_m, report.limits.contains(Limit::Stiffness))
    };
    let (alone, softened) = stiffness(&[(into_x, STIFF_N_PER_M)], push);
    assert!(softened);
    let (four, softened) = stiffness(&[(into_x, STIFF_N_PER_M); 4], push);
    assert!(softened && (four / alone - 1.0).abs() < 0.05, "{four} {alone}");
    // What it can hold is held as it is.
    let (soft, softened) = stiffness(&[(into_x, 0.5 * alone)], push);
    assert!(!softened && (soft / alone - 0.5).abs() < 0.03, "{soft} {alone}");
    // Two walls at a right angle take nothing from each other where the drag is alike.
    let both = PlaneVector::new(3.0, 3.0, 0.0);
    let (corner, softened) = stiffness(&[(into_x, STIFF_N_PER_M), (into_y, STIFF_N_PER_M)], both);
    assert!(softened && (0.4..2.5).contains(&(corner / alone)), "{corner} {alone}");
}

#[test]
fn brakes_are_asked_for_all_of_it() {
    let walls = [(-Vector3::x(), STIFF_N_PER_M)];
    let mut bounce = Bounce::new("cho-2005", &walls, PlaneVector::new(5.0, 0.0, 0.0), 1.0);
    bounce.plan.strategy = Strategy::Optimal;
    let (_, report) = bounce.settle();
    assert!(report.contact_count > 0 && !report.limits.contains(Limit::Stiffness), "{report:?}");
    assert!(bounce.plan.actuators.kinds[..4].iter().all(|kind| *kind == ActuatorKind::Brake));
}
