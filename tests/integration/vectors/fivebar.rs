//! `fivebar.json`: kinematics, Jacobians, reference forces and rays of the coaxial five-bar.

use hapticd::mechanism::{FiveBar, FiveBarJacobians, FiveBarParameters, Inertia, Mechanism, Rays};
use hapticd::notation::PlaneVector;

use super::{Case, cases};

#[test]
fn every_fivebar_case_agrees() {
    for case in cases("fivebar") {
        check(&case);
    }
}

/// The linkage of a case.
pub(super) fn device(case: &Case) -> FiveBar {
    let parameters = FiveBarParameters {
        l_m: case.array("l"),
        k3: case.number("k3"),
        k4: case.number("k4"),
        lever: case.integer("s"),
        tendons: case.integer("c"),
        elbow: case.integer("e"),
        branch: case.integer("b"),
    };
    FiveBar::new(parameters, Inertia::default())
        .unwrap_or_else(|e| panic!("{}: {e}", case.place("l")))
}

fn check(case: &Case) {
    let device = device(case);
    let [x, y] = case.array("P");
    let posture = device.posture_at(&PlaneVector::new(x, y, 0.0));
    let posture = posture.unwrap_or_else(|e| panic!("{}: {e}", case.place("P")));
    case.expect("P", posture.p_BH.xy().as_slice());
    case.expect("phi", &device.link_angles_rad(&posture));
    assert_eq!(device.assembly(&posture), case.integer("assembly"), "{}", case.place("assembly"));

    let FiveBarJacobians { J, JG, JB } = device.jacobians(&posture);
    case.expect_matrix("J", &J);
    case.expect_matrix("JG", &JG);
    case.expect_matrix("JB", &JB);
    let R = posture.reference.fixed_view::<2, 4>(0, 0);
    case.expect_matrix("R", &R);
    let gram = (R * R.transpose()).try_inverse().expect("two independent rays");
    case.expect_matrix("Jr", &(gram * R));
    case.expect_rays(&Rays::of(&posture.reference, device.actuators()).expect("rays"));
    let [v_x, v_y] = case.array("v");
    let rates = posture.reference.tr_mul(&PlaneVector::new(v_x, v_y, 0.0));
    case.expect("brake_speed", &rates.as_slice()[..4]);

    let [phi1, phi2, ..] = case.array::<4>("phi");
    let forward = device.forward(phi1, phi2, case.integer("assembly"));
    let forward = forward.unwrap_or_else(|e| panic!("{}: {e}", case.place("assembly")));
    case.expect("P", forward.xy().as_slice());
    let from_shafts = device.posture_from_shafts(&posture.shaft_rad);
    let from_shafts = from_shafts.unwrap_or_else(|e| panic!("{}: {e}", case.place("phi")));
    case.expect("P", from_shafts.p_BH.xy().as_slice());
    case.expect_matrix("R", &from_shafts.reference.fixed_view::<2, 4>(0, 0));
}
