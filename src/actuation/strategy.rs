//! Strategies by name, and the one place that tells which law runs when.
//!
//! `auto` holds walls by the wall law and gives the rest to the optimal allocation in the
//! bounds that are left; the other strategies run always. A further law is one file and one
//! line in [`allocate`].

use std::fmt;
use std::str::FromStr;

use super::{
    ActuatorKind, Allocation, Capability, Handle, Region, WallDemand, classify, nearest_reference,
    optimal, predicted_velocity,
};
use crate::notation::{ActuatorVector, PlaneVector};

/// A rule that turns a desired force into torques.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
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
}

impl Strategy {
    /// Every strategy, for tables and help.
    pub const ALL: [Self; 4] =
        [Self::Auto, Self::Optimal, Self::NearestReference, Self::PredictedVelocity];

    /// The name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Optimal => "optimal",
            Self::NearestReference => "nearest-reference",
            Self::PredictedVelocity => "predicted-velocity",
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
#[error("no strategy `{0}`: one of auto, optimal, nearest-reference, predicted-velocity")]
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

/// Torques for a soft force and walls.
pub fn allocate(
    strategy: Strategy,
    capability: &Capability,
    handle: &Handle,
    soft: &PlaneVector,
    walls: &[WallDemand],
) -> Outcome {
    let total = walls.iter().fold(*soft, |sum, wall| sum + wall.normal * wall.force_N);
    let law = match strategy {
        Strategy::Auto if walls.iter().any(|wall| wall.force_N > 0.0) => {
            Strategy::PredictedVelocity
        }
        Strategy::Auto => Strategy::Optimal,
        named => named,
    };
    let allocation = match law {
        Strategy::NearestReference => {
            nearest_reference(capability, &total, &handle.velocity).allocation
        }
        Strategy::PredictedVelocity => {
            let held = predicted_velocity(capability, handle, walls);
            with_rest(capability, &held, soft, &total)
        }
        Strategy::Auto | Strategy::Optimal => optimal(capability, &total),
    };
    let region = classify(capability, &total, &handle.velocity).map(|found| found.region);
    Outcome { torque_Nm: allocation.torque_Nm, wrench: allocation.wrench, law, region }
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
        [WallDemand { normal: PlaneVector::new(-1.0, 0.0, 0.0), force_N: 30.0, depth_m: 0.0 }];

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
        let air = allocate(Strategy::Auto, &device, &handle(), &soft, &[]);
        assert_eq!(air.law, Strategy::Optimal);
        let wall = allocate(Strategy::Auto, &device, &handle(), &PlaneVector::zeros(), &WALL);
        assert_eq!(wall.law, Strategy::PredictedVelocity);
        assert_eq!(wall.torque_Nm.iter().filter(|torque| **torque != 0.0).count(), 1);
    }

    #[test]
    fn a_soft_force_beside_a_wall_leaves_the_walls_brake_alone() {
        let device = device([ActuatorKind::Brake; MAX_ACTUATORS]);
        let alone = allocate(Strategy::Auto, &device, &handle(), &PlaneVector::zeros(), &WALL);
        let soft = PlaneVector::new(0.0, 2.0, 0.0);
        let both = allocate(Strategy::Auto, &device, &handle(), &soft, &WALL);
        let wall_brake = alone.torque_Nm.iamax();
        assert_eq!(both.torque_Nm[wall_brake], alone.torque_Nm[wall_brake]);
        assert!((both.wrench - alone.wrench - soft).norm() < 1e-9);
    }

    #[test]
    fn motors_give_a_wall_what_it_asks() {
        let device = device([ActuatorKind::Motor; MAX_ACTUATORS]);
        let wall = allocate(Strategy::Auto, &device, &handle(), &PlaneVector::zeros(), &WALL);
        assert!((wall.wrench - PlaneVector::new(-30.0, 0.0, 0.0)).norm() < 1e-9);
    }
}
