//! Tests of the plant against closed forms, brute force, invariants and its energy ledger.

use std::f64::consts::TAU;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::control::RELEASED;
use crate::mechanism::{FiveBar, Inertia, LinkInertia, TwoLink, TwoLinkParameters, fixtures};

const DT_S: f64 = 5e-4;
const MASS_KG: f64 = 0.5;

fn plant_of(mechanism: Arc<dyn Mechanism>, kind: ActuatorKind, [x, y]: [f64; 2]) -> Plant {
    let parameters = PlantParameters {
        mechanism,
        kinds: [kind; MAX_ACTUATORS],
        max_torque_Nm: ActuatorVector::repeat(20.0),
        lag_s: ActuatorVector::zeros(),
        residual_Nm: ActuatorVector::zeros(),
        imperfections: Imperfections::default(),
        damping_N_m_s_per_rad: ActuatorVector::zeros(),
        resolution_Nm: ActuatorVector::zeros(),
    };
    Plant::new(parameters, &PlaneVector::new(x, y, 0.0)).expect("inside the stops")
}

fn cho(start_m: [f64; 2]) -> Plant {
    let five_bar = FiveBar::new(fixtures::CHO[0], Inertia::default()).expect("valid");
    plant_of(Arc::new(five_bar), ActuatorKind::Brake, start_m)
}

/// The same linkage with links, and a counterweight, far heavier than the handle.
fn heavy_cho(start_m: [f64; 2]) -> Plant {
    let link = |i: usize| LinkInertia {
        mass_kg: 0.5 + 0.3 * i as f64,
        centre_m: 0.1 - 0.05 * i as f64,
        inertia_kg_m2: 4e-3,
    };
    let inertia = Inertia {
        handle_mass_kg: 0.2,
        links: std::array::from_fn(link),
        shaft_inertia_kg_m2: ActuatorVector::repeat(1e-4),
        ..Inertia::default()
    };
    let five_bar = FiveBar::new(fixtures::CHO[0], inertia).expect("valid");
    plant_of(Arc::new(five_bar), ActuatorKind::Brake, start_m)
}

fn brakes(capacity_Nm: [f64; 4]) -> ActuatorCommands {
    let mut commands = RELEASED;
    for (command, capacity_Nm) in commands.iter_mut().zip(capacity_Nm) {
        *command = ActuatorCommand::Brake { capacity_Nm };
    }
    commands
}

fn random_force(rng: &mut impl Rng, most_N: f64) -> PlaneVector {
    let mut component = || rng.random_range(-most_N..=most_N);
    PlaneVector::new(component(), component(), 0.0)
}

#[test]
fn a_free_handle_accelerates_as_its_mass_says() {
    let mut plant = cho([0.3, 0.2]);
    let F_N = PlaneVector::new(0.5, -0.8, 0.0);
    for _ in 0..400 {
        plant.step(&F_N, DT_S);
    }
    assert!((plant.v_BH() - F_N * (0.2 / MASS_KG)).norm() < 1e-12);
    // Semi-implicit: half a step's worth ahead of t^2 / 2.
    let way_m = plant.p_BH() - PlaneVector::new(0.3, 0.2, 0.0);
    assert!((way_m - F_N / MASS_KG * (0.02 + 0.1 * DT_S)).norm() < 1e-12);
}

#[test]
fn a_brake_holds_up_to_its_capacity_and_slips_beyond_with_what_is_left() {
    for i in 0..4 {
        for part in [-1.5, -0.99, -0.5, 0.99, 1.01, 3.0] {
            let mut plant = cho([0.3, 0.2]);
            let mut capacity_Nm = [0.0; 4];
            capacity_Nm[i] = 0.4;
            plant.command(&brakes(capacity_Nm));
            let ray: PlaneVector = plant.posture.reference.column(i).into();
            let F_N = part * 0.4 * ray;
            plant.step(&F_N, DT_S);
            let over = part - part.clamp(-1.0, 1.0);
            let expected = over * 0.4 * ray * (DT_S / MASS_KG);
            assert!((plant.v_BH() - expected).norm() < 1e-9, "brake {i}, {part}");
            let held_Nm = -0.4 * part.clamp(-1.0, 1.0);
            assert!((plant.torque_Nm()[i] - held_Nm).abs() < 1e-6, "brake {i}, {part}");
        }
    }
}

