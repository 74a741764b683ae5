//! Figures 6 and 8 of Cho 2005 on the optimised five-bar: coupled motion of a tendon, eight
//! passive sets, the friction cones of pairs of brakes, and the coercive rule of section 7.

use std::f64::consts::{FRAC_PI_2, PI};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{ChoError, along};
use crate::actuation::{Rule, ShaftMotion, nearest_reference, optimal, pick};
use crate::analysis::design::cones::{Cone, friction_cone, passive_set_of, passive_sets, regions};
use crate::analysis::manipulability::shaft_motion;
use crate::config::DeviceDefinition;
use crate::mechanism::{FiveBar, FiveBarParameters, Inertia, Mechanism, Posture};
use crate::notation::{MAX_ACTUATORS, PlaneVector, ReferenceMatrix};

/// Where Figure 8 is taken here: the paper does not say.
pub(super) const PLACE_M: [f64; 2] = [0.3, 0.1];

/// The eight passive sets as the paper lists them, clockwise; brakes with the sign of torque.
const PRINTED: [[i32; 4]; 8] = [
    [1, 2, 3, 4],
    [2, 3, 4, -1],
    [3, 4, -1, -2],
    [4, -1, -2, -3],
    [-1, -2, -3, 4],
    [-2, -3, 4, 1],
    [-3, 4, 1, 2],
    [4, 1, 2, 3],
];

/// What this run finds of Figures 6 and 8, and of the rules.
#[derive(Clone, Debug)]
pub struct Regions {
    /// theta4 after brake 4 went to 45 degrees and link 2 to 90, k = 1, degrees.
    pub theta4_deg: f64,
    /// Rays clockwise from 4+.
    pub order: String,
    /// Regions of each passive set.
    pub regions_per_set: Vec<usize>,
    /// Sets of the paper's list that exist, as printed and with 4- for 4+ in items 1 to 4.
    pub listed: [usize; 2],
    /// The set of a motion in which all shafts turn backwards (Eq 17).
    pub eq17: String,
    /// Cones of brakes {1,2}, {1,4}, {2,3} and all for a desired force between R1+ and R2+.
    pub cones: [String; 4],
    /// Directions of a hand, and those where "in all three cones" is not "in that of all four".
    pub common: [usize; 2],
    /// A hand between R3+ and R1- is in the cone of {2,3} and not in that of {1,4}.
    pub avoided: bool,
    /// Picks of the coercive rule, those as printed that lead into the wall, and with the
    /// condition that they lack: those, and those where nothing is picked.
    pub coercive: [usize; 4],
    /// Random forces within limits: all, nearest-reference worse than the exact optimum.
    pub allocations: [usize; 2],
    /// Random forces with F.v > 0: all, those where a resisting projection still helps.
    pub active: [usize; 2],
}

pub(super) fn measure() -> Result<Regions, ChoError> {
    let device = DeviceDefinition::load("cho-2005")?;
    let place = PlaneVector::new(PLACE_M[0], PLACE_M[1], 0.0);
    let R = device.mechanism.posture_at(&place)?.reference;
    let sets = passive_sets(&R, 4);
    let around = regions(&R, 4);
    let per_set = |set: &crate::analysis::design::cones::PassiveSet| {
        let middle = |region: &&Cone| set.cone.holds(region.from_rad + 0.5 * region.width_rad);
        around.iter().filter(middle).count()
    };
    let backward = (0..3600)
        .map(|k| f64::from(k) * PI / 1800.0)
        .find(|&motion| R.tr_mul(&along(motion)).iter().take(4).all(|rate| *rate < 0.0));
    let eq17 = backward.and_then(|motion_rad| passive_set_of(&R, 4, motion_rad));
    let (cones, common, avoided) = cones_of_pairs(&R, &around);
    let (allocations, active) = allocations(&device)?;
    Ok(Regions {
        theta4_deg: theta4_deg(),
        order: order(&around),
        regions_per_set: sets.iter().map(per_set).collect(),
        listed: listed(&sets),
        eq17: eq17.map_or_else(String::new, |set| named(&set.rays)),
        cones,
        common,
        avoided,
        coercive: coercive(&device)?,
        allocations,
        active,
    })
}

fn named(rays: &[crate::mechanism::Ray]) -> String {
    rays.iter().rev().map(|ray| format!("R{ray}")).collect::<Vec<_>>().join(" ")
}

