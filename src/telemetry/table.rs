//! The table of metrics: every name, help text, label, label value and bucket, once.
//!
//! Base units throughout (seconds, newtons, radians, ticks). A metric of [`Scope::Device`]
//! carries the label `device` before its own. Buckets are chosen around what the values
//! really are: a quantile read from them is good to the ratio of two neighbours.
//! A row without a user does not compile away: `ROWS` is what the registry shows from the
//! first scrape, and the handles of [`super::DeviceMetrics`] and [`super::StreamMetrics`]
//! take rows, not names.

use super::turned_away::TurnedAway;
use crate::actuation::Region;
use crate::control::{DeviceError, Fault, Limit, Mode};
use crate::rt::Right;
use crate::session::{Direction, Outcome, Quality, Role, StaleReason, Transport};

/// What a metric counts or measures.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// Only grows.
    Counter,
    /// Is what it is now.
    Gauge,
    /// A distribution, with the upper edges of its buckets.
    Histogram(&'static [f64]),
}

/// What there is one of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// One per server.
    Server,
    /// One per device, with label `device`.
    Device,
}

/// A label, or several that only vary together, and everything they can say.
#[derive(Clone, Copy, Debug)]
pub struct Label {
    /// Their keys.
    pub keys: &'static [&'static str],
    /// Their values, in the order of the type they come from; each as long as `keys`.
    pub values: fn() -> Vec<Vec<&'static str>>,
}

/// One row of the table.
#[derive(Debug)]
pub struct Row {
    /// Full name, prefix and unit included.
    pub name: &'static str,
    /// One sentence for `# HELP`.
    pub help: &'static str,
    /// Counter, gauge or histogram.
    pub kind: Kind,
    /// Per server or per device.
    pub scope: Scope,
    /// Labels besides `device`.
    pub labels: &'static [Label],
}

impl Row {
    /// Every combination of label values, the last label varying fastest; one empty
    /// combination where there is no label.
    pub fn combinations(&self) -> Vec<Vec<(&'static str, &'static str)>> {
        let mut rows = vec![Vec::new()];
        for label in self.labels {
            let values = (label.values)();
            let extended = |row: &Vec<_>, value: &Vec<&'static str>| {
                let pairs = label.keys.iter().copied().zip(value.iter().copied());
                row.iter().copied().chain(pairs).collect()
            };
            rows = rows
                .iter()
                .flat_map(|row| values.iter().map(move |value| extended(row, value)))
                .collect();
        }
        rows
    }
}

/// The values of one label.
fn each(names: impl IntoIterator<Item = &'static str>) -> Vec<Vec<&'static str>> {
    names.into_iter().map(|name| vec![name]).collect()
}

/// Every mode, in the order of declaration.
pub(super) const MODES: [Mode; 4] = [Mode::Disabled, Mode::Enabled, Mode::Stopped, Mode::Fault];

fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::Disabled => "disabled",
        Mode::Enabled => "enabled",
        Mode::Stopped => "stopped",
        Mode::Fault => "fault",
    }
}

/// Outcomes belong to one direction each.
fn outcomes() -> Vec<Vec<&'static str>> {
    Outcome::ALL.map(|outcome| vec![outcome.direction(), outcome.name()]).to_vec()
}

const LATENESS_S: &[f64] =
    &[1e-6, 2e-6, 5e-6, 1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2];
const EXECUTION_S: &[f64] = &[
    5e-7, 1e-6, 1.5e-6, 2e-6, 3e-6, 5e-6, 7.5e-6, 1e-5, 1.5e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3,
];
const DEVICE_IO_S: &[f64] =
    &[1e-6, 2e-6, 5e-6, 1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3];
const ROUND_TRIP_S: &[f64] =
    &[1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5, 1.0];
const COMMAND_AGE_S: &[f64] =
    &[2.5e-4, 5e-4, 1e-3, 1.5e-3, 2e-3, 3e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5, 1.0];