#[test]
fn drag_holds_without_any_command_and_a_motor_has_it_too() {
    for kind in [ActuatorKind::Brake, ActuatorKind::Motor] {
        let mut plant = cho([0.3, 0.2]);
        plant.parameters.kinds = [kind; MAX_ACTUATORS];
        plant.parameters.residual_Nm = ActuatorVector::repeat(0.1);
        let ray: PlaneVector = plant.posture.reference.column(0).into();
        plant.step(&(0.09 * ray), DT_S);
        assert!(plant.v_BH().norm() < 1e-9);
        plant.step(&(2.0 * ray), DT_S);
        assert!(plant.v_BH().norm() > 1e-4);
    }
}

#[test]
fn no_other_torques_within_the_capacities_leave_less_energy() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..300 {
        let mut plant = heavy_cho([0.3, 0.2]);
        plant.v_BH = 0.2 * random_force(&mut rng, 1.0);
        let hold_Nm = std::array::from_fn(|_| rng.random_range(0.0..4.0));
        plant.command(&brakes(hold_Nm));
        let F_N = random_force(&mut rng, 40.0);
        let (before, v_0) = (plant.posture, plant.v_BH);
        plant.step(&F_N, DT_S);
        let inverse = invertible(&before).try_inverse().expect("an inertia");
        let left_J = |torque_Nm: &ActuatorVector| {
            let v = v_0 + DT_S * inverse * (F_N + before.reference * torque_Nm);
            0.5 * v.dot(&(before.inertia * v))
        };
        let least_J = left_J(plant.torque_Nm());
        assert!((least_J - plant.kinetic_J()).abs() < 1e-9 * least_J.max(1e-6));
        for _ in 0..100 {
            let other = ActuatorVector::from_fn(|i, _| match hold_Nm.get(i) {
                Some(hold_Nm) => {
                    rng.random_range(-1.0..=1.0_f64).signum()
                        * hold_Nm
                        * if rng.random_bool(0.3) { rng.random_range(0.0..1.0) } else { 1.0 }
                }
                None => 0.0,
            });
            assert!(left_J(&other) >= least_J - 1e-12);
        }
    }
}

#[test]
fn capacities_lag_as_configured_whatever_the_step() {
    for step_s in [1e-4, 5e-4, 2e-3] {
        let mut plant = cho([0.3, 0.2]);
        plant.parameters.lag_s = ActuatorVector::from_fn(|i, _| 0.01 * (i as f64 + 1.0));
        plant.command(&brakes([5.0; 4]));
        for _ in 0..(0.02_f64 / step_s).round() as usize {
            plant.step(&PlaneVector::zeros(), step_s);
        }
        for i in 0..4 {
            let expected_Nm = 5.0 * (1.0 - (-2.0 / (i as f64 + 1.0)).exp());
            assert!((plant.reached_Nm()[i] - expected_Nm).abs() < 1e-9);
        }
    }
}

#[test]
fn commands_are_clipped_and_the_wrong_or_the_senseless_ones_release() {
    let mut plant = cho([0.3, 0.2]);
    let reached = |plant: &mut Plant, command| {
        plant.command(&[command; MAX_ACTUATORS]);
        plant.step(&PlaneVector::zeros(), DT_S);
        assert_eq!(plant.reached_Nm()[4], 0.0);
        plant.reached_Nm()[0]
    };
    for (capacity_Nm, expected) in
        [(3.0, 3.0), (50.0, 20.0), (f64::INFINITY, 20.0), (-1.0, 0.0), (f64::NAN, 0.0)]
    {
        let command = ActuatorCommand::Brake { capacity_Nm };
        assert_eq!(reached(&mut plant, command), expected);
    }
    let motor = |torque_Nm| ActuatorCommand::Motor { torque_Nm };
    assert_eq!(reached(&mut plant, motor(3.0)), 0.0);
    plant.parameters.kinds = [ActuatorKind::Motor; MAX_ACTUATORS];
    for (torque_Nm, expected) in [(-50.0, -20.0), (0.01, 0.01), (f64::NAN, 0.0)] {
        assert_eq!(reached(&mut plant, motor(torque_Nm)), expected);
    }
    assert_eq!(reached(&mut plant, RELEASED[0]), 0.0);
}

