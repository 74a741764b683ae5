//! The 3-RRR against its geometry, finite differences, brute force and the paper's claims.

use proptest::{num::f64::ANY, prelude::*};
use std::f64::consts::TAU;

use super::*;
use crate::mechanism::LinkInertia;

const KIM: ThreeRrrParameters =
    ThreeRrrParameters { base_m: 0.2, l_m: [0.1; 3], turn_rad: 0.5, elbows: [1, 1, 1] };

fn device(parameters: ThreeRrrParameters) -> ThreeRrr {
    ThreeRrr::new(parameters, Inertia::default()).expect("valid parameters")
}

prop_compose! {
    fn any_parameters()(
        base_m in 0.12..0.3_f64, l1 in 0.08..0.2_f64, l2 in 0.08..0.2_f64, l3 in 0.04..0.15_f64,
        turn_rad in 0.05..1.0_f64, signs in prop::array::uniform3(any::<bool>()),
    ) -> ThreeRrrParameters {
        let elbows = signs.map(|up| if up { 1 } else { -1 });
        ThreeRrrParameters { base_m, l_m: [l1, l2, l3], turn_rad, elbows }
    }
}

/// A pose within the reach, from three shares.
fn pose(device: &ThreeRrr, [radius, bearing, turn]: [f64; 3]) -> PlaneVector {
    let (nearest_m, furthest_m) = device.reach_m();
    let p_m = (nearest_m + radius * (furthest_m - nearest_m)) * direction(TAU * bearing);
    PlaneVector::new(p_m.x, p_m.y, (2.0 * turn - 1.0) * device.turn_rad())
}

#[test]
fn the_reach_of_the_papers_device_is_a_disc_about_the_centre() {
    let (nearest_m, furthest_m) = device(KIM).reach_m();
    let d_m = (0.05 - 0.04 * f64::cos(0.5)).sqrt();
    assert_eq!(nearest_m, 0.0);
    assert!((furthest_m - (0.2 - d_m)).abs() < 1e-12, "{furthest_m}");
    let centre = device(KIM).posture_at(&PlaneVector::zeros()).expect("regular");
    // Every chain spans 0.1 m with two links of 0.1 m.
    assert!((centre.margin - (2.0 * TAU / 6.0).sin()).abs() < 1e-12);
    for i in 0..3 {
        assert!((centre.shaft_rad[2 * i + 1] - 2.0 * TAU / 6.0).abs() < 1e-12);
    }
}

#[test]
fn a_turn_that_leaves_nothing_and_what_is_out_of_range_are_refused_by_name() {
    let said = |parameters| {
        ThreeRrr::new(parameters, Inertia::default()).map(drop).unwrap_err().to_string()
    };
    assert!(said(ThreeRrrParameters { turn_rad: 1.6, ..KIM }).starts_with("turn_rad = 1.6"));
    assert_eq!(
        said(ThreeRrrParameters { base_m: -0.2, ..KIM }),
        "base_m = -0.2: allowed is 0.001 to 10 m"
    );
    let bent = ThreeRrrParameters { elbows: [1, 0, 1], ..KIM };
    assert_eq!(said(bent), "elbow2 = 0: allowed is -1 or +1");
}

#[test]
fn six_actuators_stay_far_from_singular_where_three_do_not() {
    // One elbow against the others brings the base alone to singular postures.
    let device = device(ThreeRrrParameters { elbows: [1, -1, 1], ..KIM });
    let (mut three, mut six) = (0.0_f64, 0.0_f64);
    for step in 0..2_000 {
        let share = |k: f64| (f64::from(step) * k).fract();
        let Ok(posture) =
            device.posture_at(&pose(&device, [share(0.618), share(0.414), share(0.732)]))
        else {
            panic!("regular within the reach")
        };
        let condition = |columns: &[usize]| {
            // Moments on 0.1 m, so that every row has one unit.
            let R = posture.reference.select_columns(columns);
            let scaled = nalgebra::DMatrix::from_fn(3, columns.len(), |i, j| {
                if i == 2 { R[(i, j)] / 0.1 } else { R[(i, j)] }
            });
            let sigma = scaled.singular_values();
            sigma.max() / sigma.min()
        };
        three = three.max(condition(&[0, 2, 4]));
        six = six.max(condition(&[0, 1, 2, 3, 4, 5]));
    }
    assert!(six < 25.0 && three > 10.0 * six, "{six} {three}");
}

