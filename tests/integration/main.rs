//! All integration tests, in one binary.
// Names carry frames: `p_BH`, `F_BH_N`.
#![allow(non_snake_case)]
// The bans of clippy.toml are for the real-time modules, which deny them.
#![allow(clippy::disallowed_types, clippy::disallowed_methods, clippy::disallowed_macros)]

#[cfg(feature = "net")]
mod commands;
#[cfg(feature = "net")]
mod hostile;
#[cfg(feature = "net")]
mod metrics;
#[cfg(feature = "net")]
mod persistence;
#[cfg(feature = "net")]
mod refusals;
#[cfg(feature = "net")]
mod services;
#[cfg(feature = "net")]
mod stream;
#[cfg(feature = "net")]
mod support;
mod tidy;
mod vectors;
