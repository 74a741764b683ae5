//! The one place that tells which law runs when, and what the others of a tick get from it.
//!
//! `auto` holds walls by a wall law and gives the rest to the optimal allocation in the bounds
//! that are left. Stiff walls on brakes are held by `sliding`, soft walls and three freedoms by
//! `predicted-velocity`; motors need no wall law. `sliding` by name takes soft walls too. Beside
//! a stiff wall that is slid on a soft one is a soft force. The
//! other strategies run always. Where all actuators are motors, torques come in the steps that
//! these have. A further law is one file and one line in [`allocate`].

use super::{
    ActuatorKind, Allocation, Capability, Distribution, Handle, LawState, Region, Rule, Shafts,
    Strategy, WallDemand, classify, coercive, in_steps, nearest_reference, optimal_weighted,
    path_following, predicted_velocity,
};
use crate::environment::MAX_CONSTRAINTS;
use crate::notation::{ActuatorVector, PlaneVector};

/// From here on a wall is stiff: 10 N, a firm press, go 0.1 mm deep.
const STIFF_N_PER_M: f64 = 1e5;

/// A wall that asks for this share of the device's range is stiff however deep the handle is.
const NEARLY_ALL: f64 = 0.9;

/// What came of a request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Torques as the law intends them.
    pub torque_Nm: ActuatorVector,
    /// The wrench they would give.
    pub wrench: PlaneVector,
    /// The law that ran.
    pub law: Strategy,
    /// Region of the whole request; `None` at rest or without a request.
    pub region: Option<Region>,
}

/// What is asked of the actuators.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wanted<'a> {
    /// A force without a surface.
    pub soft: PlaneVector,
    /// Surfaces to be held.
    pub walls: &'a [WallDemand],
}

impl Wanted<'_> {
    /// All of it as one force.
    fn total(&self) -> PlaneVector {
        self.walls.iter().fold(self.soft, |sum, wall| sum + wall.normal * wall.force_N)
    }
}

/// Torques for a soft force and walls. `state` is what the `sliding` law remembers: it is kept
/// up to date under the strategies that may use the law, and emptied under the others.
pub fn allocate(
    strategy: Strategy,
    capability: &Capability,
    handle: &Handle,
    wanted: &Wanted,
    shafts: &Shafts,
    state: &mut LawState,
) -> Outcome {
    let total = wanted.total();
    let may_slide = matches!(strategy, Strategy::Auto | Strategy::Sliding);
    let slid = if may_slide {
        slide(strategy, capability, handle, wanted, shafts, state)
    } else {
        state.reset();
        None
    };
    let walls = wanted.walls.iter().any(asks);
    let law = match strategy {
        Strategy::Auto | Strategy::Sliding if slid.is_some() => Strategy::Sliding,
        Strategy::Auto | Strategy::Sliding if walls && capability.has_brakes() => {
            Strategy::PredictedVelocity
        }
        Strategy::Auto | Strategy::Sliding => Strategy::Optimal,
        named => named,
    };
    let mut soft = wanted.soft;
    let held = match law {
        Strategy::Sliding => slid.map(|(held, left)| {
            soft = left;
            held
        }),
        Strategy::PredictedVelocity => Some(predicted_velocity(capability, handle, wanted.walls)),
        Strategy::PathFollowing => Some(path_following(capability, handle, wanted.walls)),
        Strategy::Coercive => {
            walls.then(|| coercive(capability, handle, wanted.walls, Rule::Mended))
        }
        Strategy::CoerciveLiteral => {
            walls.then(|| coercive(capability, handle, wanted.walls, Rule::Literal))
        }
        _ => None,
    };
    let given = match held {
        Some(held) => with_rest(capability, &held, &soft, &total, shafts.weight),
        None => without_walls(law, capability, handle, &total, shafts.weight),
    };
    let Allocation { mut torque_Nm, wrench } = stepped(capability, given, shafts);
    if may_slide {
        torque_Nm = state.command(capability, handle, shafts, &torque_Nm, slid.is_some());
    }
    let region = classify(capability, &total, &handle.velocity).map(|found| found.region);
    Outcome { torque_Nm, wrench, law, region }
}