#[test]
fn motors_push_with_their_reference_forces() {
    let arm = TwoLinkParameters { l1_m: 0.3, l2_m: 0.3, elbow: 1 };
    let arm = TwoLink::new(arm, Inertia::default()).expect("valid");
    let mut plant = plant_of(Arc::new(arm), ActuatorKind::Motor, [0.3, 0.2]);
    let torque_Nm = [0.3, -0.2];
    let mut commands = RELEASED;
    for (command, torque_Nm) in commands.iter_mut().zip(torque_Nm) {
        *command = ActuatorCommand::Motor { torque_Nm };
    }
    plant.command(&commands);
    let R = plant.posture.reference;
    plant.step(&PlaneVector::zeros(), DT_S);
    let F_N = R.column(0) * torque_Nm[0] + R.column(1) * torque_Nm[1];
    assert!((plant.v_BH() - F_N * (DT_S / MASS_KG)).norm() < 1e-12);
    assert!(plant.energy().motors_J > 0.0 && plant.energy().dissipated_J == 0.0);
}

/// A handle between locked brakes moves by their play, and no further.
#[test]
fn locked_brakes_with_backlash_leave_the_handle_their_play() {
    let mut plant = cho([0.3, 0.2]);
    let play_rad = 0.01;
    plant.parameters.imperfections.backlash_rad = ActuatorVector::repeat(play_rad);
    plant.command(&brakes([20.0; 4]));
    let before = *plant.shaft_rad();
    let mut most_rad = ActuatorVector::zeros();
    for step in 0..4_000 {
        let way = if step / 1_000 % 2 == 0 { 1.0 } else { -1.0 };
        plant.step(&(way * PlaneVector::new(2.0, 1.0, 0.0)), DT_S);
        most_rad = most_rad.sup(&(plant.shaft_rad() - before).abs());
    }
    let first = most_rad.rows(0, 4).max();
    assert!((0.4 * play_rad..1.6 * play_rad).contains(&first), "{most_rad}");
    assert!(plant.v_BH().norm() < 1e-3);
}

/// Kinetic energy and the angular momentum about the base, which no link can change where
/// everything turns about it: two invariants for a motion of two freedoms.
#[test]
fn heavy_links_coast_with_their_energy_and_angular_momentum() {
    let mut plant = heavy_cho([0.3, 0.1]);
    plant.v_BH = PlaneVector::new(-0.1, 0.4, 0.0);
    let momentum = |plant: &Plant| {
        let momentum = plant.posture.inertia * plant.v_BH();
        plant.p_BH().x * momentum.y - plant.p_BH().y * momentum.x
    };
    let (before_J, before) = (plant.kinetic_J(), momentum(&plant));
    let v_0 = *plant.v_BH();
    for step in 0..2_000 {
        plant.step(&PlaneVector::zeros(), DT_S);
        assert!((plant.kinetic_J() / before_J - 1.0).abs() < 1e-9, "{step}");
        let drift = momentum(&plant) / before - 1.0;
        assert!(drift.abs() < 5e-3, "{step}: {drift}");
    }
    let turned = (plant.v_BH() - v_0).norm() / v_0.norm();
    assert!(turned > 0.3, "the handle did not just go straight: {turned}");
    assert_eq!(plant.energy().dissipated_J, 0.0);
}

#[test]
fn the_books_never_owe_energy_over_random_forces_torques_and_places() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let mut slack = heavy_cho([0.3, 0.2]);
    slack.parameters.imperfections = Imperfections {
        hysteresis: ActuatorVector::repeat(0.1),
        backlash_rad: ActuatorVector::repeat(0.01),
    };
    for plant in [cho([0.3, 0.2]), heavy_cho([0.3, 0.2]), slack] {
        let mut plant = plant;
        plant.parameters.kinds[1] = ActuatorKind::Motor;
        plant.parameters.lag_s = ActuatorVector::repeat(2e-3);
        plant.parameters.residual_Nm = ActuatorVector::repeat(0.02);
        let mut dissipated_J = 0.0;
        for step in 0..40_000 {
            if step % 7 == 0 {
                let mut commands = brakes(std::array::from_fn(|_| rng.random_range(-2.0..6.0)));
                commands[1] = ActuatorCommand::Motor { torque_Nm: rng.random_range(-1.0..1.0) };
                plant.command(&commands);
            }
            plant.step(&random_force(&mut rng, 60.0), DT_S);
            let energy = *plant.energy();
            let left_J = energy.hand_J + energy.motors_J - energy.dissipated_J - plant.kinetic_J();
            assert!(left_J > -1e-9, "{step}: {left_J}");
            assert!(energy.dissipated_J >= dissipated_J);
            dissipated_J = energy.dissipated_J;
        }
        assert!(dissipated_J > 1.0);
    }
}

