//! `rrr3.json`: kinematics and every Jacobian of the 3-RRR.
//!
//! The file has the paper's origin at base 1; B has it at the centre of the base circle.

use hapticd::mechanism::{Inertia, Mechanism, PSI_RAD, ThreeRrr, ThreeRrrParameters};
use hapticd::notation::PlaneVector;

use super::{Case, cases};

#[test]
fn every_rrr3_case_agrees() {
    for case in cases("rrr3") {
        check(&case);
    }
}

fn check(case: &Case) {
    let base_m = case.number("R");
    let elbows = case.array::<3>("elbow").map(|sign| sign as i32);
    let parameters = ThreeRrrParameters { base_m, l_m: [0.1; 3], turn_rad: 0.1, elbows };
    let device = ThreeRrr::new(parameters, Inertia::default())
        .unwrap_or_else(|e| panic!("{}: {e}", case.place("R")));
    case.expect("psi", &PSI_RAD);

    let [x, y, phi] = case.array("X");
    let origin_m = [base_m * 0.75_f64.sqrt(), 0.5 * base_m];
    let pose = PlaneVector::new(x - origin_m[0], y - origin_m[1], phi);
    let posture = device.posture_at(&pose);
    let posture = posture.unwrap_or_else(|e| panic!("{}: {e}", case.place("X")));
    case.expect("q", device.joint_angles_rad(&posture).as_flattened());

    let mut outline = Default::default();
    device.outline(&posture, &mut outline);
    let bases = [0, 3, 6].map(|segment: usize| {
        let [x, y] = outline[segment].0;
        [x + origin_m[0], y + origin_m[1]]
    });
    case.expect("base", bases.as_flattened());

    let found = device.jacobians(&posture);
    let rows = found.iG_phi.iter().flat_map(|chain| chain.transpose().as_slice().to_vec());
    case.expect("Gphi", &rows.collect::<Vec<_>>());
    case.expect_matrix("A", &found.A);
    case.expect_matrix("B", &found.B);
    let Ga_u = found.Ga_u.unwrap_or_else(|| panic!("{}: none", case.place("Ga_u")));
    case.expect_matrix("Ga_u", &Ga_u);
    case.expect_matrix("GuA", &found.Gu_A);
    case.expect_matrix("GuA", &posture.reference.transpose());
    let sigma = found.A.singular_values();
    case.expect("condA", &[sigma.max() / sigma.min()]);

    let back = device.posture_from_shafts(&posture.shaft_rad);
    let back = back.unwrap_or_else(|e| panic!("{}: {e}", case.place("q")));
    let given = [back.p_BH.x + origin_m[0], back.p_BH.y + origin_m[1]];
    let close = |a: f64, b: f64| (a - b).abs() < 1e-9;
    assert!(close(given[0], x) && close(given[1], y), "{}", case.place("X"));
    assert!(close((back.p_BH.z - phi).sin(), 0.0), "{}", case.place("X"));
}
