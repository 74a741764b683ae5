//! Tests of the coaxial five-bar: against finite differences, round trips, the paper's Figure 6,
//! and every kind of bad input.

use super::*;
use crate::mechanism::{LEAST_MARGIN, fixtures};
use nalgebra::Matrix4;
use proptest::{num::f64::ANY, prelude::*};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

const DESIGNS: usize = 2_000;
const STEP: f64 = 1e-6;

fn build(parameters: FiveBarParameters) -> FiveBar {
    FiveBar::new(parameters, Inertia::default()).expect("valid parameters")
}

/// Random designs in all sixteen modes, each at a regular posture.
fn random_postures(seed: u64, margin: f64, mut check: impl FnMut(&FiveBar, &Posture)) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut modes = std::collections::BTreeSet::new();
    for _ in 0..DESIGNS {
        let (device, p_BH) = fixtures::random_five_bar(&mut rng, margin);
        let signs = [device.lever, device.tendons, device.elbow, device.branch];
        modes.insert(signs.map(|sign| sign > 0.0));
        check(&device, &device.posture_at(&p_BH).expect("a regular posture"));
    }
    assert_eq!(modes.len(), 16, "not every working mode was met");
}

fn wrapped(angles: Vector4<f64>) -> Vector4<f64> {
    angles.map(wrap)
}

/// theta1 to theta4 as the shafts tell them: the paper's Eq 10-11 solved for the joints.
fn joints_of(device: &FiveBar, shaft_rad: &ActuatorVector) -> Vector4<f64> {
    let driven = |i: usize| device.ratios[i] * (shaft_rad[i + 2] - device.tendons * shaft_rad[i]);
    Vector4::new(shaft_rad[0], shaft_rad[1], driven(0), driven(1))
}

fn handle_change(change: PlaneVector) -> Vector2<f64> {
    change.xy() / (2.0 * STEP)
}

fn assert_near(actual: &[f64], numeric: &[f64], what: &str) {
    let scale = numeric.iter().fold(1.0_f64, |most, x| most.max(x.abs()));
    for (a, n) in actual.iter().zip(numeric) {
        assert!((a - n).abs() <= 1e-5 * scale, "{what}: {actual:?} is not {numeric:?}");
    }
}

#[test]
fn jacobians_equal_finite_differences_of_forward_kinematics() {
    random_postures(1, 0.1, |device, posture| {
        let (phi1, phi2) = (posture.shaft_rad[0], posture.shaft_rad[1]);
        let assembly = device.assembly(posture);
        let at = |d1: f64, d2: f64| {
            let p_BH = device.forward(phi1 + d1, phi2 + d2, assembly).expect("regular");
            let shaft_rad = device.posture_at(&p_BH).expect("regular").shaft_rad;
            (p_BH, joints_of(device, &shaft_rad))
        };
        let columns = [(STEP, 0.0), (0.0, STEP)].map(|(d1, d2)| (at(d1, d2), at(-d1, -d2)));
        let J = Matrix2::from_columns(&columns.map(|(a, b)| handle_change(a.0 - b.0)));
        let JG = Matrix4x2::from_columns(&columns.map(|(a, b)| wrapped(a.1 - b.1) / (2.0 * STEP)));
        let jacobians = device.jacobians(posture);
        assert_near(jacobians.J.as_slice(), J.as_slice(), "J");
        assert_near(jacobians.JG.as_slice(), JG.as_slice(), "JG");
        let mut coupling = Matrix4::identity();
        for i in 0..2 {
            coupling[(i + 2, i + 2)] = 1.0 / device.ratios[i];
            coupling[(i + 2, i)] = device.tendons;
        }
        assert_near(jacobians.JB.as_slice(), (coupling * JG).as_slice(), "JB");
    });
}

