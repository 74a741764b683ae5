//! What the world wants the hand to feel: shapes, materials and fields, asked point by point.
//!
//! Everything is in W, metres and newtons. A scene's elements and a controller's
//! contacts are the same primitives; what they want at the tool point is a [`Desired`]:
//! stiff things become *constraints* (a law on brakes needs their normal), fields become a
//! *soft* wrench. The module keeps no time and no device: what has to be remembered from
//! tick to tick is a [`SurfaceState`] that the caller owns.
#![cfg_attr(
    not(test),
    deny(clippy::disallowed_types, clippy::disallowed_methods, clippy::disallowed_macros)
)]

mod corridor;
mod desired;
mod element;
mod force_field;
mod friction;
mod god_object;
mod material;
mod shape;
mod surface;
mod tool;

pub use corridor::{Corridor, MAX_CORRIDOR_POINTS};
pub use desired::{
    Constraint, Contact, Desired, MAX_CONSTRAINTS, MAX_CONTACTS, MAX_TOUCHES, Source,
};
pub use element::{Element, MAX_OBJECTS, SceneItem};
pub use force_field::ForceField;
pub use material::Material;
pub use shape::{Guide, Shape};
pub use surface::{Surface, SurfaceState, Touch, Touches};
pub use tool::{MAX_POINTS, Tool, ToolMotion, ToolPoint};