#[test]
fn a_hand_cannot_pull_the_handle_out_of_the_workspace() {
    let mut plant = cho([0.3, 0.2]);
    let (nearest_m, furthest_m) = plant.stops_m;
    for step in 0..40_000 {
        // Outwards, inwards, and round and round, with a lot of force.
        let out = plant.p_BH() / plant.p_BH().norm();
        let round = PlaneVector::new(-out.y, out.x, 0.0);
        let radial_N = if step / 10_000 % 2 == 0 { 30.0 } else { -30.0 };
        let lag_m_per_s = 0.5 - round.dot(plant.v_BH());
        plant.step(&(out * radial_N + round * (5.0 * lag_m_per_s)), DT_S);
        let r_m = plant.p_BH().norm();
        assert!((nearest_m - 1e-9..=furthest_m + 1e-9).contains(&r_m), "{step}: {r_m}");
        // No more than the work of that force over the whole workspace.
        assert!(plant.kinetic_J() < 17.0);
        if step % 10_000 == 9_999 {
            let stop_m = if radial_N > 0.0 { furthest_m } else { nearest_m };
            assert!((r_m - stop_m).abs() < 1e-5, "at the stop: {r_m}");
        }
    }
}

#[test]
fn a_start_beyond_the_stop_is_refused() {
    let mut parameters = cho([0.3, 0.2]).parameters;
    for (x, y) in [(0.0, 0.595), (1.0, 0.0), (0.001, 0.0), (f64::NAN, 0.3)] {
        assert!(Plant::new(parameters.clone(), &PlaneVector::new(x, y, 0.0)).is_err());
    }
    parameters.kinds = [ActuatorKind::Motor; MAX_ACTUATORS];
    assert!(Plant::new(parameters, &PlaneVector::new(0.2, 0.2, 9.0)).is_ok());
}

#[test]
fn shafts_keep_count_over_whole_turns_about_the_base() {
    let mut plant = cho([0.35, 0.0]);
    let start_rad = *plant.shaft_rad();
    let mechanism = plant.parameters.mechanism.clone();
    let turns = 3.0;
    let mut integral_rad = start_rad;
    for step in 0..24_000 {
        // A stiff spring drags the handle around in 4 s a turn.
        let angle_rad = (turns * TAU * step as f64 / 24_000.0_f64).min(turns * TAU);
        let target_m = PlaneVector::new(0.35 * angle_rad.cos(), 0.35 * angle_rad.sin(), 0.0);
        let F_N = 2_000.0 * (target_m - plant.p_BH()) - 60.0 * plant.v_BH();
        let R = plant.posture.reference;
        plant.step(&F_N, DT_S);
        let R_mean = 0.5 * (R + plant.posture.reference);
        integral_rad += DT_S * R_mean.tr_mul(plant.v_BH());
        if step % 100 == 0 {
            let back = mechanism.posture_from_shafts(plant.shaft_rad()).expect("a posture");
            assert!((back.p_BH.xy() - plant.p_BH().xy()).norm() < 1e-9);
            assert!(back.closure_rad.amax() < 1e-8);
        }
    }
    let apart_rad = (integral_rad - plant.shaft_rad()).amax();
    assert!(apart_rad < 1e-3, "{apart_rad}");
    for _ in 0..4_000 {
        let home_m = PlaneVector::new(0.35, 0.0, 0.0);
        let F_N = 2_000.0 * (home_m - plant.p_BH()) - 60.0 * plant.v_BH();
        plant.step(&F_N, DT_S);
    }
    // Straight tendons: every shaft turns with the linkage as a whole.
    for i in 0..4 {
        let turned_rad = plant.shaft_rad()[i] - start_rad[i];
        assert!((turned_rad - turns * TAU).abs() < 1e-6, "shaft {i}: {turned_rad}");
    }
}

#[test]
fn forces_that_are_no_numbers_do_nothing() {
    let mut plant = cho([0.3, 0.2]);
    let before = (*plant.p_BH(), *plant.shaft_rad());
    for F in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        plant.step(&PlaneVector::new(F, 1.0, 0.0), DT_S);
    }
    assert_eq!(*plant.p_BH(), before.0);
    assert!((plant.shaft_rad() - before.1).amax() < 1e-12);
    // A force that is one, but beyond all reason, ends at the stop or where it was.
    plant.step(&PlaneVector::new(1e300, -1e300, 0.0), DT_S);
    plant.step(&PlaneVector::zeros(), DT_S);
    assert!(plant.p_BH().iter().chain(plant.v_BH()).all(|x| x.is_finite()));
    assert!((plant.stops_m.0..=plant.stops_m.1 + 1e-9).contains(&plant.p_BH().norm()));
}