/// The laws that take everything asked as one force.
fn without_walls(
    law: Strategy,
    capability: &Capability,
    handle: &Handle,
    total: &PlaneVector,
    weight: &ActuatorVector,
) -> Allocation {
    let clipped =
        |torque_Nm: ActuatorVector| capability.allocation(capability.bounds.clamp(&torque_Nm));
    let distributed = |weight: &ActuatorVector, of: &dyn Fn(&Distribution) -> ActuatorVector| {
        let found = Distribution::of(capability, total, weight);
        clipped(found.as_ref().map_or_else(ActuatorVector::zeros, of))
    };
    match law {
        Strategy::NearestReference => {
            nearest_reference(capability, total, &handle.velocity).allocation
        }
        Strategy::LeastNorm => distributed(Shafts::IDEAL.weight, &|all| all.weighted_Nm),
        Strategy::Weighted => distributed(weight, &|all| all.weighted_Nm),
        Strategy::NullSpace => {
            distributed(weight, &|all| all.null_space(capability, weight).torque_Nm)
        }
        Strategy::NullSpaceIterated => {
            distributed(weight, &|all| all.null_space_iterated(capability).torque_Nm)
        }
        _ => optimal_weighted(capability, total, weight),
    }
}

/// Torques in the steps of the motors; brakes have none, and hold what they hold.
fn stepped(capability: &Capability, given: Allocation, shafts: &Shafts) -> Allocation {
    let steps = shafts.resolution_Nm;
    if capability.has_brakes() || steps.amax() == 0.0 {
        return given;
    }
    in_steps(capability, &given.wrench, &given.torque_Nm, steps, shafts.weight)
}

fn asks(wall: &WallDemand) -> bool {
    wall.force_N > 0.0
}

/// The `sliding` law on the walls that there are, where it can hold them: brakes, two freedoms,
/// and for `auto` a stiff wall; and the soft force that it leaves to others. A wall that was
/// stiff when it was met stays so until it goes.
fn slide(
    strategy: Strategy,
    capability: &Capability,
    handle: &Handle,
    wanted: &Wanted,
    shafts: &Shafts,
    state: &mut LawState,
) -> Option<(Allocation, PlaneVector)> {
    if capability.freedoms != 2 || !capability.is_passive() {
        state.reset();
        return None;
    }
    state.observe(capability, handle, shafts);
    let stiff = |wall: &WallDemand| asks(wall) && is_stiff(capability, wall);
    let any_stiff = wanted.walls.iter().any(stiff);
    let named = strategy == Strategy::Sliding;
    if !any_stiff && !named && !state.is_touching() && wanted.walls.iter().any(asks) {
        state.leave_wall();
        return None;
    }
    let (mut walls, mut count) = ([WallDemand::default(); MAX_CONSTRAINTS], 0);
    let mut soft = wanted.soft;
    for wall in wanted.walls.iter().filter(|wall| asks(wall)) {
        let is_held = stiff(wall) || state.holds(handle, wall).unwrap_or(named && !any_stiff);
        if is_held && count < MAX_CONSTRAINTS {
            walls[count] = *wall;
            count += 1;
        } else {
            soft += wall.normal * wall.force_N;
        }
    }
    let held = state.hold(capability, handle, shafts, &Wanted { soft, walls: &walls[..count] })?;
    let given = held.torque_Nm.amax() > 0.0;
    Some((held, if given { PlaneVector::zeros() } else { soft }))
}

