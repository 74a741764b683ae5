//! All integration tests, in one binary.
// Names carry frames: `p_BH`, `F_BH_N`.
#![allow(non_snake_case)]

#[cfg(feature = "net")]
mod commands;
#[cfg(feature = "net")]
mod hostile;
#[cfg(feature = "net")]
mod metrics;
#[cfg(feature = "net")]
mod patience;
#[cfg(feature = "net")]
mod persistence;
#[cfg(feature = "net")]
mod recording;
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