/// Velocities by differences of the drawn outline: no Jacobian takes part.
#[test]
fn kinetic_energy_at_the_plate_is_that_of_the_parts() {
    const STEP_S: f64 = 1e-6;
    let link = |i: usize| LinkInertia {
        mass_kg: 0.1 + 0.03 * i as f64,
        centre_m: 0.03 + 0.01 * i as f64,
        inertia_kg_m2: 1e-4 * (1.0 + i as f64),
    };
    let mut shaft_inertia_kg_m2 = ActuatorVector::zeros();
    shaft_inertia_kg_m2.iter_mut().enumerate().for_each(|(i, j)| *j = 1e-5 * (1.0 + i as f64));
    let inertia = Inertia {
        handle_mass_kg: 0.3,
        handle_inertia_kg_m2: 2e-3,
        links: std::array::from_fn(link),
        shaft_inertia_kg_m2,
    };
    let device = ThreeRrr::new(KIM, inertia).expect("valid");
    for (p, v) in [
        (PlaneVector::new(0.02, 0.01, 0.2), PlaneVector::new(0.2, -0.1, 1.0)),
        (PlaneVector::new(-0.03, 0.02, -0.3), PlaneVector::new(0.0, 0.3, -2.0)),
    ] {
        let snapshot = |t_s: f64| {
            let posture = device.posture_at(&(p + t_s * v)).expect("regular");
            let mut outline = Outline::default();
            device.outline(&posture, &mut outline);
            (posture.shaft_rad, outline)
        };
        let ((shafts_0, before), (shafts_1, after)) = (snapshot(-STEP_S), snapshot(STEP_S));
        let rate = |change: f64| change / (2.0 * STEP_S);
        let mut energy_J = 0.15 * v.xy().norm_squared() + 1e-3 * v.z * v.z;
        for (i, link) in inertia.links.iter().enumerate() {
            let segment = 3 * (i / 2) + i % 2;
            let place = |(from, to): ([f64; 2], [f64; 2])| {
                let (from, to) = (Vector2::from(from), Vector2::from(to));
                let along = (to - from).normalize();
                (from + link.centre_m * along, along)
            };
            let ((c_0, u_0), (c_1, u_1)) = (place(before[segment]), place(after[segment]));
            energy_J += 0.5 * link.mass_kg * rate((c_1 - c_0).norm()).powi(2)
                + 0.5 * link.inertia_kg_m2 * rate(cross(u_0, u_1).asin()).powi(2);
            let turn_rad = shafts_1[i] - shafts_0[i];
            energy_J += 0.5 * shaft_inertia_kg_m2[i] * rate(turn_rad).powi(2);
        }
        let M = device.posture_at(&p).expect("regular").inertia;
        let of_matrix_J = 0.5 * v.dot(&(M * v));
        assert!((of_matrix_J / energy_J - 1.0).abs() < 1e-6, "{of_matrix_J} {energy_J}");
        assert!(M.cholesky().is_some());
    }
}