const LAG_TICKS: &[f64] =
    &[0.0, 1.0, 2.0, 3.0, 5.0, 8.0, 13.0, 21.0, 34.0, 55.0, 89.0, 144.0, 233.0];
const FORCE_N: &[f64] =
    &[0.01, 0.03, 0.1, 0.3, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 30.0, 50.0, 100.0, 300.0, 1000.0];
/// Every 5 degrees up to 20, every 10 up to 70, then coarser: 180 degrees is the last.
const ANGLE_RAD: &[f64] = &[
    0.0,
    5_f64.to_radians(),
    10_f64.to_radians(),
    15_f64.to_radians(),
    20_f64.to_radians(),
    30_f64.to_radians(),
    40_f64.to_radians(),
    50_f64.to_radians(),
    60_f64.to_radians(),
    70_f64.to_radians(),
    90_f64.to_radians(),
    120_f64.to_radians(),
    180_f64.to_radians(),
];

macro_rules! rows {
    ($($ident:ident: $scope:ident $kind:expr, $name:literal [$($($key:literal)+: $values:expr),*], $help:literal;)+) => {
        $(
            #[doc = $help]
            pub static $ident: Row = Row {
                name: concat!("hapticd_", $name),
                help: $help,
                kind: $kind,
                scope: Scope::$scope,
                labels: &[$(Label { keys: &[$($key),+], values: $values }),*],
            };
        )+

        /// The whole table.
        pub static ROWS: &[&Row] = &[$(&$ident),+];
    };
}

use Kind::{Counter, Gauge, Histogram};

