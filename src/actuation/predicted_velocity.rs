//! The wall law that looks one tick ahead: lock the brake whose path leads out of the wall.
//!
//! Derived here; it does by prediction what the coercive rule of Cho 2005, section 7, does by
//! angles. `s = v + dt M^-1 F_hand` is where the handle is about to go. With brake i locked
//! what is left of it is
//! `s_i = s - M^-1 r_i (r_i . s) / (r_i^T M^-1 r_i)`, for two freedoms the same as
//! `t (t^T M s) / (t^T M t)` with t across r_i. Brake i will do if s_i leads into no wall and
//! its reaction pushes out of the wall that is pressed; the one whose reaction is nearest to
//! the normal is taken alone, so that the handle slides (the SDOF controller of Swanson &
//! Book, chosen by force). If none will do, sticking cannot be avoided and the brakes hold
//! together.
//!
//! An unknown hand force counts as none: the law then sees only the velocity, and may choose
//! late. Torques carry the sign of the intended reaction; as commands they become capacities.

use super::{ActuatorKind, Allocation, Capability, optimal};
use crate::notation::{ActuatorVector, HandleInertia, PlaneVector};

/// A path may lead into a wall by this share of the motion: rounding, not intent.
const INTO_WALL: f64 = 1e-9;

/// A reaction must point out of the wall at least this much (cosine).
const LEAST_COSINE: f64 = 1e-3;

/// The handle as a wall law sees it, in B.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Handle {
    /// Pose of the handle.
    pub position: PlaneVector,
    /// Velocity of the handle.
    pub velocity: PlaneVector,
    /// What the hand puts on it; `None`: unknown.
    pub hand_force: Option<PlaneVector>,
    /// Inertia felt at the handle.
    pub inertia: HandleInertia,
    /// Time until the next tick.
    pub tick_s: f64,
}

/// One wall that asks to be held.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct WallDemand {
    /// Wrench of a unit force out of the wall: its translation part has length 1, its third
    /// part is the moment of that force about H, zero on a device with two freedoms.
    pub normal: PlaneVector,
    /// Force asked for along it, never negative.
    pub force_N: f64,
    /// How deep the tool is in it, metres; the deepest of what pushes the same way.
    pub depth_m: f64,
}

/// The inverse of the inertia, freedom by freedom.
pub(super) struct Mobility {
    inverse: HandleInertia,
}

impl Mobility {
    pub(super) fn of(inertia: &HandleInertia, freedoms: usize) -> Option<Self> {
        let mut inverse = HandleInertia::zeros();
        if freedoms > 2 {
            inverse = inertia.try_inverse()?;
        } else {
            let block = inertia.fixed_view::<2, 2>(0, 0).into_owned().try_inverse()?;
            inverse.fixed_view_mut::<2, 2>(0, 0).copy_from(&block);
        }
        Some(Self { inverse })
    }

    /// Acceleration under a force.
    pub(super) fn give(&self, force: &PlaneVector) -> PlaneVector {
        self.inverse * force
    }

    /// The same of a handle, and where it is about to go: an unknown hand force counts as none.
    pub(super) fn ahead(handle: &Handle, freedoms: usize) -> Option<(Self, PlaneVector)> {
        let mobility = Self::of(&handle.inertia, freedoms)?;
        let hand = handle.hand_force.unwrap_or_else(PlaneVector::zeros);
        let ahead = handle.velocity + mobility.give(&hand) * handle.tick_s;
        Some((mobility, ahead))
    }

    /// What is left of `motion` when nothing can move along `ray`.
    fn locked(&self, motion: &PlaneVector, ray: &PlaneVector) -> PlaneVector {
        let give = self.inverse * ray;
        let stiff = ray.dot(&give);
        if stiff > 0.0 { motion - give * (ray.dot(motion) / stiff) } else { *motion }
    }
}