proptest! {
    #[test]
    fn the_whole_reach_is_reachable_at_every_bearing_and_turn_and_no_more(
        parameters in any_parameters(),
    ) {
        let Ok(device) = ThreeRrr::new(parameters, Inertia::default()) else { return Ok(()) };
        let [l1, l2, _] = parameters.l_m;
        let (nearest_m, furthest_m) = device.reach_m();
        let unreachable = |r_m: f64| {
            let mut found = false;
            for ray in 0..72 {
                for turn in -8..=8 {
                    let p_m = r_m * direction(TAU * f64::from(ray) / 72.0);
                    let phi_rad = parameters.turn_rad * f64::from(turn) / 8.0;
                    let posture = device.posture_at(&PlaneVector::new(p_m.x, p_m.y, phi_rad));
                    found |= matches!(posture, Err(KinematicsError::Unreachable { .. }));
                }
            }
            found
        };
        for share in [0.001, 0.3, 0.7, 0.999] {
            prop_assert!(!unreachable(nearest_m + share * (furthest_m - nearest_m)));
        }
        // Bearings are 5 degrees apart: a span is off by less than a percent of the lengths.
        let coarse_m = 0.01 * (parameters.base_m + l1 + l2);
        let folds = (l1 - l2).abs() < 2.0 * coarse_m;
        prop_assert!(folds || unreachable(furthest_m + coarse_m));
        prop_assert!(folds || nearest_m == 0.0 || unreachable(nearest_m - coarse_m));
    }

    #[test]
    fn reference_forces_equal_finite_differences_and_the_papers_matrices(
        parameters in any_parameters(), shares in prop::array::uniform3(0.05..0.95_f64),
    ) {
        const STEP: f64 = 1e-6;
        let Ok(device) = ThreeRrr::new(parameters, Inertia::default()) else { return Ok(()) };
        let p = pose(&device, shares);
        let Ok(posture) = device.posture_at(&p) else { return Ok(()) };
        prop_assume!(posture.margin > 0.1);
        for axis in 0..3 {
            let mut step = PlaneVector::zeros();
            step[axis] = STEP;
            let (ahead, behind) = (device.posture_at(&(p + step))?, device.posture_at(&(p - step))?);
            let numeric = (ahead.shaft_rad - behind.shaft_rad).map(wrap) / (2.0 * STEP);
            let exact = posture.reference.row(axis).transpose();
            prop_assert!((numeric - exact).norm() < 1e-4 * exact.norm().max(1.0));
        }
        let found = device.jacobians(&posture);
        let R = posture.reference;
        prop_assert!((found.Gu_A.transpose() - R).norm() < 1e-9 * R.norm());
        let regular = found.A.singular_values().min() > 1e-3;
        if let (Some(of_base), true) = (found.A.try_inverse().map(|inverse| inverse * found.B), regular) {
            // u = 1G [a1'; d1'; d2'] must be what the base joints alone give.
            for base in 0..3 {
                let first = if base == 0 { 1.0 } else { 0.0 };
                let joints = Vector3::new(first, of_base[(0, base)], of_base[(1, base)]);
                let twist = found.iG_phi[0] * joints;
                let direct = found.Ga_u.expect("regular").column(base).into_owned();
                prop_assert!((twist - direct).norm() < 1e-8 * direct.norm().max(1.0));
            }
        }
    }

    #[test]
    fn shafts_lead_back_and_a_disagreement_is_found_where_it_is(
        parameters in any_parameters(), shares in prop::array::uniform3(0.05..0.95_f64),
        turns in prop::array::uniform6(-2..3_i32), error in prop::array::uniform6(-1e-4..1e-4_f64),
    ) {
        let Ok(device) = ThreeRrr::new(parameters, Inertia::default()) else { return Ok(()) };
        let p = pose(&device, shares);
        let Ok(there) = device.posture_at(&p) else { return Ok(()) };
        prop_assume!(there.margin > 0.1);
        let turned_rad = there.shaft_rad + ActuatorVector::from(turns.map(|n| TAU * f64::from(n)));
        let back = device.posture_from_shafts(&turned_rad)?;
        prop_assert!((back.p_BH - there.p_BH).norm() < 1e-12 && back.closure_rad.norm() < 1e-9);
        prop_assert!((back.shaft_rad - turned_rad).norm() < 1e-9);
        let error = ActuatorVector::from(error);
        let off = device.posture_from_shafts(&(turned_rad + error))?;
        // The fit is orthogonal in the plate's joints: it moves them no further than the errors.
        let [l1, l2, _] = parameters.l_m;
        prop_assert!((off.p_BH - there.p_BH).xy().norm() < (2.0 * l1 + l2) * 3e-4);
        prop_assert!((off.shaft_rad + off.closure_rad - turned_rad - error).norm() < 1e-12);
        let exact = device.posture_at(&off.p_BH)?;
        prop_assert!((exact.shaft_rad - off.shaft_rad).map(wrap).norm() < 1e-9);
    }

    #[test]
    fn the_fit_is_the_nearest_of_all_poses(
        noise in prop::array::uniform6(-5e-3..5e-3_f64), step in prop::array::uniform3(-1e-3..1e-3_f64),
    ) {
        let device = device(KIM);
        let given_m = [0, 1, 2].map(|i| {
            device.plate_joint_m(Vector2::new(0.01, 0.02), 0.2, i)
                + Vector2::new(noise[2 * i], noise[2 * i + 1])
        });
        let misfit = |p_m: Vector2<f64>, phi_rad: f64| -> f64 {
            (0..3).map(|i| (device.plate_joint_m(p_m, phi_rad, i) - given_m[i]).norm_squared()).sum()
        };
        let (p_m, phi_rad) = device.fitted(given_m)?;
        let elsewhere = misfit(p_m + Vector2::new(step[0], step[1]), phi_rad + 10.0 * step[2]);
        prop_assert!(misfit(p_m, phi_rad) <= elsewhere + 1e-15);
    }

    #[test]
    fn no_input_makes_nan(a in prop::array::uniform6(ANY), small in prop::array::uniform6(-4.0..4.0_f64)) {
        let device = device(KIM);
        let answers = [
            device.posture_at(&PlaneVector::new(a[0], a[1], a[2])),
            device.posture_from_shafts(&ActuatorVector::from(a)),
            device.posture_from_shafts(&ActuatorVector::from(small)),
        ];
        for posture in answers.into_iter().flatten() {
            prop_assert!(posture.p_BH.iter().chain(&posture.reference).all(|x| x.is_finite()));
            prop_assert!(posture.inertia.cholesky().is_some());
        }
    }
}
