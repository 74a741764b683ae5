//! The wall law `path-following`: brakes steer the velocity across the wall, not a force.
//!
//! After Swanson and Book (path following with dissipative actuators; the reference 15 of Cho
//! 2005): what is controlled is the part of the velocity normal to the path, by brakes that take
//! as little as they can of the part along it. Their paper is cited there without its equations,
//! so this is a version derived here, meant to be fair: it has the same sensors as the other
//! laws, and no observer.
//!
//! `s = v + dt M^-1 F_hand` is where the handle is about to go. Across the wall it is wanted to
//! go at `v_n = (depth - layer) / T`, back to a thin layer within the time T. Brake i, slipping
//! against its own rate where the handle goes as wanted, gives the normal velocity `g_i = dt n.M^-1 r_i` for a newton metre
//! and takes `dt t.M^-1 r_i` along the wall. Of those that push out of the wall the one that
//! takes the least of the tangential part for the normal part carries the whole correction,
//! `(v_n - s.n) / g_i`; the path is followed and the hand goes on. Where none pushes out the
//! brakes hold together, as in `predicted-velocity`.
//!
//! Walls that meet: the one that wants the most is steered for. An unknown hand force is none.

use super::predicted_velocity::{Mobility, brakes, hold};
use super::{Allocation, Capability, Handle, WallDemand};
use crate::notation::{ActuatorVector, PlaneVector};

/// Depth at which the handle is to stay.
const LAYER_M: f64 = 1e-4;

/// Time in which it is to get there.
const RETURN_S: f64 = 0.01;

/// A reaction must point out of the wall at least this much (cosine).
const LEAST_COSINE: f64 = 0.03;

/// Torques of the brakes that steer along `walls`; motors get none.
pub fn path_following(
    capability: &Capability,
    handle: &Handle,
    walls: &[WallDemand],
) -> Allocation {
    let released = capability.allocation(ActuatorVector::zeros());
    let Some((mobility, ahead)) = Mobility::ahead(handle, capability.freedoms) else {
        return released;
    };
    let missing = |wall: &WallDemand| (wall.depth_m - LAYER_M) / RETURN_S - ahead.dot(&wall.normal);
    let asking = walls.iter().filter(|wall| wall.force_N > 0.0);
    let Some(wall) = asking.max_by(|a, b| missing(a).total_cmp(&missing(b))) else {
        return released;
    };
    let missing_m_per_s = missing(wall);
    if missing_m_per_s.is_nan() || missing_m_per_s <= 0.0 {
        return released;
    }
    let steered = ahead + planar(&wall.normal) * missing_m_per_s;
    match steering(capability, &mobility, handle, &steered, wall) {
        Some((i, per_Nm)) => {
            let most_Nm = capability.bounds.upper_Nm[i].max(-capability.bounds.lower_Nm[i]);
            // Never more than the wall asks for.
            let pull = capability.reference.column(i).dot(&wall.normal).abs();
            let asked_Nm = wall.force_N / pull.max(f64::MIN_POSITIVE);
            let torque_Nm = (missing_m_per_s / per_Nm.abs()).min(most_Nm).min(asked_Nm);
            capability.allocation(ActuatorVector::ith(i, torque_Nm.copysign(per_Nm)))
        }
        None => hold(capability, walls),
    }
}

fn planar(v: &PlaneVector) -> PlaneVector {
    PlaneVector::new(v.x, v.y, 0.0)
}

/// The brake that takes the least tangential velocity for the normal one that it gives, and
/// what it gives per newton metre.
fn steering(
    capability: &Capability,
    mobility: &Mobility,
    handle: &Handle,
    wanted: &PlaneVector,
    wall: &WallDemand,
) -> Option<(usize, f64)> {
    let mut best = (f64::INFINITY, None);
    for i in brakes(capability) {
        let ray: PlaneVector = capability.reference.column(i).into_owned();
        let change = mobility.give(&ray) * handle.tick_s;
        let normal = change.dot(&wall.normal);
        // It has to slip still where the handle goes as wanted: one that only resists the way
        // into the wall leads along its own path, which is another.
        let sign = -ray.dot(wanted).signum();
        let pushes_out = sign * normal > LEAST_COSINE * change.norm();
        let costs = (change - wall.normal * normal).xy().norm() / normal.abs();
        if pushes_out && costs < best.0 {
            best = (costs, Some((i, normal)));
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuation::{ActuatorKind, Bounds, ShaftMotion};
    use crate::notation::{HandleInertia, MAX_ACTUATORS, ReferenceMatrix};

    fn device(rays: &[[f64; 2]]) -> Capability {
        let mut reference = ReferenceMatrix::zeros();
        for (i, ray) in rays.iter().enumerate() {
            (reference[(0, i)], reference[(1, i)]) = (ray[0], ray[1]);
        }
        let kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
        let motion = [ShaftMotion::Rest; MAX_ACTUATORS];
        let bounds = Bounds::given(&kinds, &ActuatorVector::repeat(20.0), &motion);
        let actuators = rays.len();
        Capability { reference, freedoms: 2, actuators, kinds, bounds, moment_length_m: 1.0 }
    }

    fn sliding(hand: [f64; 2]) -> Handle {
        Handle {
            position: PlaneVector::zeros(),
            velocity: PlaneVector::new(0.002, -0.1, 0.0),
            hand_force: Some(PlaneVector::new(hand[0], hand[1], 0.0)),
            inertia: HandleInertia::from_diagonal(&[0.5, 0.5, 0.0].into()),
            tick_s: 1e-3,
        }
    }

    const RAYS: [[f64; 2]; 4] = [[-3.0, 2.5], [-3.5, -1.0], [-1.0, 4.0], [4.0, -9.0]];
    const WALL: WallDemand =
        WallDemand { normal: PlaneVector::new(-1.0, 0.0, 0.0), force_N: 1e3, depth_m: 3e-4 };

    #[test]
    fn one_brake_gives_exactly_the_normal_velocity_that_leads_back_to_the_layer() {
        let handle = sliding([10.0, -5.0]);
        let found = path_following(&device(&RAYS), &handle, &[WALL]);
        assert_eq!(found.torque_Nm.iter().filter(|torque| **torque != 0.0).count(), 1);
        let next = handle.velocity + (handle.hand_force.unwrap() + found.wrench) * 2e-3;
        assert!((next.dot(&WALL.normal) - 2e-4 / RETURN_S).abs() < 1e-12, "{next}");
        assert!(found.wrench.dot(&handle.velocity) < 0.0, "it only takes energy");
        // Of the two that push out and resist, the steeper one.
        assert_eq!(found.torque_Nm.iamax(), 0);
    }

    #[test]
    fn a_hand_that_leaves_is_let_go_and_two_brakes_that_cannot_steer_hold() {
        let free = path_following(&device(&RAYS), &sliding([-60.0, 0.0]), &[WALL]);
        assert_eq!(free.torque_Nm, ActuatorVector::zeros());
        let held =
            path_following(&device(&[[-3.0, -3.0], [-3.0, -4.0]]), &sliding([1.0, 0.0]), &[WALL]);
        assert!(held.torque_Nm.norm() > 1.0);
        let none = path_following(&device(&RAYS), &sliding([f64::NAN, 0.0]), &[WALL]);
        assert_eq!(none.torque_Nm, ActuatorVector::zeros());
    }
}
