//! `brake-alloc.json`: bounds, regions, the papers' rule and the optimum of braked devices.

use std::f64::consts::{PI, TAU};

use hapticd::actuation::{
    ActuatorKind, Bounds, Capability, ShaftMotion, classify, nearest_reference, optimal,
};
use hapticd::analysis::manipulability::{Sector, manipulability};
use hapticd::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector, ReferenceMatrix};

use super::{Case, cases, close};

#[test]
fn every_brake_alloc_case_agrees() {
    for case in cases("brake-alloc") {
        check(&case);
    }
}

fn check(case: &Case) {
    let [v_x, v_y] = case.array("v");
    let [f_x, f_y] = case.array("Fd");
    let velocity = PlaneVector::new(v_x, v_y, 0.0);
    let desired = PlaneVector::new(f_x, f_y, 0.0);
    let capability = capability(case, &velocity);
    let n = capability.actuators;
    case.expect("lo", &capability.bounds.lower_Nm.as_slice()[..n]);
    case.expect("hi", &capability.bounds.upper_Nm.as_slice()[..n]);
    case.expect_region(classify(&capability, &desired, &velocity));
    check_sector(case, &capability, &desired, v_y.atan2(v_x));
    if !case.value("paper_tau").is_null() {
        let rule = nearest_reference(&capability, &desired, &velocity);
        case.expect("paper_tau_raw", &rule.raw_torque_Nm.as_slice()[..n]);
        case.expect("paper_tau", &rule.allocation.torque_Nm.as_slice()[..n]);
        case.expect("paper_F", rule.allocation.wrench.xy().as_slice());
    }
    check_optimum(case, &capability, &desired);
}

/// The sector that the desired force is in has the region of the case.
fn check_sector(case: &Case, capability: &Capability, desired: &PlaneVector, motion_rad: f64) {
    let max_torque_Nm = ActuatorVector::repeat(case.number("tau_max"));
    let found = manipulability(capability, &max_torque_Nm, Some(motion_rad), 1);
    let angle_rad = desired.y.atan2(desired.x);
    let edge = |rad: f64| (angle_rad - rad + PI).rem_euclid(TAU) - PI;
    // On an edge either region is right.
    if found.sectors.iter().any(|sector| edge(sector.from_rad).abs() < 1e-9) {
        return;
    }
    let inside = |sector: &&Sector| {
        (angle_rad - sector.from_rad).rem_euclid(TAU) < sector.to_rad - sector.from_rad
    };
    let region = found.sectors.iter().find(inside).map(|sector| sector.region);
    let direct =
        classify(capability, desired, &PlaneVector::new(motion_rad.cos(), motion_rad.sin(), 0.0));
    assert_eq!(region, direct.map(|direct| direct.region), "{}", case.place("region"));
}

fn capability(case: &Case, velocity: &PlaneVector) -> Capability {
    let entries = case.numbers("R");
    let actuators = entries.len() / 2;
    let mut reference = ReferenceMatrix::zeros();
    for (k, entry) in entries.iter().enumerate() {
        reference[(k / actuators, k % actuators)] = *entry;
    }
    let rates = reference.tr_mul(velocity);
    case.expect("w", &rates.as_slice()[..actuators]);
    let eps = case.number("eps");
    let motion = std::array::from_fn(|i| ShaftMotion::of(rates[i], eps));
    let kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
    let max_torque_Nm = ActuatorVector::repeat(case.number("tau_max"));
    let bounds = Bounds::given(&kinds, &max_torque_Nm, &motion);
    Capability { reference, freedoms: 2, actuators, kinds, bounds, moment_length_m: 1.0 }
}

/// The force is unique; the torques only have to give it, within bounds, at no larger norm.
fn check_optimum(case: &Case, capability: &Capability, desired: &PlaneVector) {
    let found = optimal(capability, desired);
    case.expect("F_opt", found.wrench.xy().as_slice());
    let torques = found.torque_Nm;
    let given = capability.reference * torques;
    assert!(close(given.as_slice(), found.wrench.as_slice()), "{}", case.place("tau_opt"));
    let Bounds { lower_Nm, upper_Nm } = capability.bounds;
    for i in 0..capability.actuators {
        let inside = torques[i] >= lower_Nm[i] && torques[i] <= upper_Nm[i];
        assert!(inside, "{}: torque {i} out of bounds", case.place("tau_opt"));
    }
    let least = case.numbers("tau_opt").iter().map(|t| t * t).sum::<f64>().sqrt();
    let norm = torques.norm();
    let larger = norm > least + 1e-9 * least.max(1.0);
    assert!(!larger, "{}: norm {norm}, least {least}", case.place("tau_opt"));
}