#[test]
fn power_at_the_handle_is_the_power_of_the_shafts() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    random_postures(3, 0.1, |device, posture| {
        let mut random = || rng.random_range(-1.0..1.0);
        let v = PlaneVector::new(random(), random(), 0.0);
        let torque_Nm = ActuatorVector::from_fn(|_, _| random());
        let joints = |h: f64| {
            let there = device.posture_at(&(posture.p_BH + h * v)).expect("regular");
            joints_of(device, &there.shaft_rad)
        };
        // Joint angles have no turns to lose; brake rates follow from theirs.
        let theta = wrapped(joints(STEP) - joints(-STEP)) / (2.0 * STEP);
        let rate = |i: usize| theta[i + 2] / device.ratios[i] + device.tendons * theta[i];
        let rates = [theta[0], theta[1], rate(0), rate(1)];
        let of_shafts: f64 = rates.iter().zip(&torque_Nm).map(|(w, tau)| w * tau).sum();
        let of_handle = (posture.reference * torque_Nm).dot(&v);
        let scale = posture.reference.amax().max(1.0);
        assert!((of_shafts - of_handle).abs() < 1e-5 * scale, "{of_shafts} {of_handle}");
    });
}

#[test]
fn the_reference_matrix_is_that_of_the_paper() {
    random_postures(4, 0.02, |device, posture| {
        let FiveBarJacobians { J, JB, .. } = device.jacobians(posture);
        let [l1, l2, l3, _, l5] = device.l_m;
        let phi = device.link_angles_rad(posture);
        let [theta3, theta4, at_D] = [phi[2] - phi[0], phi[3] - phi[1], phi[3] - phi[2]];
        let closed_form =
            l1 * l5 * l2 * theta3.sin() * theta4.sin() / (device.lever * l3 * at_D.sin());
        assert!((J.determinant() / closed_form - 1.0).abs() < 1e-9);
        let inverse = J.try_inverse().expect("regular");
        let paper = inverse.transpose() * JB.transpose();
        let ours = posture.reference.fixed_view::<2, 4>(0, 0);
        assert!((paper - ours).amax() < 1e-9 * ours.amax().max(1.0));
        assert_eq!(posture.reference.row(2).amax(), 0.0);
    });
}

#[test]
fn inverse_then_forward_is_the_same_posture_after_any_number_of_turns() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    random_postures(6, 0.02, |device, posture| {
        let [turns1, turns2] = [(); 2].map(|()| TAU * f64::from(rng.random_range(-3..=3)));
        let turns = [turns1, turns2, device.tendons * turns1, device.tendons * turns2, 0.0, 0.0];
        let given = posture.shaft_rad + ActuatorVector::from_column_slice(&turns);
        let back = device.posture_from_shafts(&given).expect("regular");
        assert!((back.p_BH.xy() - posture.p_BH.xy()).norm() < 1e-11);
        assert!((back.reference - posture.reference).amax() < 1e-9 * back.reference.amax());
        assert!((back.shaft_rad - given).amax() < 1e-9, "not continuous");
        assert!(back.closure_rad.amax() < 1e-9);
        let assembly = device.assembly(posture);
        let forward = device.forward(given[0], given[1], assembly).expect("regular");
        assert!((forward - posture.p_BH).xy().norm() < 1e-11);
    });
}

#[test]
fn closure_tells_how_far_a_redundant_encoder_is_off() {
    for parameters in fixtures::CHO {
        let device = build(parameters);
        let posture = device.posture_at(&PlaneVector::new(0.3, 0.1, 0.0)).expect("reachable");
        let mut given = posture.shaft_rad;
        given[2] += 0.01;
        given[3] -= 0.02;
        let off = device.posture_from_shafts(&given).expect("regular");
        let expected = ActuatorVector::from_column_slice(&[0.0, 0.0, 0.01, -0.02, 0.0, 0.0]);
        assert!((off.closure_rad - expected).amax() < 1e-12);
        assert!((off.shaft_rad - posture.shaft_rad).amax() < 1e-12);
        assert!((off.p_BH - posture.p_BH).amax() < 1e-12);
    }
}

