//! `force-dist.json` and `force-demo.json`: force distribution over the six motors of the 3-RRR.

use hapticd::actuation::{
    ActuatorKind, Bounds, Capability, Distributed, Distribution, ShaftMotion, least_norm,
    optimal_weighted, weighted,
};
use hapticd::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector, ReferenceMatrix};

use super::{Case, cases, content};

/// Of a wrench, relative to the largest entry or 1.
const WRENCH: f64 = 1e-10;

#[test]
fn every_force_dist_case_agrees() {
    for case in cases("force-dist") {
        check(&case);
    }
}

fn device(g_ua: &[f64], limits_Nm: &ActuatorVector) -> Capability {
    let kinds = [ActuatorKind::Motor; MAX_ACTUATORS];
    Capability {
        // The file has G, 6x3 row by row; R is its transpose.
        reference: ReferenceMatrix::from_column_slice(g_ua),
        freedoms: 3,
        actuators: 6,
        kinds,
        bounds: Bounds::given(&kinds, limits_Nm, &[ShaftMotion::Rest; MAX_ACTUATORS]),
        moment_length_m: 1.0,
    }
}

fn gives(device: &Capability, torque_Nm: &ActuatorVector, wrench: &PlaneVector, place: &str) {
    let error = (device.reference * torque_Nm - wrench).amax();
    assert!(error <= WRENCH * wrench.amax().max(1.0), "{place}: {error}");
}

fn within(device: &Capability, torque_Nm: &ActuatorVector) -> bool {
    (device.bounds.clamp(torque_Nm) - torque_Nm).amax() <= 1e-9
}

fn check(case: &Case) {
    let [limits, weight, wrench] = ["lim", "w", "Tu"].map(|field| case.numbers(field));
    let device = device(&case.numbers("GuA"), &ActuatorVector::from_column_slice(&limits));
    let weight = ActuatorVector::from_column_slice(&weight);
    let wrench = PlaneVector::from_column_slice(&wrench);
    let least = least_norm(&device, &wrench);
    case.expect("minnorm", least.as_slice());
    let light = weighted(&device, &wrench, &weight);
    case.expect("weighted", light.as_slice());
    expect_flag(case, "weighted_ok", within(&device, &light));
    for torque_Nm in [&least, &light] {
        gives(&device, torque_Nm, &wrench, &case.place("Tu"));
    }
    let all = Distribution::of(&device, &wrench, &weight).expect("six motors span the plane");
    let once = all.null_space(&device, &weight);
    case.expect("null_once", once.torque_Nm.as_slice());
    let pinned = once.pinned.iter().position(|pinned| *pinned).map(|i| i as u64);
    let place = case.place("null_once_pinned");
    assert_eq!(case.value("null_once_pinned").as_u64(), pinned, "{place}");
    expect_flag(case, "null_once_ok", within(&device, &once.torque_Nm));
    let iterated = all.null_space_iterated(&device);
    check_iterated(case, &device, &iterated);
    for scheme in [&once, &iterated] {
        gives(&device, &scheme.torque_Nm, &wrench, &case.place("Tu"));
    }
    check_exact(case, &device, &weight, &wrench);
}

fn expect_flag(case: &Case, field: &str, found: bool) {
    assert_eq!(case.value(field).as_bool(), Some(found), "{}", case.place(field));
}

fn check_iterated(case: &Case, device: &Capability, found: &Distributed) {
    let solved = within(device, &found.torque_Nm);
    expect_flag(case, "null_iter_ok", solved);
    if case.value("null_iter").is_null() {
        assert!(!solved, "{}", case.place("null_iter"));
        return;
    }
    case.expect("null_iter", found.torque_Nm.as_slice());
    let pins: Vec<f64> = (0..6).filter(|&i| found.pinned[i]).map(|i| i as f64).collect();
    let mut expected = case.numbers("null_iter_pins");
    expected.sort_by(f64::total_cmp);
    assert_eq!(pins, expected, "{}", case.place("null_iter_pins"));
}

/// Unique where it exists; else the wrench is not given, and the nearest one is.
fn check_exact(case: &Case, device: &Capability, weight: &ActuatorVector, wrench: &PlaneVector) {
    let exact = optimal_weighted(device, wrench, weight);
    let missing = (exact.wrench - wrench).amax();
    let feasible = missing <= WRENCH * wrench.amax().max(1.0);
    expect_flag(case, "feasible", feasible);
    assert!(within(device, &exact.torque_Nm), "{}", case.place("qp"));
    if feasible {
        gives(device, &exact.torque_Nm, wrench, &case.place("qp"));
        // The reference comes from a general solver, which stops at a tolerance.
        let expected = ActuatorVector::from_column_slice(&case.numbers("qp"));
        let norm = |torque: &ActuatorVector| torque.component_mul(torque).dot(weight).sqrt();
        assert!(norm(&exact.torque_Nm) <= norm(&expected) * (1.0 + 1e-9), "{}", case.place("qp"));
        assert!((exact.torque_Nm - expected).amax() < 1e-6, "{}", case.place("qp"));
    } else {
        assert!(case.value("qp").is_null(), "{}", case.place("qp"));
    }
}

/// Figures 3 to 7 of Kim 2003 in kind: a half-sine of 20 N at 351 degrees.
#[test]
fn every_force_demo_case_agrees() {
    let file = content("force-demo");
    let g_ua: Vec<f64> = file["GuA"]
        .as_array()
        .expect("a matrix")
        .iter()
        .flat_map(|row| row.as_array().expect("a row"))
        .map(|entry| entry.as_f64().expect("a number"))
        .collect();
    let limits_Nm = ActuatorVector::from_column_slice(&[2.0, 0.4, 2.0, 0.4, 2.0, 0.4]);
    let weight = ActuatorVector::from_column_slice(&[1.0, 3.0, 1.0, 3.0, 1.0, 3.0]);
    let device = device(&g_ua, &limits_Nm);
    let bearing_rad = 351f64.to_radians();
    for case in cases("force-demo") {
        let force_N = case.number("F");
        let wrench = force_N * PlaneVector::new(bearing_rad.cos(), bearing_rad.sin(), 0.0);
        case.expect("minnorm", least_norm(&device, &wrench).as_slice());
        let all = Distribution::of(&device, &wrench, &weight).expect("six motors span the plane");
        case.expect("weighted", all.weighted_Nm.as_slice());
        let limited = all.null_space(&device, &weight);
        case.expect("null", limited.torque_Nm.as_slice());
        assert!(within(&device, &limited.torque_Nm), "{}", case.place("null"));
        gives(&device, &limited.torque_Nm, &wrench, &case.place("null"));
    }
}
