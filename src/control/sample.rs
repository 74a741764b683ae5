//! What a device hands to a tick and what it takes back.

use serde::{Deserialize, Serialize};

use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector};

/// What was sensed at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Encoder counts of the actuator shafts; zero is shaft angle zero.
    pub counts: [i64; MAX_ACTUATORS],
    /// Wrench that the hand puts on the handle, in B. `None`: no sensor, unknown, not zero.
    pub F_hand_BH_N: Option<PlaneVector>,
    /// Buttons held down, bit 0 first.
    pub buttons: u32,
}

impl Default for Sample {
    fn default() -> Self {
        Self { counts: [0; MAX_ACTUATORS], F_hand_BH_N: None, buttons: 0 }
    }
}

#[cfg(test)]
impl Sample {
    /// What encoders show of a handle at this place; no force sensor.
    pub(crate) fn at(plan: &super::Plan, p_BH: &PlaneVector) -> Self {
        let posture = plan.mechanism.posture_at(p_BH).expect("inside");
        let mut sample = Self::default();
        for i in 0..plan.mechanism.actuators() {
            let counts = posture.shaft_rad[i] * plan.actuators.counts_per_revolution[i];
            sample.counts[i] = (counts / std::f64::consts::TAU).floor() as i64;
        }
        sample
    }
}

/// Why a device gave no sample or took no command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceError {
    /// Nothing came within the device's deadline.
    #[error("the device did not answer in time")]
    Timeout,
    /// The device is gone.
    #[error("the device is disconnected")]
    Disconnected,
    /// It answered something that makes no sense.
    #[error("the device answered something malformed")]
    Malformed,
}

impl DeviceError {
    /// Every kind, in the order of declaration.
    pub const ALL: [Self; 3] = [Self::Timeout, Self::Disconnected, Self::Malformed];

    /// The name used in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Timeout => "timeout",
            Self::Disconnected => "disconnected",
            Self::Malformed => "malformed",
        }
    }
}

/// What one actuator is told. A brake is given a *capacity*: it resists its shaft with up to
/// that torque, whichever way it turns, so a wrong estimate of a sign can only be a wrong
/// force, never an injection of energy.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ActuatorCommand {
    /// Resist with up to this torque; never negative.
    Brake { capacity_Nm: f64 },
    /// Apply this torque.
    Motor { torque_Nm: f64 },
}

impl ActuatorCommand {
    /// The number in it: capacity or torque.
    pub fn value_Nm(self) -> f64 {
        match self {
            Self::Brake { capacity_Nm } => capacity_Nm,
            Self::Motor { torque_Nm } => torque_Nm,
        }
    }
}

/// One command per actuator; entries beyond the device's actuators release a brake.
pub type ActuatorCommands = [ActuatorCommand; MAX_ACTUATORS];

/// Everything released.
pub const RELEASED: ActuatorCommands = [ActuatorCommand::Brake { capacity_Nm: 0.0 }; MAX_ACTUATORS];

/// The numbers of a set of commands.
pub fn values_Nm(commands: &ActuatorCommands) -> ActuatorVector {
    ActuatorVector::from_fn(|i, _| commands[i].value_Nm())
}
