//! Tests of the plant with three freedoms, motors, viscous drag and steps of torque.

use std::f64::consts::TAU;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::mechanism::{Inertia, LinkInertia, ThreeRrr, ThreeRrrParameters};

const DT_S: f64 = 5e-4;

fn plate(edit: impl Fn(&mut PlantParameters)) -> Plant {
    let kim = ThreeRrrParameters { base_m: 0.2, l_m: [0.1; 3], turn_rad: 0.5, elbows: [1; 3] };
    let link = LinkInertia { mass_kg: 0.1, centre_m: 0.05, inertia_kg_m2: 1e-4 };
    let inertia = Inertia { links: [link; 6], ..Inertia::default() };
    let mut parameters = PlantParameters {
        mechanism: Arc::new(ThreeRrr::new(kim, inertia).expect("valid")),
        kinds: [ActuatorKind::Motor; MAX_ACTUATORS],
        max_torque_Nm: ActuatorVector::repeat(1.0),
        lag_s: ActuatorVector::zeros(),
        residual_Nm: ActuatorVector::zeros(),
        imperfections: Imperfections::default(),
        damping_N_m_s_per_rad: ActuatorVector::zeros(),
        resolution_Nm: ActuatorVector::zeros(),
    };
    edit(&mut parameters);
    Plant::new(parameters, &PlaneVector::zeros()).expect("inside the stops")
}

fn torques(torque_Nm: [f64; MAX_ACTUATORS]) -> ActuatorCommands {
    torque_Nm.map(|torque_Nm| ActuatorCommand::Motor { torque_Nm })
}

#[test]
fn a_driven_plate_stays_within_its_stops_and_its_books() {
    let mut plant = plate(|parameters| parameters.damping_N_m_s_per_rad.fill(2e-3));
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let (mut most_m, mut most_rad) = (0.0_f64, 0.0_f64);
    for step in 0..20_000 {
        if step % 100 == 0 {
            plant.command(&torques(std::array::from_fn(|_| rng.random_range(-1.0..1.0))));
        }
        let push = PlaneVector::from_fn(|i, _| rng.random_range(-2.0..2.0) * [1.0, 1.0, 0.1][i]);
        plant.step(&push, DT_S);
        most_m = most_m.max(plant.p_BH().xy().norm());
        most_rad = most_rad.max(plant.p_BH().z.abs());
        let Energy { hand_J, motors_J, dissipated_J } = *plant.energy();
        assert!(plant.kinetic_J() <= hand_J + motors_J - dissipated_J + 1e-9);
        let exact = plant.parameters.mechanism.posture_at(plant.p_BH()).expect("regular");
        let wrong = (plant.shaft_rad() - exact.shaft_rad).map(|a| (a / TAU).round() * TAU - a);
        // A tenth of a count of 65,536: the plate turns at tens of rad/s here.
        assert!(wrong.norm() < 1e-5, "step {step}: {wrong}");
    }
    let (_, furthest_m) = plant.parameters.mechanism.reach_m();
    assert!((0.9..=0.95 + 1e-9).contains(&(most_m / furthest_m)), "{most_m}");
    assert!((0.4..=0.475 + 1e-9).contains(&most_rad), "{most_rad}");
}

#[test]
fn a_plate_flies_through_the_centre_of_its_disc() {
    let mut plant = plate(|_| ());
    plant.p_BH = PlaneVector::new(0.01, 0.0, 0.0);
    plant.posture = plant.parameters.mechanism.posture_at(&plant.p_BH).expect("regular");
    plant.shaft_rad = plant.posture.shaft_rad;
    plant.v_BH = PlaneVector::new(-0.5, 0.0, 0.0);
    let before_J = plant.kinetic_J();
    for _ in 0..80 {
        plant.step(&PlaneVector::zeros(), DT_S);
    }
    assert!(plant.p_BH().x < -0.007, "{}", plant.p_BH());
    assert!((plant.kinetic_J() / before_J - 1.0).abs() < 1e-9);
}

#[test]
fn viscous_drag_is_worth_what_duality_says_and_never_drives() {
    for (drag, share) in [(1e-3, 0.05), (100.0, 1.0)] {
        let mut plant = plate(|parameters| parameters.damping_N_m_s_per_rad.fill(drag));
        plant.v_BH = PlaneVector::new(0.1, -0.05, 0.5);
        let (R, v) = (plant.posture.reference, plant.v_BH);
        let power_W = drag * R.tr_mul(&v).norm_squared();
        let mut last_J = plant.kinetic_J();
        let first_J = last_J;
        for step in 0..200 {
            plant.step(&PlaneVector::zeros(), DT_S);
            let now_J = plant.kinetic_J();
            assert!(now_J <= last_J * (1.0 + 1e-12), "step {step}: {now_J} after {last_J}");
            if step == 0 && share < 1.0 {
                let lost_J = last_J - now_J;
                assert!((lost_J / (power_W * DT_S) - 1.0).abs() < share, "{lost_J}");
            }
            last_J = now_J;
        }
        assert!(last_J < 0.95 * first_J);
        let books_J = first_J - plant.energy().dissipated_J;
        assert!(last_J <= books_J + 1e-12, "{last_J} {books_J}");
    }
}

#[test]
fn a_motor_gives_whole_steps_of_torque_and_no_more_than_its_largest() {
    let mut plant = plate(|parameters| {
        parameters.resolution_Nm =
            ActuatorVector::from_column_slice(&[0.0, 0.1, 0.1, 0.3, 0.3, 2.0]);
    });
    plant.command(&torques([0.123, 0.149, -0.151, 5.0, -5.0, 0.9]));
    plant.step(&PlaneVector::zeros(), DT_S);
    let expected = [0.123, 0.1, -0.2, 0.9, -0.9, 0.0];
    for (reached_Nm, expected_Nm) in plant.reached_Nm().iter().zip(expected) {
        assert!((reached_Nm - expected_Nm).abs() < 1e-12, "{reached_Nm} {expected_Nm}");
    }
}

#[test]
fn a_turn_beyond_the_stop_is_no_place_to_begin() {
    let parameters = plate(|_| ()).parameters;
    assert!(Plant::new(parameters.clone(), &PlaneVector::new(0.0, 0.0, 0.47)).is_ok());
    let beyond = Plant::new(parameters, &PlaneVector::new(0.0, 0.0, 0.48));
    assert!(matches!(beyond, Err(KinematicsError::Unreachable { .. })));
}
