//! Time of the allocation alone, beside exhaustive search and beside a general solver
//! (Clarabel, an interior-point method): promise 12 of SPECIFICATION.
//!
//! Four brakes: postures over the workspace of `cho-2005`, moving or nearly at rest, any
//! desired force. Six motors: any reference matrix with three freedoms. Exhaustive search is
//! the reference for time and for the answer: a difference ends the bench.

#![allow(non_snake_case)]

#[path = "allocation/clarabel.rs"]
mod by_clarabel;
mod measure;

use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::Duration;

use by_clarabel::Clarabel;
use hapticd::actuation::{
    ActuatorKind, Bounds, Capability, Handle, LawState, ShaftMotion, Shafts, Strategy, WallDemand,
    Wanted, allocate, nearest_reference, optimal, predicted_velocity,
};
use hapticd::config::DeviceDefinition;
use hapticd::notation::{
    ActuatorVector, HandleInertia, MAX_ACTUATORS, PlaneVector, ReferenceMatrix,
};
use measure::{Series, clock_alone, print_table, rounds, timed};
use nalgebra::Vector2;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Different problems; each is solved many times.
const CASES: usize = 2_000;

/// Slower shafts count as at rest: two counts in a window of 16 ms.
const REST_RAD_PER_S: f64 = 2.0 * TAU / 65_536.0 / 0.016;

struct Case {
    capability: Capability,
    handle: Handle,
    desired: PlaneVector,
    walls: [WallDemand; 1],
}

fn main() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let brakes = four_brakes(&mut rng);
    let motors = six_motors(&mut rng);
    let clock = clock_alone();
    let passes = rounds(40);

    let optimum = |case: &Case| optimal(&case.capability, black_box(&case.desired)).torque_Nm;
    let search = searched("exhaustive search", &brakes[..rounds(1_000)]);
    let best = repeated("optimal", &brakes, passes, optimum);
    let general = general_solver(&brakes[..rounds(1_000)]);
    let nearest = repeated("nearest-reference", &brakes, passes, |case| {
        let Case { capability, handle, desired, .. } = case;
        nearest_reference(capability, black_box(desired), &handle.velocity).raw_torque_Nm
    });
    let wall = repeated("predicted-velocity", &brakes, passes, |case| {
        predicted_velocity(&case.capability, &case.handle, black_box(&case.walls)).torque_Nm
    });
    // The law and its observer, in their second tick at the wall.
    let states: Vec<LawState> =
        brakes.iter().map(|case| slid(case, LawState::default()).1).collect();
    let started: Vec<_> = brakes.iter().zip(&states).collect();
    let slide = repeated("sliding, whole", &started, passes, |(case, state)| {
        slid(black_box(case), **state).0
    });
    let walls = wall.iter().chain(&slide);
    let rows = best.iter().chain(&nearest).chain(walls).chain([&search, &general, &clock]);
    print_table("four brakes, two freedoms", &search, rows);

    let search = searched("exhaustive search", &motors[..rounds(100)]);
    let best = repeated("optimal", &motors, passes, optimum);
    let general = general_solver(&motors[..rounds(1_000)]);
    let rows = best.iter().chain([&search, &general, &clock]);
    print_table("six motors, three freedoms", &search, rows);
}

/// One tick of `sliding`, from a state to the next.
fn slid(case: &Case, mut state: LawState) -> (ActuatorVector, LawState) {
    let Case { capability, handle, walls, .. } = case;
    let wanted = Wanted { soft: PlaneVector::zeros(), walls };
    let shafts = Shafts::IDEAL;
    let told = allocate(Strategy::Sliding, capability, handle, &wanted, &shafts, &mut state);
    (told.torque_Nm, state)
}

