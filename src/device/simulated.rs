//! The simulated device: a hand, a plant and sensors behind the [`Device`] that hardware has.
//!
//! Time is what [`Device::read`] is told: nothing here knows a clock, so the same device runs
//! in real time, and in virtual time as fast as the machine can. A read lets the plant live
//! from the last read to now under the commands then in force, in equal steps of about half a
//! millisecond; what a command changes is sensed by the next read. The hand moves through the
//! same steps. Beyond [`LONGEST_GAP_NS`] after the last read the rest of the time is lost: the
//! work of one call stays bounded, and a stopped process does not wake up to a leap.
//! The same parameters, seed, times and commands give the same samples, bit for bit.

use std::sync::Arc;

use super::Device;
use super::hand::{Hand, HandAction, HandProgram, HandPull, Pointer};
use super::plant::{Energy, Imperfections, Plant, PlantParameters};
use super::sensors::{ForceSensor, Sensors};
use crate::actuation::ActuatorKind;
use crate::control::{ActuatorCommands, DeviceError, Sample};
use crate::mechanism::{KinematicsError, Mechanism};
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector};

#[cfg(test)]
mod tests;

/// Length of a step of plant and hand.
pub const SUBSTEP_NS: u64 = 500_000;

/// A step may be this much longer, so that a tick which is a little late has as many steps.
const SUBSTEP_STRETCH_NS: u64 = 100_000;

/// Time that one read makes up for at most.
pub const LONGEST_GAP_NS: u64 = 50_000_000;

/// What a simulated device is made of.
#[derive(Clone, Debug)]
pub struct SimulationParameters {
    /// The linkage with its inertia.
    pub mechanism: Arc<dyn Mechanism>,
    /// Brake or motor.
    pub kinds: [ActuatorKind; MAX_ACTUATORS],
    /// Most that each can be commanded; more is clipped.
    pub max_torque_Nm: ActuatorVector,
    /// Encoder counts of one turn of each shaft.
    pub counts_per_revolution: ActuatorVector,
    /// Time constant from commanded to actual torque, seconds.
    pub lag_s: ActuatorVector,
    /// Drag that is there without any command.
    pub residual_Nm: ActuatorVector,
    /// Hysteresis and backlash of the brakes.
    pub imperfections: Imperfections,
    /// Viscous drag of the shafts, N m s/rad.
    pub damping_N_m_s_per_rad: ActuatorVector,
    /// Smallest step of torque that a motor can be commanded; 0: any.
    pub resolution_Nm: ActuatorVector,
    /// `None`: the hand's force is unknown.
    pub force_sensor: Option<ForceSensor>,
    /// What the simulated hand does.
    pub hand: HandProgram,
    /// Where the handle begins, in B, metres.
    pub start_m: [f64; 2],
    /// The encoders count from zero, wherever the handle begins.
    pub incremental: bool,
}

impl SimulationParameters {
    /// The usual brake device on a linkage: 20 N m, 2 ms lag, 65,536 counts, a force sensor, no
    /// drag; with the usual hand, shrunk to the linkage's reach.
    pub fn brakes(mechanism: Arc<dyn Mechanism>) -> Self {
        let hand = HandProgram::default().fitted(mechanism.reach_m());
        Self {
            mechanism,
            kinds: [ActuatorKind::Brake; MAX_ACTUATORS],
            max_torque_Nm: ActuatorVector::repeat(20.0),
            counts_per_revolution: ActuatorVector::repeat(65_536.0),
            lag_s: ActuatorVector::repeat(2e-3),
            residual_Nm: ActuatorVector::zeros(),
            imperfections: Imperfections::default(),
            damping_N_m_s_per_rad: ActuatorVector::zeros(),
            resolution_Nm: ActuatorVector::zeros(),
            force_sensor: Some(ForceSensor::default()),
            hand,
            start_m: hand.start_m(),
            incremental: false,
        }
    }
}

