//! hapticd: a networked haptic server.
#![allow(non_snake_case)] // names carry frames: `p_BH`, `F_BH_N`

pub mod actuation;
pub mod control;
pub mod device;
pub mod environment;
pub mod link;
pub mod mechanism;
pub mod notation;
pub mod proto;
pub mod rt;
pub mod units;
