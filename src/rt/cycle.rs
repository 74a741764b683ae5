//! One turn of a device: commands, read, tick, write, hand over.
#![cfg_attr(
    not(test),
    deny(clippy::disallowed_types, clippy::disallowed_methods, clippy::disallowed_macros)
)]

use super::guard::no_alloc;
use crate::control::{
    COMMANDS_PER_TICK, ControlCommand, ControlReply, ControlState, Decision, Inputs, Obeyed, Plan,
    RELEASED, Record, Report, Setpoint, TickInput, tick,
};
use crate::device::Device;
use crate::link::RtEnd;

/// The bridges of a device, with what they really carry.
/// A command carries a number, and its reply the same.
pub type DeviceLink = RtEnd<Setpoint, Report, Record, (u64, ControlCommand), (u64, ControlReply)>;

/// A device with its law and its bridges.
pub struct Cycle<D: Device> {
    device: D,
    state: ControlState,
    plan: Box<Plan>,
    link: DeviceLink,
    overruns_in_row: u32,
    /// When the tick before was due.
    last_due_ns: Option<u64>,
}

impl<D: Device> Cycle<D> {
    /// Takes everything that a turn needs.
    pub fn new(device: D, state: ControlState, plan: Box<Plan>, link: DeviceLink) -> Self {
        Self { device, state, plan, link, overruns_in_row: 0, last_due_ns: None }
    }

    /// Time between turns.
    pub fn tick_ns(&self) -> u64 {
        self.plan.tick_ns
    }

    /// The device, for tests that look behind the encoders.
    pub fn device(&self) -> &D {
        &self.device
    }

    /// One turn at `now_ns`, which was due at `due_ns`. `clock` tells the time when asked,
    /// for the durations in the record; in virtual time it stands still.
    pub fn turn(&mut self, due_ns: u64, now_ns: u64, clock: impl Fn() -> u64) -> Report {
        no_alloc(|| {
            let obeyed = self.obey();
            let obeyed_ns = clock();
            let mut device_error = None;
            let sample = self.device.read(now_ns).inspect_err(|error| device_error = Some(*error));
            let sensed_ns = clock();
            let (decision, setpoint) = self.decide(sample, now_ns);
            let decided_ns = clock();
            if let Err(error) = self.device.write(&decision.commands) {
                device_error = Some(error);
            }
            let done_ns = clock();
            let inputs = Inputs {
                sample,
                overruns_in_row: self.overruns_in_row,
                setpoint,
                plan: self.plan.generation,
                obeyed,
            };
            let overrun = done_ns >= due_ns + self.plan.tick_ns;
            self.overruns_in_row = if overrun { self.overruns_in_row.saturating_add(1) } else { 0 };
            let record = Record {
                report: decision.report,
                wakeup_lateness_ns: now_ns.saturating_sub(due_ns),
                execution_ns: obeyed_ns.saturating_sub(now_ns)
                    + decided_ns.saturating_sub(sensed_ns),
                device_io_ns: sensed_ns.saturating_sub(obeyed_ns)
                    + done_ns.saturating_sub(decided_ns),
                overrun,
                skipped_ticks: self.skipped_before(due_ns),
                reports_dropped: self.link.dropped(),
                device_error,
                inputs,
            };
            self.link.publish(decision.report, record);
            decision.report
        })
    }

    /// Ticks on the grid between the last one and the one that was due now.
    fn skipped_before(&mut self, due_ns: u64) -> u64 {
        let last_ns = self.last_due_ns.replace(due_ns);
        let ticks = last_ns.map_or(1, |last_ns| due_ns.saturating_sub(last_ns) / self.plan.tick_ns);
        ticks.saturating_sub(1)
    }

    /// Lets go of the hand.
    fn release(&mut self) {
        let mut commands = RELEASED;
        for (command, kind) in commands.iter_mut().zip(self.plan.actuators.kinds) {
            if kind == crate::actuation::ActuatorKind::Motor {
                *command = crate::control::ActuatorCommand::Motor { torque_Nm: 0.0 };
            }
        }
        // Nobody is left to be told of a device that does not listen either.
        let _ = self.device.write(&commands);
    }

    fn obey(&mut self) -> [Option<Obeyed>; COMMANDS_PER_TICK] {
        let mut obeyed = [None; COMMANDS_PER_TICK];
        for obeyed in &mut obeyed {
            let Some((number, command)) = self.link.next_command() else { break };
            *obeyed = Some(command.obeyed());
            let reply = self.state.apply(command, &mut self.plan);
            self.link.reply((number, reply));
        }
        obeyed
    }

    /// The decision, and the number of the setpoint that it followed.
    fn decide(
        &mut self,
        sample: Result<crate::control::Sample, crate::control::DeviceError>,
        now_ns: u64,
    ) -> (Decision, u64) {
        let setpoint = self.link.setpoint();
        let input = TickInput {
            sample,
            setpoint,
            plan: &self.plan,
            now_ns,
            overruns_in_row: self.overruns_in_row,
        };
        (tick(&mut self.state, &input), setpoint.number)
    }
}

/// However the thread ends, a panic included, nobody is left held.
impl<D: Device> Drop for Cycle<D> {
    fn drop(&mut self) {
        self.release();
    }
}

#[cfg(test)]
#[path = "cycle_tests.rs"]
mod tests;
