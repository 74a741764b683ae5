//! The figures of Cho 2005 about brakes by angle, and the same by brute force.

use super::*;
use crate::actuation::{Region, classify};
use crate::analysis::manipulability::shaft_motion;
use crate::config::DeviceDefinition;
use crate::mechanism::{
    FiveBar, FiveBarParameters, Inertia, Mechanism, Posture, TwoLink, TwoLinkParameters, fixtures,
};
use crate::notation::ActuatorVector;

/// The arm of Figures 1-3: equal links at (45, 90) degrees.
fn figure_1() -> (DeviceDefinition, Posture) {
    let device = DeviceDefinition::load("two-link").unwrap();
    let mut shafts = ActuatorVector::zeros();
    (shafts[0], shafts[1]) = (45f64.to_radians(), 90f64.to_radians());
    let posture = device.mechanism.posture_from_shafts(&shafts).unwrap();
    (device, posture)
}

fn figure_8() -> ReferenceMatrix {
    let device = FiveBar::new(fixtures::CHO[0], Inertia::default()).unwrap();
    device.posture_at(&PlaneVector::new(0.3, 0.1, 0.0)).unwrap().reference
}

fn names(rays: &[Ray]) -> Vec<String> {
    rays.iter().map(Ray::to_string).collect()
}

fn deg(angle_rad: f64) -> f64 {
    angle_rad.to_degrees()
}

#[test]
fn figure_1_has_four_passive_sets_of_45_and_135_degrees() {
    let (_, posture) = figure_1();
    let sets = passive_sets(&posture.reference, 2);
    let found: Vec<_> =
        sets.iter().map(|set| (names(&set.rays), deg(set.cone.width_rad))).collect();
    for ((rays, width_deg), (expected, expected_deg)) in found.iter().zip([
        (["1+", "2+"], 135.0),
        (["2+", "1-"], 45.0),
        (["1-", "2-"], 135.0),
        (["2-", "1+"], 45.0),
    ]) {
        assert_eq!(rays, &expected);
        assert!((width_deg - expected_deg).abs() < 1e-9, "{found:?}");
    }
}

#[test]
fn figure_2_moving_down_leaves_passive_set_2_and_three_kinds_of_desired_force() {
    let (device, posture) = figure_1();
    let down_rad = -FRAC_PI_2;
    let rates = posture.reference.tr_mul(&along(down_rad));
    assert!(rates[0] < 0.0 && rates[1] > 0.0, "{rates}");
    let set = passive_set_of(&posture.reference, 2, down_rad).unwrap();
    assert_eq!(names(&set.rays), ["2-", "1+"]);
    let capability = device.capability(&posture, &shaft_motion(&posture.reference, Some(down_rad)));
    let at = |desired_deg: f64| {
        classify(&capability, &along(desired_deg.to_radians()), &along(down_rad)).unwrap()
    };
    assert_eq!(at(110.0).region, Region::Full); // F_d1, between R2- and R1+
    let second = at(60.0); // F_d2: R2- is 30 degrees away
    assert_eq!(second.region, Region::Approximate);
    assert!((deg(second.gamma_rad.unwrap()) - 30.0).abs() < 1e-9);
    assert!((deg(direction_of(&posture.reference, set.rays[0])) - 90.0).abs() < 1e-9);
    assert_eq!(at(-60.0).region, Region::NotDisplayable); // F_d3
}

#[test]
fn equation_5_holds_for_every_motion_of_two_brakes_and_not_for_four() {
    let (_, posture) = figure_1();
    for step in 0..360 {
        let motion_rad = wrapped((f64::from(step) + 0.5).to_radians());
        let set = passive_set_of(&posture.reference, 2, motion_rad).unwrap();
        let [before, after] = approximation_rad(&set, motion_rad);
        assert!(before >= 0.0 && after >= -1e-12);
        let sets = passive_sets(&posture.reference, 2);
        let own = sets.iter().position(|other| other.rays == set.rays).unwrap();
        let neighbour = &sets[(own + 1) % 4];
        assert!((before + after - (PI - set.cone.width_rad)).abs() < 1e-12);
        assert!((before + after - neighbour.cone.width_rad).abs() < 1e-12);
    }
    let four = figure_8();
    let set = passive_set_of(&four, 4, 0.3).unwrap();
    let [before, after] = approximation_rad(&set, 0.3);
    let regions = regions(&four, 4);
    // What is left is the one region between the last ray and the opposite of the first.
    let last = regions.iter().find(|region| region.from == set.cone.to).unwrap();
    assert!((before + after - last.width_rad).abs() < 1e-12);
    assert!((before + after - set.cone.width_rad).abs() > 0.1);
}

