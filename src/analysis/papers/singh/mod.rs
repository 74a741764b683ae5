//! Singh, Saha & Manivannan, "Synthesis of two degrees-of-freedom haptic device": its table and
//! figures beside ours, its conclusions judged.
//!
//! Lengths in centimetres, as the paper has them, but for forces and torques (SI).

mod brute;
mod conclusions;
mod measure;
mod page;

pub use brute::{Brute, FIGURE_4, Parallel};
pub use conclusions::conclusions;
pub use measure::{
    Axis, Force, OPTIMUM, Singh, Winner, best_by_share, finest_by_share, measure, winners,
};
pub use page::page;