/// Clockwise, as the paper goes round, from 4+.
fn order(around: &[Cone]) -> String {
    let mut clockwise: Vec<String> =
        around.iter().rev().map(|cone| format!("R{}", cone.from)).collect();
    let first = clockwise.iter().position(|name| name == "R4+").unwrap_or(0);
    clockwise.rotate_left(first);
    clockwise.join(" ")
}

fn listed(sets: &[crate::analysis::design::cones::PassiveSet]) -> [usize; 2] {
    let have: Vec<[i32; 4]> = sets
        .iter()
        .map(|set| {
            let signed = |k: usize| {
                let ray = set.rays[3 - k];
                (ray.actuator as i32 + 1) * if ray.positive { 1 } else { -1 }
            };
            std::array::from_fn(signed)
        })
        .collect();
    let mended = PRINTED
        .iter()
        .enumerate()
        .map(|(item, set)| set.map(|ray| if item < 4 && ray == 4 { -4 } else { ray }));
    let count = |list: &[[i32; 4]]| list.iter().filter(|set| have.contains(set)).count();
    [count(&PRINTED), count(&mended.collect::<Vec<_>>())]
}

/// Brake 4 to 45 degrees with brake 2 locked, then link 2 to 90 degrees with brake 4 locked.
fn theta4_deg() -> f64 {
    let l_m = [0.3, 0.2, 0.25, 0.291, 0.3];
    let parameters =
        FiveBarParameters { l_m, k3: 1.0, k4: 1.0, lever: -1, tendons: 1, elbow: 1, branch: 1 };
    let Ok(device) = FiveBar::new(parameters, Inertia::default()) else { return f64::NAN };
    // A posture with link 2 at phi2 and joint 4 at theta4 has D there; E follows on two circles.
    let brake_4 = |phi2: f64, theta4: f64| {
        let D = l_m[1] * along(phi2) + l_m[3] * along(phi2 + theta4);
        let d = D.xy().norm();
        let lean = ((d * d + l_m[0] * l_m[0] - l_m[2] * l_m[2]) / (2.0 * d * l_m[0])).acos();
        let phi1 = D.y.atan2(D.x) + lean;
        let E = l_m[0] * along(phi1);
        let phi3 = (E - D).y.atan2((E - D).x);
        let mut shafts = crate::notation::ActuatorVector::zeros();
        (shafts[0], shafts[1], shafts[2], shafts[3]) = (phi1, phi2, phi3, theta4 + phi2);
        // What the linkage itself says of the brake, not what it was given.
        let own = |posture: Posture| shafts[3] - posture.closure_rad[3];
        device.posture_from_shafts(&shafts).map_or(f64::NAN, own)
    };
    let locked = brake_4(0.0, 0.5 * FRAC_PI_2);
    // Of all angles of joint 4 the one that leaves brake 4 where it is locked.
    let off = |theta4: f64| brake_4(FRAC_PI_2, theta4) - locked;
    let (mut low, mut high) = (-1.2, -0.4);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if off(middle) > 0.0 { high = middle } else { low = middle }
    }
    (0.5 * (low + high)).to_degrees()
}

fn cones_of_pairs(R: &ReferenceMatrix, around: &[Cone]) -> ([String; 4], [usize; 2], bool) {
    let middle = |cone: &Cone| cone.from_rad + 0.5 * cone.width_rad;
    let between = |a: &str, b: &str| {
        around.iter().find(|cone| cone.from.to_string() == a && cone.to.to_string() == b)
    };
    let Some(own) = between("2+", "1+") else { return Default::default() };
    let desired_rad = middle(own);
    let used: [&[usize]; 4] = [&[0, 1], &[0, 3], &[1, 2], &[0, 1, 2, 3]];
    let found = used.map(|brakes| friction_cone(R, brakes, desired_rad));
    let [Some(a), Some(b), Some(c), Some(all)] = found else { return Default::default() };
    let name = |cone: &Cone| format!("R{} - R{}", cone.to, cone.from);
    let mut common = [0; 2];
    for step in 0..3600 {
        let hand_rad = (0.1 * f64::from(step) + 0.03).to_radians();
        let in_pairs = [a, b, c].iter().all(|cone| cone.holds(hand_rad));
        common[0] += 1;
        common[1] += usize::from(in_pairs != all.holds(hand_rad));
    }
    // The region beside the common one, between R1- and R3+ (over R4-).
    let beside = around.iter().find(|cone| cone.from == all.to).map(middle);
    let other = around.iter().find(|cone| cone.to == all.from).map(middle);
    let escapes = |hand: Option<f64>| hand.is_some_and(|rad| c.holds(rad) && !b.holds(rad));
    ([name(&a), name(&b), name(&c), name(&all)], common, escapes(beside) || escapes(other))
}

