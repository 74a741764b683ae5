//! Cho, Song & Kim 2005, "A haptic device with brakes": its table and figures beside ours, its
//! conclusions judged, and the wall-following table.
//!
//! | file | what |
//! |---|---|
//! | `arm` | Figures 1 to 4: the two-link arm, Eq 3 and 5, cones and paths |
//! | `regions` | Figures 6 and 8: coupled motion, passive sets and cones of four brakes, the rule |
//! | `design` | Table I and Figure 9: means over many grids, and the searches |
//! | `wall` | Figures 11 and 13 to 15: the paper's wall, place by place and moment by moment |
//! | `table`, `digest` | all laws on all courses: CSV, and what a person reads of it |
//! | `conclusions`, `page`, `past` | verdicts and text |

mod arm;
mod conclusions;
mod design;
mod digest;
mod page;
mod past;
mod regions;
mod table;
mod wall;

pub use arm::{Arm, figure_1, figure_3};
pub use conclusions::conclusions;
pub use design::{Designs, GridRow};
pub use page::page;
pub use regions::Regions;
pub use table::{csv, study};
pub use wall::{PLACES_M, Snapshot, Stretch, Wall};

use std::sync::atomic::AtomicBool;

use crate::analysis::experiment::wall_following::{Found, Row, StudyError};
use crate::analysis::wall_following::{ExperimentError, OwnLaw};

/// Devices of the paper: before and after its optimisation.
pub const DEVICES: [&str; 2] = ["cho-2005-unoptimised", "cho-2005"];

/// All figures of the page.
#[derive(Clone, Debug)]
pub struct Cho {
    /// Few laws and courses, few starts.
    pub quick: bool,
    /// Figures 1 to 4.
    pub arm: Arm,
    /// Figures 6 and 8.
    pub regions: Regions,
    /// Table I, Figure 9.
    pub designs: Designs,
    /// Figures 11 to 15.
    pub wall: Wall,
    /// The wall-following table.
    pub rows: Vec<Row>,
}

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum ChoError {
    /// A built-in device cannot be there.
    #[error(transparent)]
    Posture(#[from] crate::mechanism::KinematicsError),
    /// A built-in device is not what it was.
    #[error(transparent)]
    Device(#[from] crate::config::ConfigError),
    /// A slide did not begin.
    #[error(transparent)]
    Slide(#[from] ExperimentError),
    /// A slide of the table failed.
    #[error(transparent)]
    Table(#[from] StudyError),
    /// The table was not finished.
    #[error("stopped after {done} of {all} slides; nothing was written")]
    Stopped {
        /// Slides that were done.
        done: usize,
        /// Slides of the table.
        all: usize,
    },
}

/// Slides and starts of a run: how often `done` is called.
pub fn steps(quick: bool) -> u64 {
    table::study(quick).runs() as u64 + design::starts(quick)
}

/// Computes everything. `done` is called after every slide and every start of a search, from
/// any thread; `stop` ends it.
pub fn measure(quick: bool, done: &(dyn Fn() + Sync), stop: &AtomicBool) -> Result<Cho, ChoError> {
    let none = |_: &str| -> Result<Box<dyn OwnLaw>, String> { Err("no own law here".to_owned()) };
    Ok(Cho {
        quick,
        arm: arm::measure()?,
        regions: regions::measure()?,
        wall: wall::measure()?,
        rows: whole(table::study(quick).run(&none, done, stop)?)?,
        designs: design::measure(quick, done)?,
    })
}

/// The rows of a study that was not stopped.
fn whole(found: Found) -> Result<Vec<Row>, ChoError> {
    let [done, all] = found.slides;
    if found.is_complete() { Ok(found.rows) } else { Err(ChoError::Stopped { done, all }) }
}

/// A direction in the plane.
fn along(angle_rad: f64) -> crate::notation::PlaneVector {
    crate::notation::PlaneVector::new(angle_rad.cos(), angle_rad.sin(), 0.0)
}

/// Pearson's correlation of pairs; zero where one of them does not change.
fn correlation(pairs: &[[f64; 2]]) -> f64 {
    let count = pairs.len().max(1) as f64;
    let mean = |k: usize| pairs.iter().map(|pair| pair[k]).sum::<f64>() / count;
    let middle = [mean(0), mean(1)];
    let product = |a: usize, b: usize| -> f64 {
        pairs.iter().map(|pair| (pair[a] - middle[a]) * (pair[b] - middle[b])).sum()
    };
    let spread = (product(0, 0) * product(1, 1)).sqrt();
    if spread > 0.0 { product(0, 1) / spread } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_correlation_is_one_on_a_line_and_nothing_without_a_change() {
        let line: Vec<[f64; 2]> =
            (0..9).map(|k| [f64::from(k), 3.0 - 2.0 * f64::from(k)]).collect();
        assert!((correlation(&line) + 1.0).abs() < 1e-12);
        assert_eq!(correlation(&[[1.0, 2.0], [1.0, 3.0]]), 0.0);
    }
}
