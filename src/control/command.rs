//! The control plane: everything that can be asked of a running device, as one closed enum.

use super::{ControlState, HomeRefusal, Mode, ModeCommand, ModeRefusal, Obeyed, Plan};

/// Something to be done at a tick's edge.
#[derive(Debug)]
pub enum ControlCommand {
    /// Change the mode.
    Mode(ModeCommand),
    /// The handle is at its home place now: the encoders count from there.
    Home,
    /// Put this configuration in force.
    SwapPlan(Box<Plan>),
    /// Copy the state as it is into this one, which is as new.
    Snapshot(Box<ControlState>),
}

impl ControlCommand {
    /// What a record says of it.
    pub fn obeyed(&self) -> Obeyed {
        match self {
            Self::Mode(command) => Obeyed::Mode(*command),
            Self::Home => Obeyed::Home,
            Self::SwapPlan(plan) => Obeyed::Plan(plan.generation),
            Self::Snapshot(_) => Obeyed::Snapshot,
        }
    }
}

/// What came of it.
#[derive(Debug)]
pub enum ControlReply {
    /// The mode after the command, or why not.
    Mode(Result<Mode, ModeRefusal>),
    /// The place is known from now on, or why not.
    Home(Result<(), HomeRefusal>),
    /// The configuration that was in force until now, to be freed by whoever receives it.
    Retired(Box<Plan>),
    /// The state as it was.
    Snapshot(Box<ControlState>),
}

impl ControlState {
    /// Carries out one command. Neither allocates nor frees.
    pub fn apply(&mut self, command: ControlCommand, plan: &mut Box<Plan>) -> ControlReply {
        match command {
            ControlCommand::Mode(command) => ControlReply::Mode(self.switch(command, plan)),
            ControlCommand::Home => ControlReply::Home(self.home(plan)),
            ControlCommand::SwapPlan(next) => {
                self.forget_slots_not_in(&next);
                ControlReply::Retired(std::mem::replace(plan, next))
            }
            ControlCommand::Snapshot(mut copy) => {
                copy.copy_from(self, plan);
                ControlReply::Snapshot(copy)
            }
        }
    }

    /// A change of mode; a device whose place is not known is not enabled.
    pub(crate) fn switch(
        &mut self,
        command: ModeCommand,
        plan: &Plan,
    ) -> Result<Mode, ModeRefusal> {
        let mode = self.mode();
        if mode.after(command)? == Mode::Enabled && !self.estimator.is_homed(plan) {
            let hint = "put the handle at its home place and home the device first";
            return Err(ModeRefusal { command, mode, hint });
        }
        self.command(command)
    }
}