/// The rule of section 7 for hands that press into walls, everywhere.
fn coercive(device: &DeviceDefinition) -> Result<[usize; 4], ChoError> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut found = [0; 4];
    while found[0] < 2000 {
        let r_m = rng.random_range(0.2..0.5);
        let posture = device.mechanism.posture_at(&PlaneVector::new(r_m, 0.0, 0.0))?;
        let (hand, normal) = (along(rng.random_range(-PI..PI)), along(rng.random_range(-PI..PI)));
        if hand.dot(&normal) >= 0.0 {
            continue;
        }
        // The way that the hand would take along the wall turns the brakes.
        let way = hand - normal * hand.dot(&normal);
        let motion = shaft_motion(&posture.reference, Some(way.y.atan2(way.x)));
        let capability = device.capability(&posture, &motion);
        let into = |rule: Rule| {
            let ray = posture.reference.column(pick(&capability, &hand, &normal, rule)?.actuator);
            let path = PlaneVector::new(-ray.y, ray.x, 0.0);
            Some(path.dot(&hand) * path.dot(&normal) < 0.0)
        };
        found[0] += 1;
        found[1] += usize::from(into(Rule::Literal) == Some(true));
        found[2] += usize::from(into(Rule::Mended) == Some(true));
        found[3] += usize::from(into(Rule::Mended).is_none());
    }
    Ok(found)
}

/// Random motions and forces: the paper's allocation beside the nearest achievable force.
fn allocations(device: &DeviceDefinition) -> Result<([usize; 2], [usize; 2]), ChoError> {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let (mut limited, mut active) = ([0; 2], [0; 2]);
    while limited[0] < 2000 || active[0] < 2000 {
        let r_m = rng.random_range(0.2..0.5);
        let posture = device.mechanism.posture_at(&PlaneVector::new(r_m, 0.0, 0.0))?;
        let motion_rad = rng.random_range(-PI..PI);
        let capability =
            device.capability(&posture, &shaft_motion(&posture.reference, Some(motion_rad)));
        let direction = along(rng.random_range(-PI..PI));
        let whole = device.capability(&posture, &[ShaftMotion::Rest; MAX_ACTUATORS]);
        let force = direction * (rng.random_range(0.05..1.0) * whole.range_N(&direction));
        let velocity = 0.1 * along(motion_rad);
        let best = (optimal(&capability, &force).wrench - force).xy().norm();
        if force.dot(&velocity) > 0.0 {
            active[0] += 1;
            active[1] += usize::from(best < (1.0 - 1e-9) * force.norm());
        } else {
            let given = nearest_reference(&capability, &force, &velocity).allocation.wrench;
            limited[0] += 1;
            limited[1] += usize::from((given - force).xy().norm() > best + 1e-6 * force.norm());
        }
    }
    Ok((limited, active))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_regions_are_those_that_the_paper_means() {
        let found = measure().unwrap();
        assert!((found.theta4_deg + 45.0).abs() < 1e-6, "{found:?}");
        assert_eq!(found.order, "R4+ R1+ R2+ R3+ R4- R1- R2- R3-");
        assert_eq!((found.regions_per_set.clone(), found.listed), (vec![3; 8], [4, 8]));
        assert_eq!(found.eq17, "R4+ R1+ R2+ R3+");
        assert_eq!(found.cones, ["R1- - R2-", "R1- - R4+", "R3+ - R2-", "R1- - R2-"]);
        assert!(found.common == [3600, 0] && found.avoided, "{found:?}");
        let [all, literal, mended, none] = found.coercive;
        assert!(literal > all / 10 && mended == 0 && none > 0, "{found:?}");
        assert!(found.allocations[1] > 0 && found.active[1] > found.active[0] / 2, "{found:?}");
    }
}