rows! {
    BUILD_INFO: Server Gauge, "build_info" ["version": || each([env!("CARGO_PKG_VERSION")])],
        "Always 1; the label says which build runs.";

    LOOP_LATENESS: Device Histogram(LATENESS_S), "loop_wakeup_lateness_seconds" [],
        "From when a tick was due to when it began.";
    LOOP_EXECUTION: Device Histogram(EXECUTION_S), "loop_execution_seconds" [],
        "Time that the law of one tick took, device input and output aside.";
    LOOP_TICKS: Device Counter, "loop_ticks_total" [],
        "Ticks run; those that the histograms lack found no room on their way here.";
    LOOP_OVERRUNS: Device Counter, "loop_overruns_total" [],
        "Ticks that were not done when the next one was due, and those that were skipped for it.";
    REPORTS_DROPPED: Device Counter, "loop_reports_dropped_total" [],
        "Ticks that the stream never heard of: it was held up for longer than the ring holds.";
    REALTIME_GRANTED: Device Gauge, "realtime_granted"
        ["what": || each(Right::ALL.map(Right::name))],
        "1 where the system granted a real-time right that the loop asked for.";

    DEVICE_IO: Device Histogram(DEVICE_IO_S), "device_io_seconds" [],
        "Time that reading and writing the device took in one tick.";
    DEVICE_ERRORS: Device Counter, "device_errors_total"
        ["kind": || each(DeviceError::ALL.map(DeviceError::name))],
        "Ticks in which the device failed.";
    MODE: Device Gauge, "mode"
        ["mode": || each(MODES.map(mode_name))],
        "1 for the mode that the device is in.";
    FAULTS: Device Counter, "faults_total"
        ["fault": || each(Fault::ALL.map(Fault::name))],
        "Faults that latched.";

    COMMAND_AGE: Device Histogram(COMMAND_AGE_S), "command_age_seconds" [],
        "From the sensing that a command was computed from to the tick that first applied it.";
    COMMAND_LAG: Device Histogram(LAG_TICKS), "command_lag_ticks" [],
        "Ticks from the state that a command was computed from to the tick that first applied it.";
    FORCE_ERROR: Device Histogram(FORCE_N), "force_error_newtons" [],
        "Distance between the force chosen and the request clipped to the device's range.";
    APPROXIMATION_ANGLE: Device Histogram(ANGLE_RAD), "force_approximation_angle_radians" [],
        "Angle between the force requested and the force chosen.";
    REGION_TICKS: Device Counter, "render_region_ticks_total"
        ["region": || each(Region::ALL.map(Region::name))],
        "Ticks by how much of the requested direction the actuators could give.";
    STUCK_TICKS: Device Counter, "stuck_ticks_total" [],
        "Ticks in which the handle was held although it should have been free.";
    LIMIT_TICKS: Device Counter, "limit_active_ticks_total"
        ["limit": || each(Limit::ALL.map(Limit::name))],
        "Ticks in which a limit changed what was rendered.";

    SESSIONS: Device Gauge, "sessions" [
        "role": || each(Role::ALL.map(Role::name)),
        "transport": || each(Transport::ALL.map(Transport::name))],
        "Sessions open now.";
    DATAGRAMS: Device Counter, "datagrams_total" [
        "transport": || each(Transport::ALL.map(Transport::name)),
        "direction" "outcome": outcomes],
        "Datagrams of the stream and what became of them.";
    SESSION_RTT: Device Histogram(ROUND_TRIP_S), "session_rtt_seconds"
        ["transport": || each(Transport::ALL.map(Transport::name))],
        "Round trips of the server's pings.";
    ONE_WAY_DELAY: Device Histogram(ROUND_TRIP_S), "one_way_delay_seconds"
        ["direction": || each(Direction::ALL.map(Direction::name))],
        "Halves of those round trips, estimated; off by at most half the least round trip.";
    SESSIONS_SLOWED: Device Gauge, "sessions_slowed"
        ["role": || each(Role::ALL.map(Role::name))],
        "Sessions open now that get fewer States than they asked for: their path loses them.";
    SESSION_QUALITY: Device Gauge, "session_quality" [
        "role": || each(Role::ALL.map(Role::name)),
        "quality": || each(Quality::ALL.map(Quality::name))],
        "Sessions open now by how good their path is.";
    STALE: Device Counter, "stale_total"
        ["reason": || each(StaleReason::ALL.map(StaleReason::name))],
        "Commands whose force was taken away.";

    TURNED_AWAY: Server Counter, "turned_away_total"
        ["why": || each(TurnedAway::ALL.map(TurnedAway::name))],
        "What came from outside and reached no session.";
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn names_are_unique_and_end_as_prometheus_wants_them() {
        let names: BTreeSet<_> = ROWS.iter().map(|row| row.name).collect();
        assert_eq!(names.len(), ROWS.len());
        for row in ROWS {
            let total = row.name.ends_with("_total");
            assert_eq!(total, matches!(row.kind, Counter), "{}", row.name);
            assert!(row.help.ends_with('.') && !row.help.contains(['\\', '\n']));
            assert!(row.name.bytes().all(|b| b.is_ascii_lowercase() || b == b'_'));
            for reserved in ["_count", "_sum", "_bucket"] {
                assert!(!row.name.ends_with(reserved), "{}", row.name);
            }
        }
    }

    #[test]
    fn buckets_rise() {
        for row in ROWS {
            if let Histogram(buckets) = row.kind {
                assert!(buckets.len() > 8, "{}", row.name);
                assert!(buckets.windows(2).all(|pair| pair[0] < pair[1]), "{}", row.name);
            }
        }
    }

    #[test]
    fn combinations_are_the_product_of_the_labels() {
        assert_eq!(LOOP_TICKS.combinations(), [vec![]]);
        let datagrams = DATAGRAMS.combinations();
        assert_eq!(datagrams.len(), Transport::ALL.len() * Outcome::ALL.len());
        assert_eq!(datagrams.iter().collect::<BTreeSet<_>>().len(), datagrams.len());
        assert_eq!(
            datagrams[0],
            [("transport", "quic"), ("direction", "in"), ("outcome", "accepted")]
        );
        assert_eq!(SESSIONS.combinations().len(), Role::ALL.len() * Transport::ALL.len());
    }
}