/// Torques of the brakes that hold `walls`; motors get none.
pub fn predicted_velocity(
    capability: &Capability,
    handle: &Handle,
    walls: &[WallDemand],
) -> Allocation {
    let released = capability.allocation(ActuatorVector::zeros());
    let Some((mobility, ahead)) = Mobility::ahead(handle, capability.freedoms) else {
        return released;
    };
    let into = |wall: &&WallDemand| wall.force_N > 0.0 && ahead.dot(&wall.normal) < 0.0;
    let pressed = walls.iter().filter(into).min_by(|a, b| {
        let depth = |wall: &WallDemand| ahead.dot(&wall.normal);
        depth(a).total_cmp(&depth(b))
    });
    let Some(pressed) = pressed else {
        return released;
    };
    match best_brake(capability, &mobility, &ahead, pressed, walls) {
        Some(torque_Nm) => capability.allocation(torque_Nm),
        None => hold(capability, walls),
    }
}

/// The admissible brake whose reaction is nearest to the pressed wall's normal.
fn best_brake(
    capability: &Capability,
    mobility: &Mobility,
    ahead: &PlaneVector,
    pressed: &WallDemand,
    walls: &[WallDemand],
) -> Option<ActuatorVector> {
    let mut best = (LEAST_COSINE, None);
    for i in brakes(capability) {
        let ray: PlaneVector = capability.reference.column(i).into_owned();
        let length = ray.xy().norm();
        let reaction = -ray * ray.dot(ahead).signum();
        let cosine = reaction.dot(&pressed.normal) / length;
        let path = mobility.locked(ahead, &ray);
        let clear = walls.iter().all(|wall| path.dot(&wall.normal) >= -INTO_WALL * ahead.norm());
        if clear && length > 0.0 && cosine > best.0 {
            best = (cosine, Some((i, reaction)));
        }
    }
    let (i, reaction) = best.1?;
    // The normal part of the reaction is what the wall asked for; what it costs along the
    // wall is the approximation.
    let most_Nm = capability.bounds.upper_Nm[i].max(-capability.bounds.lower_Nm[i]);
    let capacity_Nm = (pressed.force_N / reaction.dot(&pressed.normal)).min(most_Nm);
    let mut torque_Nm = ActuatorVector::zeros();
    torque_Nm[i] = if reaction.dot(&capability.reference.column(i)) > 0.0 {
        capacity_Nm
    } else {
        -capacity_Nm
    };
    Some(torque_Nm)
}

/// The nearest force that the brakes give together.
pub(super) fn hold(capability: &Capability, walls: &[WallDemand]) -> Allocation {
    let wanted =
        walls.iter().fold(PlaneVector::zeros(), |sum, wall| sum + wall.normal * wall.force_N);
    let mut brakes_only = *capability;
    for i in 0..capability.actuators {
        if capability.kinds[i] == ActuatorKind::Motor {
            brakes_only.bounds.lower_Nm[i] = 0.0;
            brakes_only.bounds.upper_Nm[i] = 0.0;
        }
    }
    optimal(&brakes_only, &wanted)
}

