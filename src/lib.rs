//! hapticd: a networked haptic server for devices with brakes and motors.
//!
//! Beside the device it runs a hard 1 kHz loop; simulators anywhere push contacts and are
//! told, every tick, what was asked, what was possible, what was felt, and why.
//!
//! # Layers
//!
//! A module may `use` only what stands above it in this list; a test holds that.
//!
//! | module | one sentence |
//! |---|---|
//! | [`proto`] | the public contract, generated |
//! | [`notation`], [`units`] | frames, signs, vectors; checked quantities at the borders |
//! | [`mechanism`] | PURE where the handle is: one linkage per file |
//! | [`environment`] | PURE what the world wants: shapes, materials, fields |
//! | [`actuation`] | PURE what the actuators can do: bounds, allocation, wall laws |
//! | [`wire`] | PURE datagram bytes and values |
//! | [`impairment`] | PURE a bad network, from a seed |
//! | [`link`] | the bridges of the real-time thread |
//! | [`control`] | PURE one tick: sample, setpoint and plan become a decision |
//! | `sealed` | PURE sealed datagrams for plain UDP: packets, replay, repetition |
//! | [`session`] | PURE who may command: handshake, lease, liveness |
//! | [`device`] | where samples come from: simulated plant and hand |
//! | [`config`] | what the user wrote becomes what the loop needs |
//! | [`explain`] | PURE from the report of a tick to sentences |
//! | `plot` | pictures, as data and on paper |
//! | [`analysis`] | PURE offline: experiments in virtual time |
//! | [`recording`] | what ticks saw and decided as a file, run again and compared |
//! | `clock` | the device clock, for the rim |
//! | `rt` | the thread: cycle, clock, rights (Linux) |
//! | `telemetry` | one table of metrics, histograms, figures of a run |
//! | `host` | one device as the services see it |
//! | `archive` | recordings and black boxes on disk |
//! | `utc` | moments of the world's clock |
//! | `credentials` | who may use a server, and for what |
//! | `audit` | who did what, on disk |
//! | `quic` | what both ends of a QUIC connection agree on |
//! | `net` | the server's sockets |
//! | `client` | the client library |
//! | `app`, `cli` | composition root and commands |
//!
//! # Data flow
//!
//! ```text
//! device ─ Sample ─▶ control::tick ─ Decision ─▶ device
//!                      ▲      │
//!   setpoint (newest) ─┘      └─ Report, Record (rings) ─▶ session ─ State ─▶ simulators
//!        ▲                                              └▶ telemetry ─▶ Prometheus
//!   session ◀─ Command ─ simulators
//! ```
#![deny(unsafe_code)]
#![allow(non_snake_case)]
// names carry frames: `p_BH`, `F_BH_N`

/// Tests prove that a tick does not allocate.
#[cfg(all(test, debug_assertions))]
#[global_allocator]
static ALLOCATOR: assert_no_alloc::AllocDisabler = assert_no_alloc::AllocDisabler;

pub mod actuation;
pub mod analysis;
#[cfg(feature = "net")]
pub mod app;
#[cfg(feature = "net")]
pub mod archive;
#[cfg(feature = "net")]
pub mod audit;
#[cfg(feature = "net")]
pub mod cli;
#[cfg(feature = "client")]
pub mod client;
#[cfg(target_os = "linux")]
pub mod clock;
pub mod config;
pub mod control;
#[cfg(feature = "net")]
pub mod credentials;
pub mod device;
pub mod environment;
pub mod explain;
#[cfg(feature = "net")]
pub mod host;
pub mod impairment;
pub mod link;
pub mod mechanism;
#[cfg(feature = "net")]
pub mod net;
pub mod notation;
#[cfg(feature = "design")]
pub mod plot;
pub mod proto;
#[cfg(feature = "client")]
pub mod quic;
pub mod recording;
#[cfg(target_os = "linux")]
pub mod rt;
#[cfg(feature = "client")]
pub mod sealed;
pub mod session;
#[cfg(target_os = "linux")]
pub mod telemetry;
pub mod units;
#[cfg(feature = "net")]
pub mod utc;
pub mod wire;
