//! What the world wants the hand to feel: shapes, materials and fields, asked point by point.
//!
//! Everything is in W, metres and newtons. A scene's elements and a controller's
//! contacts are the same primitives; what they want at the tool point is a [`Desired`]:
//! stiff things become *constraints* (a law on brakes needs their normal), fields become a
//! *soft* force. The module keeps no time and no device: what has to be remembered from
//! tick to tick is a [`SurfaceState`] that the caller owns.
#![cfg_attr(
    not(test),
    deny(clippy::disallowed_types, clippy::disallowed_methods, clippy::disallowed_macros)
)]

mod desired;
mod element;
mod force_field;
mod surface;

pub use desired::{Constraint, Contact, Desired, MAX_CONSTRAINTS, MAX_CONTACTS, Source, Tool};
pub use element::{Element, MAX_OBJECTS, SceneItem};
pub use force_field::ForceField;
pub use surface::{Material, Shape, Surface, SurfaceState, Touch};
