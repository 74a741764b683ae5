//! Limits: the reasons, tick by tick, why something else was rendered than was asked.
//!
//! A limit is a passing fact in every report. A fault latches; see [`super::Fault`].

use serde::{Deserialize, Serialize};

/// One reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Limit {
    /// An actuator is at its torque limit.
    Torque,
    /// The request was clipped to the force limit or to the range of the device.
    Force,
    /// The soft force changes faster than allowed.
    Slew,
    /// The controller fell silent and its force is fading out.
    Stale,
    /// Part of the request lies outside the device's freedoms.
    Freedom,
    /// More contacts touch than constraints can be kept.
    Constraints,
    /// The controller's workspace is lifted off the device: nothing is rendered.
    Clutch,
    /// The device was enabled, or a gain or limit raised, a moment ago: the force still grows.
    Activation,
    /// Surfaces were softened: motors would feed the handle if they gave all of their stiffness.
    Stiffness,
    /// Part of what the controller asks is held back: motors would feed the handle more than they
    /// may.
    Passivity,
}

impl Limit {
    /// Every limit, in the order of its bit.
    pub const ALL: [Self; 10] = [
        Self::Torque,
        Self::Force,
        Self::Slew,
        Self::Stale,
        Self::Freedom,
        Self::Constraints,
        Self::Clutch,
        Self::Activation,
        Self::Stiffness,
        Self::Passivity,
    ];

    /// The name used in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Torque => "torque",
            Self::Force => "force",
            Self::Slew => "slew",
            Self::Stale => "stale",
            Self::Freedom => "freedom",
            Self::Constraints => "constraints",
            Self::Clutch => "clutch",
            Self::Activation => "activation",
            Self::Stiffness => "stiffness",
            Self::Passivity => "passivity",
        }
    }
}

/// A set of limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Limits(u32);

impl Limits {
    /// Adds a limit when `active`.
    pub fn set(&mut self, limit: Limit, active: bool) {
        if active {
            self.0 |= 1 << limit as u32;
        }
    }

    /// True when the limit is in the set.
    pub fn contains(self, limit: Limit) -> bool {
        self.0 & (1 << limit as u32) != 0
    }

    /// The set as bits: limit N of the contract is bit N-1.
    pub fn bits(self) -> u32 {
        self.0
    }
}
