//! Bytes of the stream protocol `hapticd/1` to messages and back.
//!
//! A datagram holds one message in a strict envelope; the reliable stream is a row of
//! length-prefixed messages; vectors are packed floats in W. Everything that comes in is
//! bounded before it is read, and every refusal is a typed error: nothing here panics,
//! whatever the bytes. This module knows no physics, no session and no socket: what a
//! number *means* is decided where it is mapped.

mod datagram;
mod frame;
mod state;
mod vector;
mod version;

pub use datagram::{MAX_COMMAND_BYTES, WireError, decode, encode};
pub use frame::{FrameDecoder, FrameError, MAX_FRAME_BYTES, encode_frame};
pub use state::{
    ContactPart, Detail, EventPart, MAX_STATE_BYTES, StateParts, encode_state, max_detailed_bytes,
};
pub use vector::{get_pair, get3, number, put_pair, put3};
pub use version::{PROTOCOL, choose};
