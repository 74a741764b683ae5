//! All integration tests, in one binary.
// Names carry frames: `p_BH`, `F_BH_N`.
#![allow(non_snake_case)]

#[cfg(feature = "net")]
mod attacks;
#[cfg(feature = "net")]
mod bad_network;
#[cfg(feature = "net")]
mod commands;
#[cfg(feature = "net")]
mod credentials;
#[cfg(all(feature = "net", feature = "design"))]
mod design;
mod devices;
#[cfg(feature = "net")]
mod explain;
#[cfg(feature = "net")]
mod homing;
#[cfg(feature = "net")]
mod hostile;
#[cfg(feature = "net")]
mod manipulability;
#[cfg(feature = "net")]
mod metrics;
#[cfg(feature = "net")]
mod objects;
#[cfg(feature = "net")]
mod pairing;
#[cfg(feature = "net")]
mod patience;
#[cfg(feature = "net")]
mod persistence;
#[cfg(feature = "net")]
mod recording;
#[cfg(feature = "net")]
mod refusals;
#[cfg(feature = "net")]
mod scene_commands;
#[cfg(feature = "net")]
mod services;
mod sessions;
#[cfg(feature = "net")]
mod settings;
#[cfg(feature = "net")]
mod shares;
#[cfg(feature = "net")]
mod stream;
#[cfg(feature = "net")]
mod support;
mod tidy;
#[cfg(feature = "net")]
mod top;
mod transports;
mod vectors;
#[cfg(feature = "net")]
mod watches;
