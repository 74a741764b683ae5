//! The control plane: everything that can be asked of a running device, as one closed enum.

use super::{ControlState, Mode, ModeCommand, ModeRefusal, Plan};

/// Something to be done at a tick's edge.
#[derive(Debug)]
pub enum ControlCommand {
    /// Change the mode.
    Mode(ModeCommand),
    /// Put this configuration in force.
    SwapPlan(Box<Plan>),
}

/// What came of it.
#[derive(Debug)]
pub enum ControlReply {
    /// The mode after the command, or why not.
    Mode(Result<Mode, ModeRefusal>),
    /// The configuration that was in force until now, to be freed by whoever receives it.
    Retired(Box<Plan>),
}

impl ControlState {
    /// Carries out one command. Neither allocates nor frees.
    pub fn apply(&mut self, command: ControlCommand, plan: &mut Box<Plan>) -> ControlReply {
        match command {
            ControlCommand::Mode(command) => ControlReply::Mode(self.command(command)),
            ControlCommand::SwapPlan(next) => {
                self.forget_slots_not_in(&next);
                ControlReply::Retired(std::mem::replace(plan, next))
            }
        }
    }
}
