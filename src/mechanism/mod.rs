//! Where the handle is, and what the actuators do there: one linkage per file.
//!
//! A [`Mechanism`] is constant: it is built and checked once from a device file and only
//! asked afterwards. Every answer is a value or a typed [`KinematicsError`], never NaN.
//! Angles in and out are those of the *actuator shafts* (which carry the encoders).
//! Entries of an argument beyond `freedoms` or `actuators` are not read.
//! This module does not know brakes from motors, forces asked for, or time.
#![cfg_attr(
    not(test),
    deny(clippy::disallowed_types, clippy::disallowed_methods, clippy::disallowed_macros)
)]

mod five_bar;
mod geometry;
mod inertia;
mod kind;
mod parameters;
mod rays;
mod symmetric_five_bar;
mod two_link;

#[cfg(test)]
pub(crate) mod fixtures;

pub use five_bar::{FiveBar, FiveBarJacobians, FiveBarParameters};
pub use geometry::{LEAST_MARGIN, LONGEST_ANGLE_RAD};
pub use inertia::{Inertia, LinkInertia};
pub use kind::{Built, Described, Form, KINDS, Key, Kind, Value, Weights, build};
pub use parameters::ParameterError;
pub use rays::{MAX_RAYS, Ray, Rays};
pub use symmetric_five_bar::{
    InscribedCircle, SymmetricFiveBar, SymmetricFiveBarJacobians, SymmetricFiveBarParameters,
};
pub use two_link::{TwoLink, TwoLinkParameters};

use crate::notation::{ActuatorVector, HandleInertia, PlaneVector, ReferenceMatrix};

/// Why a linkage has no answer. Carries numbers only, so that it can be made in a tick.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum KinematicsError {
    /// Two links would have to span a distance that they cannot: no posture puts the handle
    /// there, or the shafts at these angles cannot close the loop.
    #[error("the linkage cannot reach there: {needed_m} m needed, {min_m} to {max_m} m possible")]
    Unreachable { needed_m: f64, min_m: f64, max_m: f64 },
    /// Two branches meet: the handle's motion does not follow from the shafts', or theirs
    /// from its. The margin is the least |sine| of an angle between two links that span a
    /// distance together: 0 when they are in line, 1 at a right angle, whatever the lengths.
    #[error("the linkage is at a singular posture (margin {margin}, at least {least} needed)")]
    Singular { margin: f64, least: f64 },
    /// An argument is not a finite number, or an angle is beyond [`LONGEST_ANGLE_RAD`].
    #[error("an angle or position is not a usable number")]
    NotFinite,
}

/// Everything a tick needs to know of one configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Posture {
    /// Pose of the handle in B: x and y in metres, phi in radians within (-pi, pi]. On a
    /// device of two freedoms phi follows from x and y; it is told, not actuated.
    pub p_BH: PlaneVector,
    /// Shaft angles of this posture, radians; continuous with the angles given to
    /// [`Mechanism::posture_from_shafts`].
    pub shaft_rad: ActuatorVector,
    /// Wrench at the handle per unit shaft torque, N/(N m) and N m/(N m).
    pub reference: ReferenceMatrix,
    /// Inertia felt at the handle. On a device of two freedoms the third row and column are
    /// zero: invert the upper-left 2x2, which is positive definite.
    pub inertia: HandleInertia,
    /// Given minus computed angle of the shafts that loop closure makes redundant, radians;
    /// zero for shafts that define the posture.
    pub closure_rad: ActuatorVector,
}

/// A linkage: handle pose, actuator shafts, and the maps between them.
pub trait Mechanism: Send + Sync + std::fmt::Debug {
    /// The name in device files.
    fn name(&self) -> &'static str;
    /// Actuated freedoms of the handle, 2 or 3.
    fn freedoms(&self) -> usize;
    /// Number of actuators, at most [`crate::notation::MAX_ACTUATORS`].
    fn actuators(&self) -> usize;
    /// The posture that puts the handle at `p_BH` in this device's working mode. Angles of
    /// links are within half a turn: whole turns are the business of whoever counts them.
    fn posture_at(&self, p_BH: &PlaneVector) -> Result<Posture, KinematicsError>;
    /// The posture with these shaft angles, in whatever working mode they are.
    fn posture_from_shafts(&self, shaft_rad: &ActuatorVector) -> Result<Posture, KinematicsError>;
    /// Joint positions in B as line segments `(from, to)`, for drawing; fills `out` and
    /// returns how many there are.
    fn outline(&self, posture: &Posture, out: &mut [([f64; 2], [f64; 2]); 8]) -> usize;
    /// Smallest and largest distance from the origin of B that the handle can reach, metres.
    fn reach_m(&self) -> (f64, f64);
    /// True where the inertia at the handle changes from place to place.
    fn inertia_varies(&self) -> bool;
}
