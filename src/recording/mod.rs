//! Recordings: what ticks saw and decided as a file, run again bit by bit, and compared.
//!
//! ```text
//! Record, Setpoint, Plan, ControlState ─▶ Recorder ─▶ segments ─▶ black box, files
//! file ─▶ Recorded ─┬─▶ replay    the same law on the same samples: every bit of every report
//!                   └─▶ compare   two laws on the same hand, in virtual time ─▶ picture
//! ```
//!
//! A tick is pure, so a recording is its inputs, one state to begin with, and its outputs to
//! compare with. A *segment* begins with a snapshot of the state and names every plan and
//! setpoint it needs, so each can be replayed without those before. Ticks, with their reports,
//! are plain protobuf (`record.proto`) that any language reads; what only a replay needs is
//! stored by serde, bit by bit, and read back by the same version alone.
//!
//! Frames and units are those of `control`. No thread, no file and no clock in here, and
//! nothing of it runs in a tick.

mod compare;
mod exact;
mod file;
mod measures;
mod picture;
mod recorder;
mod replay;
mod report;
mod tick;

pub use compare::{CompareError, Comparison, Hand, Run, compare};
pub use exact::{plan_entry, snapshot_entry};
pub use file::{End, FileError, LAYOUT, Recorded, header};
pub use measures::{Measures, measure};
pub use picture::draw;
pub use recorder::{BlackBox, Delivery, Message, Recorder, Sink};
pub use replay::{Difference, Gap, Verdict, replay};

#[cfg(test)]
mod tests;
