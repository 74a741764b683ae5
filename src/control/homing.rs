//! Where incremental encoders count from: nowhere, until somebody says where the handle is.
//!
//! ```text
//!            Home, while disabled               the device was disconnected
//!   Unknown ─────────────────────▶ counts are those of the home posture ─────▶ Unknown
//! ```
//!
//! Absolute encoders count from shaft angle zero and need nothing of this. Until a device with
//! incremental ones is homed its place is unknown: it has no estimate and cannot be enabled.

use serde::{Deserialize, Serialize};

use super::{ControlState, Mode, Plan};
use crate::notation::MAX_ACTUATORS;

/// Why the counts of this moment were not taken for those of the home posture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HomeRefusal {
    /// There is nothing to be told.
    #[error("Home is not needed: the encoders are absolute and always know where the handle is")]
    Absolute,
    /// Somebody may be holding on to what is rendered.
    #[error("Home is not possible in mode {mode:?}: disable the device first")]
    NotDisabled {
        /// The mode it was asked in.
        mode: Mode,
    },
    /// The device says nothing.
    #[error("Home is not possible: the device gave no sample in the last tick")]
    NoSample,
}

/// What the estimator knows of its encoders.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Homing {
    /// Counts of the last tick; `None`: it had no sample.
    newest: Option<[i64; MAX_ACTUATORS]>,
    /// Counts at the home posture, of incremental encoders.
    home: Option<[i64; MAX_ACTUATORS]>,
}

impl Homing {
    /// The counts that a tick sensed, or that it sensed none.
    pub fn see(&mut self, counts: Option<[i64; MAX_ACTUATORS]>) {
        self.newest = counts;
    }

    /// The device was gone: what counted may have begun anew.
    pub fn forget(&mut self) {
        *self = Self::default();
    }

    /// True when the shafts' angles can be told.
    pub fn is_done(&self, plan: &Plan) -> bool {
        plan.home_rad.is_none() || self.home.is_some()
    }

    /// Angle of a shaft from its count.
    pub fn shaft_rad(&self, plan: &Plan, i: usize, count: i64, rad_per_count: f64) -> f64 {
        match (&plan.home_rad, &self.home) {
            (Some(home_rad), Some(home)) => {
                count.saturating_sub(home[i]) as f64 * rad_per_count + home_rad[i]
            }
            _ => count as f64 * rad_per_count,
        }
    }
}

impl ControlState {
    /// The handle is at its home place now. At a tick's edge.
    pub(crate) fn home(&mut self, plan: &Plan) -> Result<(), HomeRefusal> {
        if plan.home_rad.is_none() {
            return Err(HomeRefusal::Absolute);
        }
        if self.mode != Mode::Disabled {
            return Err(HomeRefusal::NotDisabled { mode: self.mode });
        }
        let homing = self.estimator.homing_mut();
        homing.home = Some(homing.newest.ok_or(HomeRefusal::NoSample)?);
        self.estimator.reset();
        self.forget_surfaces();
        // Nobody moved the handle from the old place to this one.
        self.tool = None;
        Ok(())
    }
}
