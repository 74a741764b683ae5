//! What a device can do over its whole workspace, for whoever designs one.
//!
//! | file | what |
//! |---|---|
//! | [`grid`] | named grids of places with weights: every mean says which one it is over |
//! | [`local`] | the indices of one posture |
//! | [`global`] | means, extremes and counts over a grid |
//! | [`cones`] | passive sets, pseudo friction cones, one-brake paths |
//! | [`inscribed`] | the largest circle in a workspace |
//! | [`linkages`] | designs as lists of numbers: bounds, and back to a linkage |
//! | [`symmetric`] | the search of Singh, Saha & Manivannan over a symmetric five-bar |
//! | [`mobility`] | degrees of freedom by counting links and joints |
//! | `optimise` | better designs, by the published method and by a global one |
//!
//! Places are poses of the handle in B, metres and radians; forces newtons. Plain functions of
//! a linkage: no clock, no file, no picture.

pub mod cones;
pub mod global;
pub mod grid;
pub mod inscribed;
pub mod linkages;
pub mod local;
pub mod mobility;
#[cfg(feature = "design")]
pub mod optimise;
pub mod symmetric;

pub use global::{GlobalIndices, turns_about_base};
pub use grid::{Annulus, Grid, Mean, Place, Raster};
pub use local::{ConditionClass, LocalIndices, RayIndices, moment_length_m};
