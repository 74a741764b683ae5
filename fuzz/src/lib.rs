//! What the fuzz targets do: each module turns bytes into calls and says what must hold.
//!
//! A target in `targets/` only calls a function of here, so the same checks can be run on a
//! file without libFuzzer (`examples/replay.rs`). Whatever does not hold is a panic.

#![allow(non_snake_case)]
// names carry frames and units, as in hapticd

pub mod accesses;
pub mod connect_strings;
pub mod datagrams;
pub mod frames;
pub mod messages;
pub mod objects;
pub mod packets;
pub mod recordings;
pub mod script;
pub mod sessions;
pub mod settings;
pub mod states;
pub mod texts;
pub mod ticks;

// What `packets` looks at: files of the library that need neither socket nor clock, and the
// modules of the core that they name.
use hapticd::{session, wire};

#[path = "../../src/net/associations.rs"]
#[allow(dead_code)]
mod associations;
#[path = "../../src/sealed/mod.rs"]
#[allow(dead_code, unused_imports)]
mod sealed;

/// A target: its name and what it does with an input.
pub type Target = (&'static str, fn(&[u8]));

/// All of them.
pub const TARGETS: [Target; 14] = [
    ("access", accesses::check),
    ("connect_string", connect_strings::check),
    ("datagram", datagrams::check),
    ("device_file", texts::check_device_file),
    ("frames", frames::check),
    ("object_message", objects::check),
    ("recording", recordings::check),
    ("scene_file", texts::check_scene_file),
    ("sealed", packets::check),
    ("server_file", texts::check_server_file),
    ("session_events", sessions::check),
    ("settings", settings::check),
    ("state", states::check),
    ("tick", ticks::check),
];