#[test]
fn figure_3_locked_brakes_leave_circles_about_the_elbow_and_about_the_base() {
    let (_, posture) = figure_1();
    let [first, second] = one_brake_paths(&posture.reference, 2)[..] else { panic!("two") };
    // Brake 1 locked: link 2 (at 135 deg) turns about the elbow. Brake 2 locked: the handle
    // (at 90 deg) turns about the base.
    assert!((turn(first.plus_rad) - 225f64.to_radians()).abs() < 1e-9, "{first:?}");
    assert!((turn(second.plus_rad) - PI).abs() < 1e-9, "{second:?}");
}

#[test]
fn one_brake_paths_are_where_the_handle_goes_when_a_shaft_stands_still() {
    let parameters = TwoLinkParameters { l1_m: 0.31, l2_m: 0.22, elbow: -1 };
    let device = TwoLink::new(parameters, Inertia::default()).unwrap();
    let posture = device.posture_at(&PlaneVector::new(0.2, 0.3, 0.0)).unwrap();
    for path in one_brake_paths(&posture.reference, 2) {
        let mut shafts = posture.shaft_rad;
        shafts[1 - path.brake] += 1e-6;
        let moved = device.posture_from_shafts(&shafts).unwrap().p_BH - posture.p_BH;
        assert!((wrapped(moved.y.atan2(moved.x) - path.plus_rad)).abs() < 1e-5, "{path:?}");
    }
}

#[test]
fn in_the_friction_cone_every_one_brake_path_leads_into_the_wall_and_nowhere_else() {
    let (_, arm) = figure_1();
    for (reference, brakes) in [
        (arm.reference, vec![0, 1]),
        (figure_8(), vec![0, 1, 2, 3]),
        (figure_8(), vec![0, 3]),
        (figure_8(), vec![1, 2]),
    ] {
        for desired_step in 0..36 {
            let desired_rad = wrapped((f64::from(desired_step) * 10.0 + 3.3).to_radians());
            let cone = friction_cone(&reference, &brakes, desired_rad).unwrap();
            for hand_step in 0..360 {
                let hand_rad = wrapped((f64::from(hand_step) + 0.05).to_radians());
                let into_wall = |&brake: &usize| {
                    let ray = reference.column(brake);
                    let path = PlaneVector::new(-ray.y, ray.x, 0.0);
                    path.dot(&along(hand_rad)) * path.dot(&along(desired_rad)) < 0.0
                };
                let stuck = brakes.iter().all(into_wall);
                assert_eq!(cone.holds(hand_rad), stuck, "{cone:?} {desired_rad} {hand_rad}");
            }
        }
    }
}

#[test]
fn figure_8_has_eight_passive_sets_of_three_neighbouring_regions() {
    let reference = figure_8();
    let found: Vec<_> =
        passive_sets(&reference, 4).iter().map(|set| names(&set.rays).join(" ")).collect();
    // The paper lists them clockwise, and prints R4+ where its items 1 to 4 mean R4-.
    assert_eq!(
        found,
        [
            "1+ 4+ 3- 2-",
            "4+ 3- 2- 1-",
            "3- 2- 1- 4-",
            "2- 1- 4- 3+",
            "1- 4- 3+ 2+",
            "4- 3+ 2+ 1+",
            "3+ 2+ 1+ 4+",
            "2+ 1+ 4+ 3-",
        ]
    );
    for set in passive_sets(&reference, 4) {
        let inside = regions(&reference, 4);
        let inside = inside
            .iter()
            .filter(|region| set.cone.holds(wrapped(region.from_rad + 0.5 * region.width_rad)));
        assert_eq!(inside.count(), 3);
    }
    // All rates negative: the set R4+ R1+ R2+ R3+ (Eq 17).
    let moving = |motion_rad: f64| reference.tr_mul(&along(motion_rad));
    let motion_rad = (0..3600).map(|i| f64::from(i) * TAU / 3600.0);
    let all_negative =
        motion_rad.into_iter().find(|&m| (0..4).all(|i| moving(m)[i] < 0.0)).unwrap();
    let set = passive_set_of(&reference, 4, all_negative).unwrap();
    assert_eq!(names(&set.rays), ["3+", "2+", "1+", "4+"]);
}

