//! The last look at a decision: slew of the soft force, finite numbers, commands by mode.

use super::{ActuatorCommand, ActuatorCommands, Limit, Limits, Mode, Plan};
use crate::actuation::ActuatorKind;
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector};

/// The soft force no further from the last one than the slew limit allows. Walls are not
/// soft, and letting go is never delayed: a force may shrink at once.
pub fn slewed(
    wanted_BH_N: &PlaneVector,
    last_BH_N: &PlaneVector,
    plan: &Plan,
    limits: &mut Limits,
) -> PlaneVector {
    let shrunk = last_BH_N * (wanted_BH_N.norm() / last_BH_N.norm().max(1e-12)).min(1.0);
    let change = wanted_BH_N - shrunk;
    let most_N = plan.guards.slew_N_per_s * plan.tick_s();
    let limited = change.norm() > most_N;
    limits.set(Limit::Slew, limited);
    if limited { shrunk + change * (most_N / change.norm()) } else { *wanted_BH_N }
}

/// Torques as commands that this mode allows. A brake gets a capacity, which has no sign.
pub fn commands(
    mode: Mode,
    torque_Nm: &ActuatorVector,
    plan: &Plan,
    limits: &mut Limits,
) -> ActuatorCommands {
    std::array::from_fn(|i| {
        let most_Nm = plan.actuators.max_torque_Nm[i];
        let wanted_Nm = if torque_Nm[i].is_finite() { torque_Nm[i] } else { 0.0 };
        limits.set(
            Limit::Torque,
            mode == Mode::Enabled && most_Nm > 0.0 && wanted_Nm.abs() >= most_Nm,
        );
        match (plan.actuators.kinds[i], mode) {
            (ActuatorKind::Brake, Mode::Enabled) => {
                ActuatorCommand::Brake { capacity_Nm: wanted_Nm.abs().min(most_Nm) }
            }
            (ActuatorKind::Brake, Mode::Stopped) => {
                ActuatorCommand::Brake { capacity_Nm: plan.guards.stop_capacity_Nm.min(most_Nm) }
            }
            (ActuatorKind::Brake, Mode::Disabled | Mode::Fault) => {
                ActuatorCommand::Brake { capacity_Nm: 0.0 }
            }
            (ActuatorKind::Motor, Mode::Enabled) => {
                ActuatorCommand::Motor { torque_Nm: wanted_Nm.clamp(-most_Nm, most_Nm) }
            }
            (ActuatorKind::Motor, _) => ActuatorCommand::Motor { torque_Nm: 0.0 },
        }
    })
}

/// True when any command is not zero.
pub fn engaged(commands: &ActuatorCommands) -> bool {
    (0..MAX_ACTUATORS).any(|i| commands[i].value_Nm() != 0.0)
}
