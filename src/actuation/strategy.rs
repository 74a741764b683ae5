//! Strategies by name, and the one place that tells which law runs when.
//!
//! `auto` holds walls by a wall law and gives the rest to the optimal allocation in the bounds
//! that are left. One stiff wall on brakes is held by `sliding`; soft walls, walls that meet,
//! motors and three freedoms by `predicted-velocity`. `sliding` by name takes soft walls too.
//! The other strategies run always. A further law is one file and one line in [`allocate`].

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::{
    ActuatorKind, Allocation, Capability, Handle, LawState, Region, Shafts, WallDemand, classify,
    nearest_reference, optimal, predicted_velocity,
};
use crate::notation::{ActuatorVector, PlaneVector};

/// From here on a wall is stiff: 10 N, a firm press, go 0.1 mm deep.
const STIFF_N_PER_M: f64 = 1e5;

/// A wall that asks for this share of the device's range is stiff however deep the handle is.
const NEARLY_ALL: f64 = 0.9;

/// Normals closer than this (cosine) are one wall.
const COINCIDENT: f64 = 1.0 - 1e-6;

/// A rule that turns a desired force into torques.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Strategy {
    /// The wall law where there is a wall, else the optimum.
    #[default]
    Auto,
    /// The nearest achievable force.
    Optimal,
    /// Cho 2005: the exact pair, else the nearest reference force.
    NearestReference,
    /// One brake whose locking leads out of the wall.
    PredictedVelocity,
    /// One brake that slips at the pressing force.
    Sliding,
}

impl Strategy {
    /// Every strategy, for tables and help.
    pub const ALL: [Self; 5] =
        [Self::Auto, Self::Optimal, Self::NearestReference, Self::PredictedVelocity, Self::Sliding];

    /// The name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Optimal => "optimal",
            Self::NearestReference => "nearest-reference",
            Self::PredictedVelocity => "predicted-velocity",
            Self::Sliding => "sliding",
        }
    }
}

impl fmt::Display for Strategy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that is no strategy.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no strategy `{0}`: one of auto, optimal, nearest-reference, predicted-velocity, sliding")]
#[allow(clippy::disallowed_types, reason = "made where a name is read, never in a tick")]
pub struct StrategyError(pub String);

impl FromStr for Strategy {
    type Err = StrategyError;

    #[expect(clippy::disallowed_methods, reason = "reads what somebody wrote, never in a tick")]
    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let found = Self::ALL.into_iter().find(|strategy| strategy.name() == name);
        found.ok_or_else(|| StrategyError(name.to_owned()))
    }
}

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
        slide(strategy, capability, handle, wanted.walls, shafts, state)
    } else {
        state.reset();
        None
    };
    let law = match strategy {
        Strategy::Auto | Strategy::Sliding if slid.is_some() => Strategy::Sliding,
        Strategy::Auto | Strategy::Sliding if wanted.walls.iter().any(asks) => {
            Strategy::PredictedVelocity
        }
        Strategy::Auto | Strategy::Sliding => Strategy::Optimal,
        named => named,
    };
    let Allocation { mut torque_Nm, wrench } = match (law, slid) {
        (Strategy::NearestReference, _) => {
            nearest_reference(capability, &total, &handle.velocity).allocation
        }
        (Strategy::PredictedVelocity, _) => {
            let held = predicted_velocity(capability, handle, wanted.walls);
            with_rest(capability, &held, &wanted.soft, &total)
        }
        (Strategy::Sliding, Some(held)) => with_rest(capability, &held, &wanted.soft, &total),
        _ => optimal(capability, &total),
    };
    if may_slide {
        torque_Nm = state.command(capability, handle, shafts, &torque_Nm, slid.is_some());
    }
    let region = classify(capability, &total, &handle.velocity).map(|found| found.region);
    Outcome { torque_Nm, wrench, law, region }
}

fn asks(wall: &WallDemand) -> bool {
    wall.force_N > 0.0
}

/// The `sliding` law on the one wall that there is, where it can hold it: brakes, two freedoms,
/// and for `auto` a stiff wall. A wall that was stiff when it was met stays so until it goes.
fn slide(
    strategy: Strategy,
    capability: &Capability,
    handle: &Handle,
    walls: &[WallDemand],
    shafts: &Shafts,
    state: &mut LawState,
) -> Option<Allocation> {
    if capability.freedoms != 2 || !capability.is_passive() {
        state.reset();
        return None;
    }
    state.observe(capability, handle, shafts);
    let asking = || walls.iter().filter(|wall| asks(wall));
    let deepest = asking().max_by(|a, b| a.depth_m.total_cmp(&b.depth_m));
    let known = strategy == Strategy::Sliding || state.is_touching();
    let holds = deepest.is_none_or(|deepest| {
        let same = |wall: &WallDemand| wall.normal.dot(&deepest.normal) > COINCIDENT;
        asking().all(same) && (known || is_stiff(capability, deepest))
    });
    if !holds {
        state.leave_wall();
        return None;
    }
    state.hold(capability, handle, deepest)
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
    optimal(&left, &wanted)
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
        let (lag_s, counts) = (ActuatorVector::zeros(), ActuatorVector::repeat(65_536.0));
        let shafts = Shafts { lag_s: &lag_s, counts_per_revolution: &counts };
        let mut state = LawState::default();
        allocate(Strategy::Auto, device, &handle(), &wanted, &shafts, &mut state)
    }

    #[test]
    fn names_are_read_as_they_are_written() {
        for strategy in Strategy::ALL {
            assert_eq!(strategy.to_string().parse(), Ok(strategy));
        }
        let error = "best".parse::<Strategy>().unwrap_err().to_string();
        assert!(error.contains("best") && error.contains("predicted-velocity"));
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
    fn one_stiff_wall_is_slid_on_and_a_corner_or_a_soft_wall_is_not() {
        let device = device([ActuatorKind::Brake; MAX_ACTUATORS]);
        let none = PlaneVector::zeros();
        let stiff = WallDemand { force_N: 30.0, depth_m: 1e-5, ..WALL[0] };
        let deep = WallDemand { force_N: device.range_N(&stiff.normal), depth_m: 5e-3, ..stiff };
        for wall in [stiff, deep] {
            assert_eq!(auto(&device, &none, &[wall]).law, Strategy::Sliding);
            assert_eq!(auto(&device, &none, &[wall, wall]).law, Strategy::Sliding);
            let other = WallDemand { normal: PlaneVector::new(0.0, 1.0, 0.0), ..wall };
            assert_eq!(auto(&device, &none, &[wall, other]).law, Strategy::PredictedVelocity);
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
        assert!((wall.wrench - PlaneVector::new(-30.0, 0.0, 0.0)).norm() < 1e-9);
    }
}
