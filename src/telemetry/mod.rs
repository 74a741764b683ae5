//! What hapticd tells about itself: one table of metrics, the thread that feeds it, figures.
//!
//! ```text
//! rt thread ── ring of Records ─▶ feed ─┬─▶ DeviceMetrics ─▶ /metrics
//!                                       ├─▶ LatestReport  ─▶ gRPC, live view
//!                                       └─▶ RunSummary    ─▶ figures of a run
//! stream thread ── StreamMetrics ──────────▶ /metrics
//! ```
//!
//! [`table`] is the only place where a metric is named; everything else takes a handle that
//! was resolved from it once. Each [`Telemetry`] has a registry of its own, nothing is global,
//! so several servers can live in one process. No sockets here: whoever serves `/metrics` asks
//! a [`Scrape`] for the text.

mod feed;
mod history;
mod metrics;
mod registry;
mod summary;
pub mod table;
mod turned_away;

pub use feed::{LatestReport, spawn};
pub use history::{EventHistory, Happened, KEPT};
pub use metrics::{DeviceMetrics, StreamMetrics};
pub use registry::{Scrape, Telemetry, TelemetryError};
pub use summary::{RegionTicks, RoundTrips, RunFigures, RunSummary, durations_ns};
pub use turned_away::{TurnedAway, TurnedAwayMetrics};