#[test]
fn locking_brakes_in_turn_couples_the_joints_as_in_figure_6() {
    // Brake 4 to 45 deg with brake 2 locked, then brake 2 to 90 deg with brake 4 locked.
    let device = build(FiveBarParameters { k4: 1.0, ..fixtures::CHO[1] });
    let [mut brake2, mut brake4] = [0.0, FRAC_PI_4];
    for expected_theta4 in [FRAC_PI_4, -FRAC_PI_4] {
        let (phi2, phi4) = (brake2, brake2 + expected_theta4);
        // Equal links make a parallelogram O, C, D, E; the lever points away from the handle.
        let (phi1, phi3) = (phi4, phi2 + PI);
        let brake3 = wrap(phi3 - phi1) / 0.1 + phi1;
        let shafts = [phi1, brake2, brake3, brake4, 0.0, 0.0];
        let posture = device.posture_from_shafts(&ActuatorVector::from_column_slice(&shafts));
        let posture = posture.expect("regular");
        assert!(posture.closure_rad.amax() < 1e-9, "{}", posture.closure_rad);
        let theta4 = joints_of(&device, &posture.shaft_rad)[3];
        assert!((theta4 - expected_theta4).abs() < 1e-12);
        let phi = device.link_angles_rad(&posture);
        assert!((wrap(phi[3] - phi[1]) - expected_theta4).abs() < 1e-12);
        (brake2, brake4) = (FRAC_PI_2, FRAC_PI_4);
    }
}

#[test]
fn reach_is_where_a_scan_finds_postures() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for _ in 0..100 {
        let (device, _) = fixtures::random_five_bar(&mut rng, 0.02);
        let (least_m, most_m) = device.reach_m();
        let unreachable = |r_m: f64| {
            let answer = device.posture_at(&PlaneVector::new(0.0, r_m, 0.0));
            matches!(answer, Err(KinematicsError::Unreachable { .. }))
        };
        for i in 0..=1000 {
            let r_m = 1.1e-3 * f64::from(i);
            if (r_m - least_m).abs() > 1e-6 && (r_m - most_m).abs() > 1e-6 {
                let inside = (least_m..=most_m).contains(&r_m);
                assert_eq!(unreachable(r_m), !inside, "{r_m}: {least_m} to {most_m}");
            }
        }
    }
}

#[test]
fn the_outline_joins_the_links_at_their_lengths() {
    random_postures(8, 0.02, |device, posture| {
        let mut outline = Default::default();
        assert_eq!(device.outline(posture, &mut outline), 5);
        let [OE, EP, ED, OC, CD] = [0, 1, 2, 3, 4].map(|i| outline[i]);
        assert_eq!((OE.1, EP.0, OC.1, ED.1), (EP.0, ED.0, CD.0, CD.1));
        let [l1, l2, l3, l4, l5] = device.l_m;
        for ((from, to), length_m) in [(OE, l1), (EP, l5), (ED, l3), (OC, l2), (CD, l4)] {
            let drawn_m = (Vector2::from(to) - Vector2::from(from)).norm();
            assert!((drawn_m - length_m).abs() < 1e-12);
        }
    });
}

#[test]
fn bad_parameters_are_refused_by_name_value_and_range() {
    let base = fixtures::CHO[0];
    let refusal = |parameters| {
        FiveBar::new(parameters, Inertia::default()).expect_err("not a linkage").to_string()
    };
    let with_l3 = |l3| FiveBarParameters { l_m: [0.3, 0.2, l3, 0.291, 0.3], ..base };
    assert_eq!(refusal(with_l3(-0.1)), "l_m[2] = -0.1: allowed is 0.001 to 10 m");
    assert_eq!(refusal(with_l3(f64::NAN)), "l_m[2] = NaN: allowed is 0.001 to 10 m");
    assert_eq!(
        refusal(with_l3(0.9)),
        "l_m[2] = 0.9 m cannot close: less than 0.7910 m, the other links together"
    );
    let k4 = FiveBarParameters { k4: 0.0, ..base };
    assert_eq!(refusal(k4), "k4 = 0: allowed is 0.001 to 100 rad/rad");
    let lever = FiveBarParameters { lever: 0, ..base };
    assert_eq!(refusal(lever), "lever = 0: allowed is -1 or +1");
}

#[test]
fn lengths_that_close_nowhere_are_exactly_those_refused() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    for _ in 0..300 {
        let l_m: [f64; 5] = std::array::from_fn(|_| rng.random_range(0.02..0.5));
        // OD runs over [|l1 - l3|, l1 + l3]: scan it for a triangle with links 2 and 4.
        let closes = (0..=2000).any(|i| {
            let OD_m = (l_m[0] - l_m[2]).abs() + 2.0 * l_m[0].min(l_m[2]) * f64::from(i) / 2000.0;
            (l_m[1] - l_m[3]).abs() < OD_m && OD_m < l_m[1] + l_m[3]
        });
        let built = FiveBar::new(FiveBarParameters { l_m, ..fixtures::CHO[0] }, Inertia::default());
        assert_eq!(built.is_ok(), closes, "{l_m:?}");
    }
}

