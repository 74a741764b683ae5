//! What the actuators can do: bounds, the nearest achievable force, wall laws, regions.
//!
//! One idea joins the papers: an actuator is an interval of torque that it can give *now*
//! ([`Bounds`]). A motor has `[-max, max]`; a brake only the side against its rate (Karnopp
//! 1985; Cho 2005, Eq 1). Everything here is a pure function of the reference matrix, rates
//! and a desired wrench, in the plane B at the handle. Nothing here knows where the desire
//! came from or what time it is; only [`StuckDetector`] and [`LawState`] remember anything.
#![cfg_attr(
    not(test),
    deny(clippy::disallowed_types, clippy::disallowed_methods, clippy::disallowed_macros)
)]

mod allocate;
mod bounds;
mod box_least_squares;
mod coercive;
mod force_distribution;
mod karnopp;
mod nearest_reference;
mod optimal;
mod path_following;
mod predicted_velocity;
mod region;
mod sliding;
mod steps;
mod strategy;
mod stuck;

pub use allocate::{Outcome, Wanted, allocate};
pub use bounds::{ActuatorKind, Bounds, Capability, ShaftMotion};
pub use box_least_squares::nearest_in_box;
pub use coercive::{Pick, Rule, coercive, pick};
pub use force_distribution::{Distributed, Distribution, least_norm, weighted};
pub use karnopp::{limited_Nm, literal_Nm};
pub use nearest_reference::{NearestReference, nearest_reference};
pub use optimal::{optimal, optimal_weighted};
pub use path_following::path_following;
pub use predicted_velocity::{Handle, WallDemand, predicted_velocity};
pub use region::{Bracket, Classification, Region, approximation_angle, classify};
pub use sliding::{LawState, Shafts};
pub use steps::in_steps;
pub use strategy::{Strategy, StrategyError};
pub use stuck::StuckDetector;

use crate::notation::{ActuatorVector, PlaneVector};

/// Torques and the wrench that they give.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Allocation {
    /// Torque of each actuator.
    pub torque_Nm: ActuatorVector,
    /// `R` times the torques.
    pub wrench: PlaneVector,
}
