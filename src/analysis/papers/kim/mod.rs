//! Kim, Chung, Yi & Suh 2003, "Force distribution algorithms for singularity-free 3-DOF parallel
//! haptic device with redundant actuation": its figures beside ours, its conclusions judged.
//!
//! The paper has no table and, beside the figures, three numbers: links of 0.1 m, chains 120
//! degrees apart, a limit of 0.4 N m. What its figures show is compared in kind.

mod conclusions;
mod measure;
mod page;

pub use conclusions::conclusions;
pub use measure::{Kim, Ranks, Spread, Story, TILT_RAD, measure};
pub use page::page;
