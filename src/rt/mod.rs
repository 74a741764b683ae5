//! The real-time thread: wake on time, read, tick, write, record.
//!
//! [`Cycle`] is one turn and knows no clock, so the same code runs in virtual time in tests
//! and experiments; [`spawn`] gives it a thread, rights, and the monotonic clock. Linux only.
//! The thread never sees a socket: it meets the network in [`crate::link`].

mod clock;
mod cycle;
mod guard;
mod rights;
mod run;
mod thread;
mod wakeups;

pub use cycle::{Cycle, DeviceLink};
pub use guard::no_alloc;
pub use rights::{Processor, Right, Rights, RightsError, fifo};
pub use thread::{Realtime, RtConfig, RtError, RtHandle, spawn};
pub use wakeups::{Wakeups, measure_wakeups};
