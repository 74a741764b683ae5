//! Devices: where samples come from and commands go.
//!
//! A [`Device`] is owned by the real-time thread and called once per tick each way; neither
//! call may allocate, lock, log or block beyond the device's own deadline. Devices depend
//! on the types of `control`, never the reverse, so the law cannot tell one from another.
//!
//! ```text
//! SimulatedDevice = Hand ─▶ Plant ─▶ Sensors        FaultInjector<D> wraps any of them
//! ```

mod fault_injector;
mod hand;
mod plant;
mod sensors;
mod simulated;

pub use fault_injector::{Episode, FaultInjector, Injection, episodes};
pub use hand::{
    CircleProgram, Grip, HandAction, HandProgram, HandPull, Pointer, PointerInput, PointerTarget,
    RandomProgram, SlideProgram, UnknownHandProgram,
};
pub use plant::{Energy, Imperfections, Plant, PlantParameters};
pub use sensors::{ForceSensor, Sensors};
pub use simulated::{LONGEST_GAP_NS, SUBSTEP_NS, SimulatedDevice, SimulationParameters, Truth};

use crate::control::{ActuatorCommands, DeviceError, Sample};

/// Something with a handle, encoders and actuators.
pub trait Device: Send {
    /// Senses now. `now_ns` is the device clock.
    fn read(&mut self, now_ns: u64) -> Result<Sample, DeviceError>;
    /// Commands the actuators, until the next call.
    fn write(&mut self, commands: &ActuatorCommands) -> Result<(), DeviceError>;
}
