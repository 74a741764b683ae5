//! `coercive.json`: which reference force the rule of Cho 2005, section 7, takes.

use hapticd::actuation::{
    ActuatorKind, Bounds, Capability, Region, Rule, ShaftMotion, classify, nearest_reference, pick,
};
use hapticd::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector, ReferenceMatrix};
use serde_json::Value;

use super::{Case, cases};

#[test]
fn every_coercive_case_agrees() {
    for case in cases("coercive") {
        check(&case);
    }
}

fn plane(case: &Case, field: &str) -> PlaneVector {
    let [x, y] = case.array(field);
    PlaneVector::new(x, y, 0.0)
}

fn check(case: &Case) {
    let (v, hand, desired) = (plane(case, "v"), plane(case, "Fh"), plane(case, "Fd"));
    let capability = capability(case, &v);
    let cross = hand.x * desired.y - hand.y * desired.x;
    let phi_d = cross.atan2(hand.dot(&desired)).rem_euclid(std::f64::consts::TAU);
    case.expect("phi_d", &[phi_d]);
    check_pick(case, "literal", &capability, &hand, &desired, Rule::Literal);
    check_pick(case, "strict", &capability, &hand, &desired, Rule::Mended);
    check_path(case, &capability, &hand, &desired);
    check_plain(case, &capability, &desired, &v);
}

fn capability(case: &Case, v: &PlaneVector) -> Capability {
    let entries = case.numbers("R");
    let actuators = entries.len() / 2;
    let mut reference = ReferenceMatrix::zeros();
    for (k, entry) in entries.iter().enumerate() {
        reference[(k / actuators, k % actuators)] = *entry;
    }
    let rates = reference.tr_mul(v);
    case.expect("w", &rates.as_slice()[..actuators]);
    let kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
    let motion = std::array::from_fn(|i| ShaftMotion::of(rates[i], 0.0));
    let bounds = Bounds::given(&kinds, &ActuatorVector::repeat(20.0), &motion);
    Capability { reference, freedoms: 2, actuators, kinds, bounds, moment_length_m: 1.0 }
}

fn check_pick(
    case: &Case,
    field: &str,
    capability: &Capability,
    hand: &PlaneVector,
    desired: &PlaneVector,
    rule: Rule,
) {
    let found = pick(capability, hand, desired, rule);
    let expected = case.value(field);
    let Some(found) = found else {
        assert!(expected.is_null(), "{}: nothing found", case.place(field));
        return;
    };
    assert_eq!(expected["brake"], found.actuator + 1, "{}", case.place(field));
    assert_eq!(expected["sign"].as_f64(), Some(found.sign), "{}", case.place(field));
    let gamma = expected["gamma"].as_f64().expect("an angle");
    assert!((gamma - found.gamma_rad).abs() < 1e-9, "{}", case.place(field));
}

/// The path lies across the picked reference and follows the hand.
fn check_path(case: &Case, capability: &Capability, hand: &PlaneVector, desired: &PlaneVector) {
    let into_wall = pick(capability, hand, desired, Rule::Literal).map(|picked| {
        let ray = capability.reference.column(picked.actuator);
        let across = PlaneVector::new(-ray.y, ray.x, 0.0);
        (across * across.dot(hand).signum()).dot(desired) < 0.0
    });
    let place = case.place("literal_path_into_wall");
    assert_eq!(case.value("literal_path_into_wall").as_bool(), into_wall, "{place}");
}

/// The set of reference forces that the plain rule displays with.
fn check_plain(case: &Case, capability: &Capability, desired: &PlaneVector, v: &PlaneVector) {
    let shown = |v: &PlaneVector| {
        let torque_Nm = nearest_reference(capability, desired, v).raw_torque_Nm;
        let mut shown: Vec<[i64; 2]> = (0..capability.actuators)
            .filter(|&i| torque_Nm[i] != 0.0)
            .map(|i| [i as i64 + 1, torque_Nm[i].signum() as i64])
            .collect();
        shown.sort_unstable();
        shown
    };
    let Value::Array(expected) = case.value("plain") else {
        panic!("{} is no list", case.place("plain"))
    };
    let mut expected: Vec<[i64; 2]> = expected
        .iter()
        .map(|pair| [0, 1].map(|k| pair[k].as_i64().expect("a whole number")))
        .collect();
    expected.sort_unstable();
    // A force that needs energy is not displayed at all, whatever is nearest; the vectors have
    // what the same reference forces would show to a motion the other way.
    let active = classify(capability, desired, v)
        .is_some_and(|found| found.region == Region::NotDisplayable);
    if active {
        assert!(shown(v).is_empty(), "{}", case.place("plain"));
        assert_eq!(shown(&-v), expected, "{}", case.place("plain"));
    } else {
        assert_eq!(shown(v), expected, "{}", case.place("plain"));
    }
}
