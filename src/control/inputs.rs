//! What a tick was given beside the big things: enough, with them, to run it again.
//!
//! A [`super::Setpoint`] and a [`super::Plan`] are named by their numbers, so that a record
//! stays small; whoever hands them to the loop tells the recorder what they were.

use super::{DeviceError, ModeCommand, Sample};

/// Commands carried out before one tick: bounded; the rest waits for the next one.
pub const COMMANDS_PER_TICK: usize = 2;

/// What was obeyed at a tick's edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Obeyed {
    /// A mode was asked for, and allowed or not.
    Mode(ModeCommand),
    /// The handle was said to be at its home place, and believed or not.
    Home,
    /// The plan of this generation was put in force.
    Plan(u64),
    /// The state was copied as it was then.
    Snapshot,
}

/// The inputs of one tick; its time is in the report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inputs {
    /// What the device sensed, or why not.
    pub sample: Result<Sample, DeviceError>,
    /// Ticks in a row that were not done when the next was due.
    pub overruns_in_row: u32,
    /// Number of the setpoint used, 0 for none ever.
    pub setpoint: u64,
    /// Generation of the plan in force.
    pub plan: u64,
    /// What was obeyed before, in its order.
    pub obeyed: [Option<Obeyed>; COMMANDS_PER_TICK],
}

impl Default for Inputs {
    fn default() -> Self {
        Self {
            sample: Ok(Sample::default()),
            overruns_in_row: 0,
            setpoint: 0,
            plan: 0,
            obeyed: [None; COMMANDS_PER_TICK],
        }
    }
}