pub(super) fn brakes(capability: &Capability) -> impl Iterator<Item = usize> + '_ {
    (0..capability.actuators).filter(|&i| capability.kinds[i] == ActuatorKind::Brake)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuation::{Bounds, ShaftMotion, nearest_in_box};
    use crate::notation::{MAX_ACTUATORS, ReferenceMatrix};

    fn capability(columns: &[[f64; 2]], motion: ShaftMotion) -> Capability {
        let mut reference = ReferenceMatrix::zeros();
        for (i, column) in columns.iter().enumerate() {
            reference[(0, i)] = column[0];
            reference[(1, i)] = column[1];
        }
        let kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
        let bounds = Bounds::given(&kinds, &ActuatorVector::repeat(20.0), &[motion; MAX_ACTUATORS]);
        Capability {
            reference,
            freedoms: 2,
            actuators: columns.len(),
            kinds,
            bounds,
            moment_length_m: 1.0,
        }
    }

    fn handle(velocity: [f64; 2], hand: [f64; 2]) -> Handle {
        let mut inertia = HandleInertia::zeros();
        inertia[(0, 0)] = 0.5;
        inertia[(1, 1)] = 0.5;
        Handle {
            position: PlaneVector::zeros(),
            velocity: PlaneVector::new(velocity[0], velocity[1], 0.0),
            hand_force: Some(PlaneVector::new(hand[0], hand[1], 0.0)),
            inertia,
            tick_s: 1e-3,
        }
    }

    fn wall(force_N: f64) -> WallDemand {
        WallDemand { normal: -PlaneVector::x(), force_N, depth_m: 1e-5 }
    }

    const RAYS: [[f64; 2]; 4] = [[-3.0, 2.5], [-3.5, -1.0], [-1.0, 4.0], [4.0, -9.0]];

    #[test]
    fn the_chosen_path_leads_out_of_the_wall_and_the_reaction_too() {
        let capability = capability(&RAYS, ShaftMotion::Rest);
        for hand_y in [-20.0, -5.0, 5.0, 20.0] {
            let handle = handle([0.0, 0.01 * f64::signum(hand_y)], [10.0, hand_y]);
            let found = predicted_velocity(&capability, &handle, &[wall(50.0)]);
            assert_eq!(found.torque_Nm.iter().filter(|torque| **torque != 0.0).count(), 1);
            assert!(found.wrench.x < 0.0, "it pushes out of the wall");
            let locked = found.torque_Nm.iamax();
            let mobility = Mobility::of(&handle.inertia, 2).unwrap();
            let ahead = handle.velocity + mobility.inverse * handle.hand_force.unwrap() * 1e-3;
            let path = mobility.locked(&ahead, &capability.reference.column(locked).into_owned());
            assert!(path.x <= 0.0 && path.y * hand_y > 0.0, "it slides on: {path}");
        }
    }

    #[test]
    fn a_soft_wall_gets_the_normal_force_it_asks_for() {
        let capability = capability(&RAYS, ShaftMotion::Rest);
        let found =
            predicted_velocity(&capability, &handle([0.01, -0.1], [1.0, -5.0]), &[wall(2.0)]);
        assert!((found.wrench.x + 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_hand_that_leaves_is_let_go() {
        let capability = capability(&RAYS, ShaftMotion::Rest);
        let found =
            predicted_velocity(&capability, &handle([-0.1, 0.0], [0.0, 0.0]), &[wall(50.0)]);
        assert_eq!(found.torque_Nm, ActuatorVector::zeros());
    }

    #[test]
    fn where_no_brake_will_do_they_hold_together() {
        let two = capability(&[[-3.0, 3.0], [-3.0, -3.0]], ShaftMotion::Rest);
        let found = predicted_velocity(&two, &handle([0.0, 0.0], [10.0, 1.0]), &[wall(30.0)]);
        assert!((found.wrench - PlaneVector::new(-30.0, 0.0, 0.0)).norm() < 1e-9);
    }

    /// A point mass on implicit brakes, pressed into the wall and dragged along it.
    #[test]
    fn a_pressed_handle_slides_along_the_wall_and_stays_out_of_it() {
        let (mut x_m, mut y_m, mut depth_max_m) = (0.0f64, 0.0f64, 0.0f64);
        let mut velocity = PlaneVector::zeros();
        for step in 0..2000 {
            let target_m = -0.1 * f64::from(step) * 1e-3;
            let pull = (400.0 * (target_m - y_m) - 20.0 * velocity.y).clamp(-60.0, 60.0);
            let handle = handle([velocity.x, velocity.y], [10.0, pull]);
            let capability = capability(&RAYS, ShaftMotion::Rest);
            let demand = [wall((1e7 * x_m).clamp(0.0, 100.0))];
            let capacity = predicted_velocity(&capability, &handle, &demand).torque_Nm.abs();
            let ahead = velocity + handle.hand_force.unwrap() * (1e-3 / 0.5);
            let matrix = capability.reference * (1e-3 / 0.5f64.sqrt());
            let torque =
                nearest_in_box(&matrix, &(-ahead * 0.5f64.sqrt()), &-capacity, &capacity, 4);
            velocity = ahead + capability.reference * torque * (1e-3 / 0.5);
            (x_m, y_m) = (x_m + velocity.x * 1e-3, y_m + velocity.y * 1e-3);
            depth_max_m = depth_max_m.max(x_m);
        }
        assert!(y_m < -0.1, "it slid {y_m} m");
        assert!(depth_max_m < 1e-3, "it entered {depth_max_m} m");
    }
}
