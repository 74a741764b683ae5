//! The symmetric five-bar against its geometry, finite differences, brute force and the paper.

use proptest::{num::f64::ANY, prelude::*};
use std::f64::consts::TAU;

use super::*;

const SINGH: SymmetricFiveBarParameters =
    SymmetricFiveBarParameters { a1_m: 0.10, a2_m: 0.15, a3_m: 0.03, s1: 1, s2: -1, assembly: 1 };

fn device(parameters: SymmetricFiveBarParameters) -> SymmetricFiveBar {
    SymmetricFiveBar::new(parameters, Inertia::default()).expect("valid parameters")
}

fn at(x: f64, y: f64) -> PlaneVector {
    PlaneVector::new(x, y, 0.0)
}

#[test]
fn the_circle_of_the_optimum_is_inscribed_where_it_is_mended_and_not_where_it_is_printed() {
    let device = device(SINGH);
    let circle = device.inscribed_circle();
    let [mended_m, printed_m] =
        [circle.y_m, circle.y_as_printed_m].map(|y_m| y_m.expect("close pivots"));
    assert!((mended_m - 0.1470).abs() < 5e-5 && (printed_m - 0.0989).abs() < 5e-5);
    let all_reachable = |y_m: f64, radius_m: f64| {
        (0..720).all(|step| {
            let rim_m = radius_m * direction(TAU * f64::from(step) / 720.0);
            let posture = device.posture_at(&at(rim_m.x, y_m + rim_m.y));
            !matches!(posture, Err(KinematicsError::Unreachable { .. }))
        })
    };
    assert!(all_reachable(mended_m, circle.radius_m * (1.0 - 1e-9)));
    assert!(!all_reachable(mended_m, circle.radius_m * 1.01));
    assert!(!all_reachable(printed_m, circle.radius_m * 0.99));
}

#[test]
fn the_papers_working_mode_is_regular_in_the_whole_ring_and_shafts_lead_back() {
    let device = device(SINGH);
    let (nearest_m, furthest_m) = device.reach_m();
    assert!((nearest_m - 0.08).abs() < 1e-12 && (furthest_m - 0.22).abs() < 1e-12);
    for ring in 1..40 {
        for ray in 0..180 {
            let r_m = nearest_m + (furthest_m - nearest_m) * f64::from(ring) / 40.0;
            let p_m = r_m * direction(TAU * f64::from(ray) / 180.0);
            let there = device.posture_at(&at(p_m.x, p_m.y)).expect("regular");
            assert_eq!(device.assembly(&there), 1);
            let back = device.posture_from_shafts(&there.shaft_rad).expect("regular");
            assert!((back.p_BH - there.p_BH).norm() < 1e-9, "{p_m}");
        }
    }
}

#[test]
fn where_both_sides_are_in_the_working_mode_the_assembly_chooses() {
    // Below the base and near it the paper's device still bends both elbows outwards.
    let [up, down] =
        [1, -1].map(|assembly| device(SymmetricFiveBarParameters { assembly, ..SINGH }));
    let low = up.posture_at(&at(0.0, -0.046)).expect("regular");
    assert_eq!(up.assembly(&low), -1);
    let back = down.posture_from_shafts(&low.shaft_rad).expect("regular");
    assert!((back.p_BH - low.p_BH).norm() < 1e-9);
    let other = up.posture_from_shafts(&low.shaft_rad).expect("regular");
    assert!(other.p_BH.y > 0.1 && up.assembly(&other) == 1);
}

#[test]
fn forces_along_the_needle_need_the_torques_of_the_sizing() {
    let device = device(SINGH);
    let most = (100..=200).map(|mm| {
        let posture = device.posture_at(&at(0.0, 1e-3 * f64::from(mm))).expect("reachable");
        let R = posture.reference.fixed_view::<2, 2>(0, 0).into_owned();
        let tau_Nm = R.try_inverse().expect("regular") * Vector2::new(0.0, 12.0);
        assert!((tau_Nm.x + tau_Nm.y).abs() < 1e-9, "the mirror image of each other");
        tau_Nm.amax()
    });
    let (least, most) = most.fold((f64::MAX, 0.0), |(a, b), t: f64| (t.min(a), t.max(b)));
    assert!((least - 0.72).abs() < 0.01 && (most - 0.89).abs() < 0.01, "{least} {most}");
}

#[test]
fn parameters_out_of_range_are_refused_by_name() {
    let said = |parameters| {
        SymmetricFiveBar::new(parameters, Inertia::default()).map(drop).unwrap_err().to_string()
    };
    let wide = SymmetricFiveBarParameters { a3_m: 0.25, ..SINGH };
    assert!(said(wide).starts_with("a3_m = 0.25 m cannot close: less than 0.2500 m"));
    assert_eq!(
        said(SymmetricFiveBarParameters { a1_m: f64::NAN, ..SINGH }),
        "a1_m = NaN: allowed is 0.001 to 10 m"
    );
    let sign = SymmetricFiveBarParameters { s2: 2, ..SINGH };
    assert_eq!(said(sign), "s2 = 2: allowed is -1 or +1");
}

prop_compose! {
    fn any_device()(
        a1_m in 0.05..0.5_f64, a2_m in 0.05..0.5_f64, share in 0.01..0.99_f64,
        s1 in prop::sample::select(vec![-1, 1]), s2 in prop::sample::select(vec![-1, 1]),
        assembly in prop::sample::select(vec![-1, 1]),
    ) -> SymmetricFiveBar {
        let a3_m = share * (a1_m + a2_m);
        device(SymmetricFiveBarParameters { a1_m, a2_m, a3_m, s1, s2, assembly })
    }
}