/// Every problem many times: all calls, and of each problem the fastest, which shows what the
/// algorithm takes where the machine does not interfere.
fn repeated<T>(
    name: &str,
    cases: &[T],
    passes: usize,
    law: impl Fn(&T) -> ActuatorVector,
) -> [Series; 2] {
    let mut series = Series::new(name);
    let mut best = vec![Duration::MAX; cases.len()];
    for _ in 0..passes {
        for (case, best) in cases.iter().zip(&mut best) {
            let (took, _) = timed(|| law(black_box(case)));
            series.record(took);
            *best = took.min(*best);
        }
    }
    let mut undisturbed = Series::new(format!("  each problem at its best of {passes}"));
    best.into_iter().for_each(|took| undisturbed.record(took));
    [series, undisturbed]
}

/// The time of exhaustive search, and its answers held against those of `optimal`.
fn searched(name: &str, cases: &[Case]) -> Series {
    let mut series = Series::new(name);
    for case in cases {
        let Case { capability, desired, .. } = case;
        let (distance, length) = series.time(|| exhaustive(capability, black_box(desired)));
        let found = optimal(capability, desired).torque_Nm;
        let (matrix, target) = scaled(capability, desired);
        let tolerance = 1e-9 * (1.0 + target.norm());
        let reached = (matrix * found - target).norm();
        assert!((reached - distance).abs() <= tolerance, "{reached} for {distance}");
        assert!(found.norm() <= length + 1e-6 * (1.0 + length), "{} for {length}", found.norm());
    }
    series
}

/// The time of Clarabel, and its distances held against those of `optimal`: never nearer, and
/// as near as an interior-point method gets.
fn general_solver(cases: &[Case]) -> Series {
    let mut series = Series::new("Clarabel, kept and updated");
    let mut solver = Clarabel::new(cases[0].capability.actuators);
    for Case { capability, desired, .. } in cases {
        let problem @ (matrix, target) = scaled(capability, desired);
        let Bounds { lower_Nm, upper_Nm } = &capability.bounds;
        let torque_Nm = series.time(|| solver.solve(black_box(&problem), (lower_Nm, upper_Nm)));
        let ours_N = (matrix * optimal(capability, desired).torque_Nm - target).norm();
        let theirs_N = (matrix * torque_Nm - target).norm();
        let most_N = target.norm();
        assert!(theirs_N > ours_N - 1e-5 * (1.0 + most_N), "{theirs_N} beats {ours_N}");
        assert!(theirs_N < ours_N + 1e-2 * (1.0 + most_N), "{theirs_N} for {ours_N}");
    }
    series
}

/// Every actuator at its lower bound, its upper bound, or free: the distance of the nearest
/// point and the least norm that gives it.
fn exhaustive(capability: &Capability, desired: &PlaneVector) -> (f64, f64) {
    let (matrix, target) = scaled(capability, desired);
    let Bounds { lower_Nm, upper_Nm } = &capability.bounds;
    let count = capability.actuators;
    let slack = 1e-9 * (1.0 + target.norm());
    let mut best = (f64::INFINITY, f64::INFINITY);
    for code in 0..3usize.pow(count as u32) {
        let (mut torque, mut free) = (ActuatorVector::zeros(), ReferenceMatrix::zeros());
        for i in 0..count {
            match code / 3usize.pow(i as u32) % 3 {
                0 => torque[i] = lower_Nm[i],
                1 => torque[i] = upper_Nm[i],
                _ => free.set_column(i, &matrix.column(i)),
            }
        }
        let svd = free.svd(true, true);
        let cut = 1e-10 * svd.singular_values.max();
        let Ok(given) = svd.solve(&(target - matrix * torque), cut.max(f64::MIN_POSITIVE)) else {
            continue;
        };
        torque += given;
        let inside = (0..count).all(|i| {
            let slack = 1e-9 * (1.0 + torque[i].abs());
            (lower_Nm[i] - slack..=upper_Nm[i] + slack).contains(&torque[i])
        });
        let (distance, length) = ((matrix * torque - target).norm(), torque.norm());
        let equal = distance < best.0 + slack && length < best.1;
        if inside && (distance < best.0 - slack || equal) {
            best = (best.0.min(distance), length);
        }
    }
    best
}