/// What no sensor tells: for tests and experiments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Handle in B.
    pub p_BH: PlaneVector,
    /// Its rate.
    pub v_BH: PlaneVector,
    /// Angles of the shafts, continuous since the beginning.
    pub shaft_rad: ActuatorVector,
    /// What each actuator has reached of its command: a brake's capacity, a motor's torque.
    pub reached_Nm: ActuatorVector,
    /// What the actuators put into their shafts in the last step.
    pub torque_Nm: ActuatorVector,
    /// What the hand did in the last step.
    pub hand: HandAction,
    /// Kinetic energy.
    pub kinetic_J: f64,
    /// Where energy came from and went.
    pub energy: Energy,
}

/// A device that exists only here.
#[derive(Debug)]
pub struct SimulatedDevice {
    plant: Plant,
    hand: Hand,
    sensors: Sensors,
    action: HandAction,
    read_at_ns: Option<u64>,
}

impl SimulatedDevice {
    /// A device at rest at `start_m`. Refuses a start that the linkage cannot hold.
    pub fn new(parameters: SimulationParameters, seed: u64) -> Result<Self, KinematicsError> {
        let [x, y] = parameters.start_m;
        let p_BH = PlaneVector::new(x, y, 0.0);
        let plant = PlantParameters {
            mechanism: parameters.mechanism,
            kinds: parameters.kinds,
            max_torque_Nm: parameters.max_torque_Nm,
            lag_s: parameters.lag_s,
            residual_Nm: parameters.residual_Nm,
            imperfections: parameters.imperfections,
            damping_N_m_s_per_rad: parameters.damping_N_m_s_per_rad,
            resolution_Nm: parameters.resolution_Nm,
        };
        let plant = Plant::new(plant, &p_BH)?;
        // Hand and sensors draw from different streams: a device without a force sensor has
        // the same hand.
        let mut sensors =
            Sensors::new(&parameters.counts_per_revolution, parameters.force_sensor, !seed);
        if parameters.incremental {
            sensors.count_from(plant.shaft_rad());
        }
        Ok(Self {
            plant,
            hand: Hand::new(parameters.hand, &p_BH, seed),
            sensors,
            action: HandAction::default(),
            read_at_ns: None,
        })
    }

    /// From now on somebody else pulls the handle.
    pub fn follow(&mut self, pointer: Pointer) {
        self.hand.follow(pointer);
    }

    /// From now on this hand has the handle.
    pub fn hand_over(&mut self, hand: Box<dyn HandPull>) {
        self.hand.hand_over(hand);
    }

    /// The state as it is.
    pub fn truth(&self) -> Truth {
        Truth {
            p_BH: *self.plant.p_BH(),
            v_BH: *self.plant.v_BH(),
            shaft_rad: *self.plant.shaft_rad(),
            reached_Nm: *self.plant.reached_Nm(),
            torque_Nm: *self.plant.torque_Nm(),
            hand: self.action,
            kinetic_J: self.plant.kinetic_J(),
            energy: *self.plant.energy(),
        }
    }

    fn advance(&mut self, elapsed_ns: u64) {
        if elapsed_ns == 0 {
            return;
        }
        let elapsed_ns = elapsed_ns.min(LONGEST_GAP_NS);
        let steps = elapsed_ns.div_ceil(SUBSTEP_NS + SUBSTEP_STRETCH_NS).max(
            // Exact multiples of the step are steps of exactly that length.
            elapsed_ns / SUBSTEP_NS,
        );
        let dt_s = elapsed_ns as f64 / steps as f64 * 1e-9;
        for _ in 0..steps {
            self.action = self.hand.act(self.plant.p_BH(), self.plant.v_BH(), dt_s);
            self.plant.step(&self.action.F_hand_BH_N, dt_s);
        }
    }
}

impl Device for SimulatedDevice {
    fn read(&mut self, now_ns: u64) -> Result<Sample, DeviceError> {
        let since_ns = self.read_at_ns.unwrap_or(now_ns);
        self.advance(now_ns.saturating_sub(since_ns));
        self.read_at_ns = Some(now_ns.max(since_ns));
        Ok(self.sensors.read(self.plant.shaft_rad(), &self.action.F_hand_BH_N, self.action.buttons))
    }

    fn write(&mut self, commands: &ActuatorCommands) -> Result<(), DeviceError> {
        self.plant.command(commands);
        Ok(())
    }
}
