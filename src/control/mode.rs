//! Modes of a device, who may change them, and what the actuators do in each.
//!
//! ```text
//!                    Enable
//!      ┌──────────┐ ───────▶ ┌─────────┐
//!  ┌──▶│ Disabled │          │ Enabled │──┐
//!  │   └──────────┘ ◀─────── └─────────┘  │
//!  │     │     ▲     Disable      │       │
//!  │ Stop│     │Disable           │Stop   │ a fault, from any mode
//!  │     ▼     │                  │       ▼
//!  │   ┌─────────┐ ◀──────────────┘   ┌───────┐
//!  │   │ Stopped │                    │ Fault │
//!  │   └─────────┘                    └───────┘
//!  └──────────────── ClearFault ──────────┘
//! ```
//!
//! | mode | brakes | motors |
//! |---|---|---|
//! | Disabled | released | zero |
//! | Enabled | what the law says | what the law says |
//! | Stopped | hold the configured stop capacity | zero |
//! | Fault | released | zero |

use serde::{Deserialize, Serialize};

/// What the device does with forces now.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Mode {
    /// Everything released.
    #[default]
    Disabled,
    /// Rendering.
    Enabled,
    /// Stopped on purpose.
    Stopped,
    /// Latched by a [`Fault`].
    Fault,
}

/// A change of mode that somebody asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModeCommand {
    /// Begin to render.
    Enable,
    /// Release everything.
    Disable,
    /// Stop now. Needs no lease.
    Stop,
    /// Leave Fault.
    ClearFault,
}

/// A mode change that the mode does not allow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{command:?} is not possible in mode {mode:?}: {hint}")]
pub struct ModeRefusal {
    /// What was asked.
    pub command: ModeCommand,
    /// The mode it was asked in.
    pub mode: Mode,
    /// What would help.
    pub hint: &'static str,
}

impl Mode {
    /// The mode after `command`. Asking for the present mode again is not an error.
    pub fn after(self, command: ModeCommand) -> Result<Mode, ModeRefusal> {
        use ModeCommand::{ClearFault, Disable, Enable, Stop};
        match (self, command) {
            (Mode::Fault, ClearFault) => Ok(Mode::Disabled),
            (Mode::Fault, _) => Err(refusal(self, command, "clear the fault first")),
            (_, ClearFault) => Err(refusal(self, command, "there is no fault")),
            (Mode::Stopped, Enable) => Err(refusal(self, command, "disable the device first")),
            (_, Enable) => Ok(Mode::Enabled),
            (_, Disable) => Ok(Mode::Disabled),
            (_, Stop) => Ok(Mode::Stopped),
        }
    }
}

fn refusal(mode: Mode, command: ModeCommand, hint: &'static str) -> ModeRefusal {
    ModeRefusal { command, mode, hint }
}

/// Why the device latched itself. One way out: [`ModeCommand::ClearFault`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Fault {
    /// The device did not answer for several ticks.
    Device,
    /// A measured value is not a number.
    NotFinite,
    /// The shaft angles fit no posture of the linkage.
    Unreachable,
    /// The linkage is at a singular posture.
    Singular,
    /// Redundant encoders contradict each other.
    Closure,
    /// Too many ticks in a row were not done when the next was due.
    Overrun,
}

impl Fault {
    /// Every fault, for tables and metrics.
    pub const ALL: [Self; 6] = [
        Self::Device,
        Self::NotFinite,
        Self::Unreachable,
        Self::Singular,
        Self::Closure,
        Self::Overrun,
    ];

    /// The name used in metrics and logs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Device => "device",
            Self::NotFinite => "not_finite",
            Self::Unreachable => "unreachable",
            Self::Singular => "singular",
            Self::Closure => "closure",
            Self::Overrun => "overrun",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ModeCommand::{ClearFault, Disable, Enable, Stop};

    #[test]
    fn every_command_in_every_mode_has_its_answer() {
        let table = [
            (Mode::Disabled, Enable, Some(Mode::Enabled)),
            (Mode::Disabled, Disable, Some(Mode::Disabled)),
            (Mode::Disabled, Stop, Some(Mode::Stopped)),
            (Mode::Disabled, ClearFault, None),
            (Mode::Enabled, Enable, Some(Mode::Enabled)),
            (Mode::Enabled, Disable, Some(Mode::Disabled)),
            (Mode::Enabled, Stop, Some(Mode::Stopped)),
            (Mode::Enabled, ClearFault, None),
            (Mode::Stopped, Enable, None),
            (Mode::Stopped, Disable, Some(Mode::Disabled)),
            (Mode::Stopped, Stop, Some(Mode::Stopped)),
            (Mode::Stopped, ClearFault, None),
            (Mode::Fault, Enable, None),
            (Mode::Fault, Disable, None),
            (Mode::Fault, Stop, None),
            (Mode::Fault, ClearFault, Some(Mode::Disabled)),
        ];
        for (mode, command, expected) in table {
            assert_eq!(mode.after(command).ok(), expected, "{command:?} in {mode:?}");
        }
    }

    #[test]
    fn a_refusal_says_what_would_help() {
        let refusal = Mode::Stopped.after(Enable).unwrap_err();
        assert_eq!(
            refusal.to_string(),
            "Enable is not possible in mode Stopped: disable the device first"
        );
    }
}