fn reachable(device: &SymmetricFiveBar, p_m: Vector2<f64>) -> bool {
    !matches!(device.posture_at(&at(p_m.x, p_m.y)), Err(KinematicsError::Unreachable { .. }))
}

proptest! {
    #[test]
    fn every_bearing_of_the_reach_is_reachable_and_not_every_one_beyond(device in any_device()) {
        let ([a1, a2], a3) = (device.leg_m, device.a3_m);
        let whole = |r_m: f64| (0..360).all(|ray| {
            reachable(&device, r_m * direction(TAU * f64::from(ray) / 360.0))
        });
        let rings: Vec<_> = (0..200)
            .map(|i| (a1 + a2 + a3) * (f64::from(i) + 0.5) / 200.0)
            .filter(|&r_m| whole(r_m))
            .collect();
        let (nearest_m, furthest_m) = device.reach_m();
        let step_m = (a1 + a2 + a3) / 200.0;
        let inside = |r_m: f64| (nearest_m..=furthest_m).contains(&r_m);
        if rings.is_empty() {
            // No whole ring wider than the brute force resolves.
            let axis = |r_m: f64| reachable(&device, Vector2::new(0.0, r_m));
            let middle_m = 0.5 * (nearest_m + furthest_m);
            prop_assert!(furthest_m > nearest_m && axis(middle_m));
            prop_assert!(!axis(furthest_m + step_m) || furthest_m - nearest_m < 2.0 * step_m);
            return Ok(());
        }
        let found = rings.iter().filter(|&&r_m| inside(r_m)).count();
        let expected = (furthest_m - nearest_m) / step_m;
        prop_assert!((found as f64 - expected).abs() <= 2.0, "{found} {expected}");
        // Whole rings beyond the one that was given are the other, narrower region.
        prop_assert!(rings.len() <= 2 * found + 3, "{} {found}", rings.len());
    }

    #[test]
    fn reference_forces_equal_finite_differences_and_the_duality_of_the_jacobians(
        device in any_device(), theta in prop::array::uniform2(-9.0..9.0_f64), side in any::<bool>(),
    ) {
        const STEP: f64 = 1e-6;
        let side = if side { 1 } else { -1 };
        let at = |a: f64, b: f64| device.forward([theta[0] + a, theta[1] + b], side);
        let Ok(here) = at(0.0, 0.0) else { return Ok(()) };
        let shaft_rad = ActuatorVector::from_fn(|i, _| if i < 2 { theta[i] } else { 0.0 });
        let Ok(posture) = device.posture_from_shafts(&shaft_rad) else { return Ok(()) };
        let near = (posture.p_BH - here).norm() < 1e-9;
        let SymmetricFiveBarJacobians { J_p, J_theta, J } = device.jacobians(&posture);
        let scaled = J_p.determinant().abs() / device.leg_m[1].powi(2);
        prop_assume!(near && scaled > 0.1 && J_theta.amin() > 0.1 * device.leg_m[0] * device.leg_m[1]);
        let slope = |a: f64, b: f64| (at(a, b).unwrap() - at(-a, -b).unwrap()).xy() / (2.0 * STEP);
        let numeric = Matrix2::from_columns(&[slope(STEP, 0.0), slope(0.0, STEP)]);
        let R = posture.reference.fixed_view::<2, 2>(0, 0).into_owned();
        prop_assert!((numeric.transpose() * R - Matrix2::identity()).norm() < 1e-6);
        prop_assert!((J.transpose() - R).norm() < 1e-9 * R.norm());
    }

    #[test]
    fn the_legs_end_in_the_handle_and_bend_as_the_mode_says(
        device in any_device(), s in 0.02..0.98_f64, bearing_rad in -3.2..3.2_f64,
    ) {
        let (nearest_m, furthest_m) = device.reach_m();
        let p_m = (nearest_m + s * (furthest_m - nearest_m)) * direction(bearing_rad);
        let Ok(posture) = device.posture_at(&at(p_m.x, p_m.y)) else { return Ok(()) };
        prop_assert!((posture.p_BH.xy() - p_m).norm() < 1e-12);
        for (i, BC_m) in device.distal_m(&posture).into_iter().enumerate() {
            prop_assert!((BC_m.norm() - device.leg_m[1]).abs() < 1e-12);
            let bend = cross(direction(posture.shaft_rad[i]), BC_m);
            prop_assert!(device.elbows[i] * bend < 0.0);
        }
        let side = device.assembly(&posture);
        let back = device.forward([posture.shaft_rad[0], posture.shaft_rad[1]], side)?;
        prop_assert!((back - posture.p_BH).norm() < 1e-7);
        let mut outline = Default::default();
        prop_assert_eq!(device.outline(&posture, &mut outline), 4);
    }

    #[test]
    fn no_input_makes_nan(device in any_device(), a in ANY, b in ANY) {
        let shaft_rad = ActuatorVector::from_fn(|i, _| [a, b, f64::NAN][i.min(2)]);
        let answers = [device.posture_at(&at(a, b)), device.posture_from_shafts(&shaft_rad)];
        for posture in answers.into_iter().flatten() {
            prop_assert!(posture.p_BH.iter().chain(&posture.reference).all(|x| x.is_finite()));
            prop_assert!(posture.shaft_rad.iter().all(|x| x.is_finite()));
        }
    }
}
