//! One tick: what was sensed, what is wanted and what is configured become one decision.
//!
//! ```text
//! Sample ─▶ estimate ─▶ desire ─▶ bound ─▶ allocate ─▶ guard ─▶ Decision
//! ```
//!
//! [`tick`] is a pure step of a [`ControlState`]: no clock, no device, no socket, and the
//! same for hardware, simulation, replay and tests. Data comes in three drawers: [`Plan`]
//! (configuration, immutable), [`Setpoint`] and [`Sample`] (what is wanted and sensed), and
//! [`Report`] (what was decided, and why).
#![cfg_attr(
    not(test),
    deny(clippy::disallowed_types, clippy::disallowed_methods, clippy::disallowed_macros)
)]

mod activation;
mod command;
mod desire;
mod estimate;
mod guard;
mod homing;
mod inputs;
mod limits;
mod mode;
mod passivity;
mod plan;
mod report;
mod sample;
mod setpoint;
mod snapshot;
mod stability;
mod stale;
mod state;
mod tick;
mod walls;

pub use command::{ControlCommand, ControlReply};
pub use estimate::Estimate;
pub use homing::HomeRefusal;
pub use inputs::{COMMANDS_PER_TICK, Inputs, Obeyed};
pub use limits::{Limit, Limits};
pub use mode::{Fault, Mode, ModeCommand, ModeRefusal};
pub use plan::{Actuators, Guards, Mount, Plan, Tool};
pub use report::{ContactResult, Event, MAX_EVENTS, Record, RenderedSource, Report, Wrench};
pub use sample::{ActuatorCommand, ActuatorCommands, DeviceError, RELEASED, Sample, values_Nm};
pub use setpoint::Setpoint;
pub use stability::least_damping_N_s_per_m;
pub use state::ControlState;
pub use tick::{Decision, TickInput, tick};

#[cfg(test)]
mod fade_tests;
#[cfg(test)]
mod gain_tests;
#[cfg(test)]
mod homing_tests;
#[cfg(test)]
mod passivity_tests;
#[cfg(test)]
mod plate_tests;
#[cfg(test)]
mod touch_tests;
