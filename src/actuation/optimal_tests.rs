//! Tests of the allocator against exhaustive search.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::actuation::{ActuatorKind, ShaftMotion};

/// Every way to put each actuator at its lower bound, its upper bound, or free; least
/// squares and least norm on the free ones by an SVD. The best feasible one wins.
fn exhaustive(capability: &Capability, desired: &PlaneVector) -> (f64, f64) {
    let (matrix, target) = scaled(capability, desired);
    let n = capability.actuators;
    let scale = 1.0 + target.norm();
    let (mut distance, mut norm) = (f64::INFINITY, f64::INFINITY);
    for code in 0..3usize.pow(n as u32) {
        let state = |i: usize| code / 3usize.pow(i as u32) % 3;
        let mut torque = ActuatorVector::zeros();
        for i in 0..n {
            torque[i] = match state(i) {
                0 => capability.bounds.lower_Nm[i],
                1 => capability.bounds.upper_Nm[i],
                _ => 0.0,
            };
        }
        let free: Vec<usize> = (0..n).filter(|&i| state(i) == 2).collect();
        if !free.is_empty() {
            let columns = nalgebra::DMatrix::from_fn(3, free.len(), |r, c| matrix[(r, free[c])]);
            let rest = target - matrix * torque;
            let svd = columns.svd(true, true);
            let cut = 1e-10 * svd.singular_values.max();
            let Ok(solution) =
                svd.solve(&nalgebra::DVector::from_column_slice(rest.as_slice()), cut)
            else {
                continue;
            };
            for (k, &i) in free.iter().enumerate() {
                torque[i] = solution[k];
            }
        }
        let inside = (0..n).all(|i| {
            let slack = 1e-9 * (1.0 + torque[i].abs());
            torque[i] >= capability.bounds.lower_Nm[i] - slack
                && torque[i] <= capability.bounds.upper_Nm[i] + slack
        });
        if !inside {
            continue;
        }
        let reached = (matrix * torque - target).norm();
        let better = reached < distance - 1e-9 * scale;
        if better || (reached < distance + 1e-9 * scale && torque.norm() < norm) {
            distance = distance.min(reached);
            norm = torque.norm();
        }
    }
    (distance, norm)
}

fn random_case(rng: &mut ChaCha8Rng) -> (Capability, PlaneVector) {
    let actuators = rng.random_range(1..=MAX_ACTUATORS);
    let freedoms = rng.random_range(1..=3);
    let mut reference = ReferenceMatrix::zeros();
    for i in 0..actuators {
        for row in 0..freedoms {
            reference[(row, i)] = rng.random_range(-10.0..10.0);
        }
        match rng.random_range(0..12) {
            0 => reference.column_mut(i).fill(0.0),
            1 if i > 0 => {
                let other = reference.column(i - 1) * rng.random_range(-2.0..2.0);
                reference.set_column(i, &other);
            }
            _ => {}
        }
    }
    let kinds = std::array::from_fn(|_| {
        if rng.random_bool(0.3) { ActuatorKind::Motor } else { ActuatorKind::Brake }
    });
    let motion = std::array::from_fn(|_| match rng.random_range(0..4) {
        0 => ShaftMotion::Rest,
        1 => ShaftMotion::Forward,
        _ => ShaftMotion::Backward,
    });
    let max = ActuatorVector::from_fn(|_, _| {
        if rng.random_bool(0.05) { 0.0 } else { rng.random_range(0.1..20.0) }
    });
    let bounds = Bounds::given(&kinds, &max, &motion);
    let size = 10f64.powf(rng.random_range(-3.0..4.0));
    let mut desired = PlaneVector::zeros();
    for row in 0..freedoms {
        desired[row] = size * rng.random_range(-1.0..1.0);
    }
    let capability =
        Capability { reference, freedoms, actuators, kinds, bounds, moment_length_m: 0.3 };
    (capability, desired)
}

#[test]
fn it_equals_exhaustive_search() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for case in 0..4000 {
        let (capability, desired) = random_case(&mut rng);
        let (matrix, target) = scaled(&capability, &desired);
        let found = optimal(&capability, &desired);
        let (distance, norm) = exhaustive(&capability, &desired);
        let reached = (matrix * found.torque_Nm - target).norm();
        let scale = 1.0 + target.norm();
        assert!(
            (reached - distance).abs() <= 1e-9 * scale,
            "case {case}: {reached} for {distance}"
        );
        let torque = found.torque_Nm;
        assert!(
            torque.norm() <= norm + 1e-7 * (1.0 + norm),
            "case {case}: {} for {norm}",
            torque.norm()
        );
        for i in 0..MAX_ACTUATORS {
            let Bounds { lower_Nm, upper_Nm } = capability.bounds;
            let outside = torque[i] < lower_Nm[i] || torque[i] > upper_Nm[i];
            assert!(!outside || i >= capability.actuators, "case {case}: {i} out of bounds");
        }
    }
}

#[test]
fn the_first_step_alone_finds_the_same_force() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    for _ in 0..4000 {
        let (capability, desired) = random_case(&mut rng);
        let (matrix, target) = scaled(&capability, &desired);
        let Bounds { lower_Nm, upper_Nm } = capability.bounds;
        let x = nearest_in_box(&matrix, &target, &lower_Nm, &upper_Nm, capability.actuators);
        let wrench = optimal(&capability, &desired).torque_Nm;
        assert!((matrix * x - matrix * wrench).norm() <= 1e-9 * (1.0 + target.norm()));
    }
}

#[test]
fn weights_move_the_load_and_never_the_force() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    for _ in 0..2000 {
        let (capability, desired) = random_case(&mut rng);
        let weights = ActuatorVector::from_fn(|_, _| rng.random_range(0.1..10.0));
        let cost = |torque: &ActuatorVector| {
            (0..MAX_ACTUATORS).map(|i| weights[i] * torque[i] * torque[i]).sum::<f64>()
        };
        let plain = optimal(&capability, &desired);
        let weighted = optimal_weighted(&capability, &desired, &weights);
        let slack = 1e-8 * (1.0 + desired.norm());
        assert!((plain.wrench - weighted.wrench).norm() <= slack * 10.0);
        assert!(cost(&weighted.torque_Nm) <= cost(&plain.torque_Nm) * (1.0 + 1e-7) + 1e-9);
    }
}

#[test]
fn what_is_not_a_number_gives_no_torque() {
    let (mut capability, desired) = random_case(&mut ChaCha8Rng::seed_from_u64(10));
    let bad = PlaneVector::new(f64::NAN, f64::INFINITY, 0.0);
    assert_eq!(optimal(&capability, &bad).torque_Nm, ActuatorVector::zeros());
    capability.reference[(0, 0)] = f64::NAN;
    assert_eq!(optimal(&capability, &desired).torque_Nm, ActuatorVector::zeros());
}