/// Moments in units of force, freedoms that are not there left out.
fn scaled(capability: &Capability, desired: &PlaneVector) -> (ReferenceMatrix, PlaneVector) {
    let share = if capability.freedoms > 2 { 1.0 / capability.moment_length_m } else { 0.0 };
    let (mut matrix, mut target) = (capability.reference, *desired);
    matrix.row_mut(2).scale_mut(share);
    target.z *= share;
    (matrix, target)
}

fn four_brakes(rng: &mut ChaCha8Rng) -> Vec<Case> {
    let device = DeviceDefinition::load("cho-2005").expect("a built-in device");
    let (kinds, max_Nm) = (device.actuators.kinds, device.actuators.max_torque_Nm);
    let anywhere = |rng: &mut ChaCha8Rng| {
        PlaneVector::new(rng.random_range(0.1..0.5), rng.random_range(-0.3..0.4), 0.0)
    };
    let postures = std::iter::from_fn(|| Some(device.mechanism.posture_at(&anywhere(rng))));
    let postures: Vec<_> = postures.flatten().take(CASES).collect();
    let case = |posture: hapticd::mechanism::Posture| {
        let velocity = planar(rng, -3.0..-0.5);
        let rates = posture.reference.transpose() * velocity;
        let motion = std::array::from_fn(|i| ShaftMotion::of(rates[i], REST_RAD_PER_S));
        let capability = Capability {
            reference: posture.reference,
            freedoms: 2,
            actuators: 4,
            kinds,
            bounds: Bounds::given(&kinds, &max_Nm, &motion),
            moment_length_m: device.mechanism.reach_m().1,
        };
        let hand_force = Some(planar(rng, 0.0..1.5));
        let inertia = posture.inertia;
        let handle = Handle { position: posture.p_BH, velocity, hand_force, inertia, tick_s: 1e-3 };
        let normal = planar(rng, 0.0..1.0).normalize();
        let walls = [WallDemand { normal, force_N: rng.random_range(1.0..100.0), depth_m: 1e-4 }];
        Case { capability, handle, desired: planar(rng, -1.0..2.0), walls }
    };
    postures.into_iter().map(case).collect()
}

fn six_motors(rng: &mut ChaCha8Rng) -> Vec<Case> {
    let kinds = [ActuatorKind::Motor; MAX_ACTUATORS];
    let mut case = || {
        let entry = |row: usize| if row < 2 { 10.0 } else { 1.0 };
        let reference = ReferenceMatrix::from_fn(|row, _| entry(row) * rng.random_range(-1.0..1.0));
        let max_Nm = ActuatorVector::from_fn(|_, _| rng.random_range(0.5..5.0));
        let mut desired = planar(rng, -1.0..2.0);
        desired.z = 0.3 * desired.norm() * rng.random_range(-1.0..1.0);
        let capability = Capability {
            reference,
            freedoms: 3,
            actuators: 6,
            kinds,
            bounds: Bounds::given(&kinds, &max_Nm, &[ShaftMotion::Rest; MAX_ACTUATORS]),
            moment_length_m: 0.3,
        };
        let handle = Handle {
            position: PlaneVector::zeros(),
            velocity: PlaneVector::zeros(),
            hand_force: None,
            inertia: HandleInertia::identity(),
            tick_s: 1e-3,
        };
        Case { capability, handle, desired, walls: Default::default() }
    };
    (0..CASES).map(|_| case()).collect()
}

/// Any direction; the decimal logarithm of the length in `log10`.
fn planar(rng: &mut ChaCha8Rng, log10: std::ops::Range<f64>) -> PlaneVector {
    let bearing_rad = rng.random_range(0.0..TAU);
    let length = 10f64.powf(rng.random_range(log10));
    let along = Vector2::new(bearing_rad.cos(), bearing_rad.sin()) * length;
    PlaneVector::new(along.x, along.y, 0.0)
}