#[test]
fn singular_and_unreachable_places_are_typed_errors() {
    let device = build(fixtures::CHO[0]);
    for r_m in [0.61, 1e9, 1e200, f64::MAX] {
        let answer = device.posture_at(&PlaneVector::new(r_m, -r_m, 0.0));
        assert!(matches!(answer, Err(KinematicsError::Unreachable { .. })), "{answer:?}");
    }
    let folded = device.posture_at(&PlaneVector::zeros());
    assert!(matches!(folded, Err(KinematicsError::Singular { margin: 0.0, .. })), "{folded:?}");
    let (_, edge_m) = device.reach_m();
    let edge = device.posture_at(&PlaneVector::new(edge_m, 0.0, 0.0));
    assert!(matches!(edge, Err(KinematicsError::Singular { .. })), "{edge:?}");
    let apart = device.forward(0.0, PI, 1);
    assert!(matches!(apart, Err(KinematicsError::Unreachable { .. })), "{apart:?}");
    // E on C: the lever may point anywhere.
    let equal = build(fixtures::CHO[1]);
    let together = equal.forward(0.7, 0.7, 1);
    assert!(matches!(together, Err(KinematicsError::Singular { .. })), "{together:?}");
    let nowhere = device.posture_from_shafts(&ActuatorVector::repeat(f64::INFINITY));
    assert_eq!(nowhere, Err(KinematicsError::NotFinite));
}

#[test]
fn reference_forces_stay_bounded_up_to_the_edge_of_the_workspace() {
    let device = build(fixtures::CHO[1]);
    let (_, edge_m) = device.reach_m();
    let mut largest = 0.0_f64;
    for i in 0..200 {
        let inside_m = edge_m * (1.0 - 0.9_f64.powi(i));
        if let Ok(posture) = device.posture_at(&PlaneVector::new(inside_m, 0.0, 0.0)) {
            largest = largest.max(posture.reference.amax());
        }
    }
    assert!(largest > 100.0 && largest < 1e3 / LEAST_MARGIN, "{largest}");
}

fn all_finite(posture: &Posture) -> bool {
    let angles = posture.shaft_rad.iter().chain(&posture.closure_rad);
    let matrices = posture.reference.iter().chain(&posture.inertia);
    posture.p_BH.iter().chain(angles).chain(matrices).all(|x| x.is_finite())
}

proptest! {
    #[test]
    fn no_input_makes_nan(
        x in prop_oneof![ANY, -0.7..0.7], y in prop_oneof![ANY, -0.7..0.7],
        base in proptest::array::uniform2(prop_oneof![ANY, -7.0..7.0]),
        driven in proptest::array::uniform2(prop_oneof![ANY, -90.0..90.0]),
        l_m in proptest::array::uniform5(prop_oneof![Just(1e-3), Just(10.0), 0.01..1.0]),
        k in proptest::array::uniform2(prop_oneof![Just(1e-3), Just(100.0), 0.1..2.0]),
        assembly: i32,
    ) {
        let parameters = FiveBarParameters { l_m, k3: k[0], k4: k[1], ..fixtures::CHO[0] };
        if let Ok(device) = FiveBar::new(parameters, Inertia::default()) {
            let shafts = [base[0], base[1], driven[0], driven[1], f64::NAN, f64::NAN];
            let answers = [
                device.posture_at(&PlaneVector::new(x, y, f64::NAN)),
                device.posture_from_shafts(&ActuatorVector::from_column_slice(&shafts)),
            ];
            for posture in answers.into_iter().flatten() {
                prop_assert!(all_finite(&posture), "{posture:?}");
                prop_assert!(device.jacobians(&posture).J.iter().all(|x| x.is_finite()));
            }
            if let Ok(p_BH) = device.forward(base[0], base[1], assembly) {
                prop_assert!(p_BH.iter().all(|x| x.is_finite()));
            }
            let (least_m, most_m) = device.reach_m();
            prop_assert!(least_m.is_finite() && most_m.is_finite() && least_m <= most_m);
        }
    }
}
