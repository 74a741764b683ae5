//! `serial2.json`: kinematics, reference forces, rays and regions of the serial arm.

use hapticd::actuation::{ActuatorKind, Bounds, Capability, ShaftMotion, classify};
use hapticd::mechanism::{Inertia, Mechanism, Rays, TwoLink, TwoLinkParameters};
use hapticd::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector};

use super::{Case, cases};

#[test]
fn every_serial2_case_agrees() {
    for case in cases("serial2") {
        check(&case);
    }
}

fn check(case: &Case) {
    let [q1, q2] = case.array("q");
    let parameters = TwoLinkParameters {
        l1_m: case.number("l1"),
        l2_m: case.number("l2"),
        elbow: if q2 > 0.0 { -1 } else { 1 },
    };
    let arm = TwoLink::new(parameters, Inertia::default()).expect("valid lengths");
    let shafts = ActuatorVector::from_column_slice(&[q1, q2, 0.0, 0.0, 0.0, 0.0]);
    let posture =
        arm.posture_from_shafts(&shafts).unwrap_or_else(|e| panic!("{}: {e}", case.place("q")));
    case.expect("P", posture.p_BH.xy().as_slice());
    case.expect_matrix("J", &arm.jacobian(&posture));
    case.expect_matrix("R", &posture.reference.fixed_view::<2, 2>(0, 0));
    case.expect_rays(&Rays::of(&posture.reference, arm.actuators()).expect("rays"));
    let [v_x, v_y] = case.array("v");
    let rates = posture.reference.tr_mul(&PlaneVector::new(v_x, v_y, 0.0));
    case.expect("qdot", &rates.as_slice()[..2]);

    let motion = std::array::from_fn(|i| ShaftMotion::of(rates[i], 0.0));
    let kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
    let capability = Capability {
        reference: posture.reference,
        freedoms: 2,
        actuators: 2,
        kinds,
        bounds: Bounds::given(&kinds, &ActuatorVector::repeat(1.0), &motion),
        moment_length_m: 1.0,
    };
    let [fx, fy] = case.array("Fd");
    let desired = PlaneVector::new(fx, fy, 0.0);
    case.expect_region(classify(&capability, &desired, &PlaneVector::new(v_x, v_y, 0.0)));

    let [x, y] = case.array("P");
    let inverse = arm.posture_at(&PlaneVector::new(x, y, 0.0));
    let inverse = inverse.unwrap_or_else(|e| panic!("{}: {e}", case.place("P")));
    case.expect("q", &inverse.shaft_rad.as_slice()[..2]);
}