/// Stiff: a hand's press goes no deeper than the layer in which the law works, or the wall
/// already asks for what the device has.
fn is_stiff(capability: &Capability, wall: &WallDemand) -> bool {
    wall.force_N >= STIFF_N_PER_M * wall.depth_m
        || wall.force_N >= NEARLY_ALL * capability.range_N(&wall.normal)
}

/// The walls' torques as they are, and the rest of the request from what is left: brakes
/// that hold no wall give soft forces only (a second brake on a wall would make the handle
/// stick), motors give all that is missing.
fn with_rest(
    capability: &Capability,
    held: &Allocation,
    soft: &PlaneVector,
    total: &PlaneVector,
    weight: &ActuatorVector,
) -> Allocation {
    let motors = !capability.is_passive();
    if !motors && soft.norm() == 0.0 {
        return *held;
    }
    let mut left = *capability;
    for i in 0..capability.actuators {
        let holds = held.torque_Nm[i] != 0.0;
        let idle = capability.kinds[i] == ActuatorKind::Brake && soft.norm() == 0.0;
        if holds || idle {
            left.bounds.lower_Nm[i] = held.torque_Nm[i];
            left.bounds.upper_Nm[i] = held.torque_Nm[i];
        }
    }
    let wanted = if motors { *total } else { held.wrench + soft };
    optimal_weighted(&left, &wanted, weight)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuation::{Bounds, ShaftMotion};
    use crate::notation::{HandleInertia, MAX_ACTUATORS, ReferenceMatrix};

    fn handle() -> Handle {
        Handle {
            position: PlaneVector::zeros(),
            velocity: PlaneVector::new(0.01, -0.1, 0.0),
            hand_force: Some(PlaneVector::new(10.0, -5.0, 0.0)),
            inertia: HandleInertia::identity(),
            tick_s: 1e-3,
        }
    }

    fn device(kinds: [ActuatorKind; MAX_ACTUATORS]) -> Capability {
        let mut reference = ReferenceMatrix::zeros();
        for (i, column) in [[-3.0, 2.5], [-3.5, -1.0], [-1.0, 4.0]].iter().enumerate() {
            reference[(0, i)] = column[0];
            reference[(1, i)] = column[1];
        }
        let motion = [ShaftMotion::Rest; MAX_ACTUATORS];
        let bounds = Bounds::given(&kinds, &ActuatorVector::repeat(20.0), &motion);
        Capability { reference, freedoms: 2, actuators: 3, kinds, bounds, moment_length_m: 1.0 }
    }

    const WALL: [WallDemand; 1] =
        [WallDemand { normal: PlaneVector::new(-1.0, 0.0, 0.0), force_N: 30.0, depth_m: 1e-3 }];

    /// The first tick of `auto`.
    fn auto(device: &Capability, soft: &PlaneVector, walls: &[WallDemand]) -> Outcome {
        let wanted = Wanted { soft: *soft, walls };
        let mut state = LawState::default();
        allocate(Strategy::Auto, device, &handle(), &wanted, &Shafts::IDEAL, &mut state)
    }

    #[test]
    fn auto_is_optimal_in_free_air_and_the_wall_law_at_a_wall() {
        let device = device([ActuatorKind::Brake; MAX_ACTUATORS]);
        let soft = PlaneVector::new(0.0, 1.0, 0.0);
        let air = auto(&device, &soft, &[]);
        assert_eq!(air.law, Strategy::Optimal);
        let wall = auto(&device, &PlaneVector::zeros(), &WALL);
        assert_eq!(wall.law, Strategy::PredictedVelocity);
        assert_eq!(wall.torque_Nm.iter().filter(|torque| **torque != 0.0).count(), 1);
    }

    #[test]
    fn stiff_walls_and_their_corners_are_slid_on_and_a_soft_wall_is_not() {
        let device = device([ActuatorKind::Brake; MAX_ACTUATORS]);
        let none = PlaneVector::zeros();
        let stiff = WallDemand { force_N: 30.0, depth_m: 1e-5, ..WALL[0] };
        let deep = WallDemand { force_N: device.range_N(&stiff.normal), depth_m: 5e-3, ..stiff };
        for wall in [stiff, deep] {
            assert_eq!(auto(&device, &none, &[wall]).law, Strategy::Sliding);
            assert_eq!(auto(&device, &none, &[wall, wall]).law, Strategy::Sliding);
            let other = WallDemand { normal: PlaneVector::new(0.0, 1.0, 0.0), ..wall };
            assert_eq!(auto(&device, &none, &[wall, other]).law, Strategy::Sliding);
        }
        assert_eq!(auto(&device, &none, &WALL).law, Strategy::PredictedVelocity);
    }

    #[test]
    fn a_soft_force_beside_a_wall_leaves_the_walls_brake_alone() {
        let device = device([ActuatorKind::Brake; MAX_ACTUATORS]);
        let alone = auto(&device, &PlaneVector::zeros(), &WALL);
        let soft = PlaneVector::new(0.0, 2.0, 0.0);
        let both = auto(&device, &soft, &WALL);
        let wall_brake = alone.torque_Nm.iamax();
        assert_eq!(both.torque_Nm[wall_brake], alone.torque_Nm[wall_brake]);
        assert!((both.wrench - alone.wrench - soft).norm() < 1e-9);
    }

    #[test]
    fn motors_give_a_wall_what_it_asks() {
        let device = device([ActuatorKind::Motor; MAX_ACTUATORS]);
        let wall = auto(&device, &PlaneVector::zeros(), &WALL);
        assert_eq!(wall.law, Strategy::Optimal);
        assert!((wall.wrench - PlaneVector::new(-30.0, 0.0, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn every_strategy_stays_within_the_bounds_and_says_its_name() {
        for kind in [ActuatorKind::Brake, ActuatorKind::Motor] {
            let mut device = device([kind; MAX_ACTUATORS]);
            let rates = device.reference.tr_mul(&handle().velocity);
            let motion = std::array::from_fn(|i| ShaftMotion::of(rates[i], 0.0));
            device.bounds = Bounds::given(&device.kinds, &ActuatorVector::repeat(2.0), &motion);
            for strategy in Strategy::ALL {
                let wanted = Wanted { soft: PlaneVector::new(3.0, 4.0, 0.0), walls: &WALL };
                let mut state = LawState::default();
                let given =
                    allocate(strategy, &device, &handle(), &wanted, &Shafts::IDEAL, &mut state);
                let named = matches!(strategy, Strategy::Auto | Strategy::Sliding);
                assert!(named || given.law == strategy, "{strategy}: {}", given.law);
                let most_Nm = given.torque_Nm.amax();
                assert!((1e-3..=2.0 + 1e-12).contains(&most_Nm), "{strategy}: {most_Nm} N m");
                let inside = device.bounds.clamp(&given.torque_Nm) == given.torque_Nm;
                assert!(inside || strategy == Strategy::Sliding || strategy == Strategy::Auto);
            }
        }
    }

    #[test]
    fn motors_with_steps_are_told_whole_steps() {
        let device = device([ActuatorKind::Motor; MAX_ACTUATORS]);
        let steps = ActuatorVector::from_column_slice(&[0.5, 0.5, 0.01, 0.0, 0.0, 0.0]);
        let shafts = Shafts { resolution_Nm: &steps, ..Shafts::IDEAL };
        let wanted = Wanted { soft: PlaneVector::new(3.3, 4.4, 0.0), walls: &[] };
        let mut state = LawState::default();
        let given = allocate(Strategy::Auto, &device, &handle(), &wanted, &shafts, &mut state);
        for i in 0..3 {
            let count = given.torque_Nm[i] / steps[i];
            assert!((count - count.round()).abs() < 1e-9, "{count}");
        }
        assert!((1e-9..1.0).contains(&(given.wrench - wanted.soft).norm()));
    }
}
