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
mod three_rrr;
mod two_link;
mod working_mode;

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
pub use three_rrr::{PSI_RAD, ThreeRrr, ThreeRrrJacobians, ThreeRrrParameters};
pub use two_link::{TwoLink, TwoLinkParameters};
pub use working_mode::WorkingMode;

use std::sync::Arc;

use crate::notation::{ActuatorVector, HandleInertia, PlaneVector, ReferenceMatrix};

/// Most segments of a drawing: two links per chain of the 3-RRR, and its plate.
pub const MAX_SEGMENTS: usize = 9;

/// Joints in B as line segments `(from, to)`, metres.
pub type Outline = [([f64; 2], [f64; 2]); MAX_SEGMENTS];

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
    /// How far from singular, 0 to 1: the least |sine| of an angle between two links that span
    /// a distance together. Never below [`LEAST_MARGIN`].
    pub margin: f64,
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
    fn outline(&self, posture: &Posture, out: &mut Outline) -> usize;
    /// Smallest and largest distance from the origin of B that the handle can reach whatever
    /// its bearing, and its turn within [`Mechanism::turn_rad`], metres. A smallest of zero at
    /// a regular posture is no edge.
    fn reach_m(&self) -> (f64, f64);
    /// How far the handle can turn to either side of phi = 0, where its turn is a freedom.
    fn turn_rad(&self) -> f64 {
        std::f64::consts::PI
    }
    /// True where the inertia at the handle changes from place to place.
    fn inertia_varies(&self) -> bool;
    /// How its elbows bend.
    fn working_mode(&self) -> WorkingMode {
        WorkingMode::default()
    }
    /// The same linkage with its elbows bent like this; `None`: it has others. For analysis,
    /// not for a tick.
    fn in_working_mode(&self, _: &WorkingMode) -> Option<Arc<dyn Mechanism>> {
        None
    }
}
