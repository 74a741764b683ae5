//! Sessions: whatever clients send, in whatever order, somebody's rules hold after every step.
//!
//! A script connects clients to a server of two devices, lets them say Hello, command, ping,
//! say nonsense, vanish and take the lease from each other, while time passes and the devices
//! tick with what they were told. [`world`] is that server and those clients; [`rules`] and
//! [`setpoints`] say what must be true of everything that comes out.

mod rules;
mod setpoints;
mod world;

use crate::script::Script;
use world::World;

/// Steps of one input: enough for everything to happen, short enough to be quick.
const MOST_STEPS: usize = 600;

/// What happened in a script.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// Clients that were welcomed.
    pub welcomed: u64,
    /// Setpoints that were handed to a device.
    pub setpoints: u64,
}

/// A script of events.
pub fn check(data: &[u8]) {
    run(data);
}

/// The same, and tells what happened.
pub fn run(data: &[u8]) -> Seen {
    let script = &mut Script::new(data);
    let mut world = World::new(script);
    let mut steps = 0;
    while !script.is_over() && steps < MOST_STEPS {
        world.step(script);
        steps += 1;
    }
    world.end()
}
