//! hapticd: a networked haptic server.
#![allow(non_snake_case)] // names carry frames: `p_BH`, `F_BH_N`

pub mod environment;
pub mod notation;
pub mod proto;
pub mod units;