#[test]
fn section_5_the_cone_of_four_brakes_is_what_the_cones_of_the_pairs_have_in_common() {
    let reference = figure_8();
    // Counter-clockwise; the paper names the same regions the other way round.
    let region = regions(&reference, 4)[7];
    assert_eq!((region.from.to_string(), region.to.to_string()), ("2+".into(), "1+".into()));
    let desired_rad = wrapped(region.from_rad + 0.5 * region.width_rad);
    let cone_of = |brakes: &[usize]| friction_cone(&reference, brakes, desired_rad).unwrap();
    let all = cone_of(&[0, 1, 2, 3]);
    assert_eq!(all, region.opposite());
    assert_eq!((all.from.to_string(), all.to.to_string()), ("2-".into(), "1-".into()));
    let pairs = [cone_of(&[0, 1]), cone_of(&[0, 3]), cone_of(&[1, 2])];
    let edges: Vec<_> = pairs.iter().map(|c| format!("{} {}", c.from, c.to)).collect();
    assert_eq!(edges, ["2- 1-", "4+ 1-", "2- 3+"]);
    for step in 0..3600 {
        let hand_rad = wrapped((f64::from(step) * 0.1 + 0.03).to_radians());
        let common = pairs.iter().all(|cone| cone.holds(hand_rad));
        assert_eq!(common, all.holds(hand_rad), "{hand_rad}");
    }
}

#[test]
fn figure_6_brake_4_locked_turns_joint_4_back_when_link_2_turns() {
    // k = 1: brake 4 to 45 deg with brake 2 locked, then brake 2 to 90 deg with brake 4 locked.
    let l_m = [0.3, 0.2, 0.25, 0.291, 0.3];
    let parameters = FiveBarParameters { l_m, k3: 1.0, k4: 1.0, ..fixtures::CHO[0] };
    let device = FiveBar::new(parameters, Inertia::default()).unwrap();
    let [l1, l2, l3, l4, _] = parameters.l_m;
    // A posture with link 2 at `phi2` and joint 4 at `theta4`: D follows, then E on two circles.
    let brake_4_at = |phi2: f64, theta4: f64| {
        let D = l2 * along(phi2) + l4 * along(phi2 + theta4);
        let (distance, base_rad) = (D.xy().norm(), D.y.atan2(D.x));
        let lean = ((distance * distance + l1 * l1 - l3 * l3) / (2.0 * distance * l1)).acos();
        let phi1 = base_rad + lean;
        let E = l1 * along(phi1);
        let phi3 = (E - D).y.atan2((E - D).x);
        let P = E + parameters.l_m[4] * along(phi3);
        let mut shafts = ActuatorVector::zeros();
        (shafts[0], shafts[1]) = (phi1, phi2);
        shafts[2] = wrapped(phi3 - phi1) + phi1;
        shafts[3] = theta4 + phi2;
        let posture = device.posture_from_shafts(&shafts).unwrap();
        assert!((posture.p_BH.xy() - P.xy()).norm() < 1e-9, "{posture:?}");
        assert!(posture.closure_rad.norm() < 1e-9, "{posture:?}");
        posture.shaft_rad[3]
    };
    let (quarter, eighth) = (FRAC_PI_2, 0.5 * FRAC_PI_2);
    let before = brake_4_at(0.0, eighth);
    let after = brake_4_at(quarter, -eighth);
    assert!((before - eighth).abs() < 1e-9 && (after - before).abs() < 1e-9, "{before} {after}");
}
