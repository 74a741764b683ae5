//! `sym5bar.json`: kinematics, Jacobians and inscribed circle of the symmetric five-bar.
//!
//! The file is in any length unit; a device has metres, so every case is scaled to driven
//! links of 0.1 m and its results back.

use hapticd::mechanism::{Inertia, Mechanism, SymmetricFiveBar, SymmetricFiveBarParameters};
use hapticd::notation::PlaneVector;
use std::f64::consts::TAU;

use super::{Case, cases};

#[test]
fn every_sym5bar_case_agrees() {
    for case in cases("sym5bar") {
        check(&case);
    }
}

fn check(case: &Case) {
    let per_unit = 0.1 / case.number("a1");
    let device = device(case, per_unit);
    let [x, y] = [case.number("x"), case.number("y")];
    let posture = device.posture_at(&PlaneVector::new(x * per_unit, y * per_unit, 0.0));
    let posture = posture.unwrap_or_else(|e| panic!("{}: {e}", case.place("x")));

    // The file's angles are sums of two principal values, whole turns included.
    let theta: [f64; 2] = case.array("theta");
    let turned = |i: usize| {
        let ours = posture.shaft_rad[i];
        ours + TAU * ((theta[i] - ours) / TAU).round()
    };
    case.expect("theta", &[turned(0), turned(1)]);

    let found = device.jacobians(&posture);
    case.expect_matrix("Jp", &(found.J_p / per_unit));
    case.expect_matrix("Jtheta", &(found.J_theta / (per_unit * per_unit)));
    case.expect_matrix("J", &(found.J * per_unit));
    let R = posture.reference.fixed_view::<2, 2>(0, 0) * per_unit;
    case.expect_matrix("J", &R.transpose());
    let sigma = found.J.singular_values();
    let K = sigma.max() / sigma.min();
    case.expect("K", &[K]);
    let class = [5.0, 10.0].iter().filter(|&&least| K >= least).count() + usize::from(K > 100.0);
    case.expect("K_class", &[class as f64]);

    for (field, side) in [("fk_plus", 1), ("fk_minus", -1)] {
        let forward = device.forward(theta, side);
        let forward = forward.unwrap_or_else(|e| panic!("{}: {e}", case.place(field)));
        case.expect(field, &[forward.x / per_unit, forward.y / per_unit]);
    }
    let side = device.assembly(&posture);
    assert_eq!(side, case.integer("fk_sign"), "{}", case.place("fk_sign"));

    let circle = device.inscribed_circle();
    for (field, y_m) in [("mic", circle.y_m), ("mic_paper", circle.y_as_printed_m)] {
        let y_m = y_m.unwrap_or_else(|| panic!("{}: none", case.place(field)));
        case.expect(field, &[circle.radius_m / per_unit, y_m / per_unit]);
    }
}

fn device(case: &Case, per_unit: f64) -> SymmetricFiveBar {
    let parameters = SymmetricFiveBarParameters {
        a1_m: case.number("a1") * per_unit,
        a2_m: case.number("a2") * per_unit,
        a3_m: case.number("a3") * per_unit,
        s1: case.integer("s1"),
        s2: case.integer("s2"),
        assembly: case.integer("fk_sign"),
    };
    SymmetricFiveBar::new(parameters, Inertia::default())
        .unwrap_or_else(|e| panic!("{}: {e}", case.place("a1")))
}
