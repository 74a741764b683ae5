//! One server's metrics: built from the table, shown as Prometheus text.
//!
//! Registering a device or the server makes every combination of labels appear at zero, so a
//! dashboard sees a rate from the first event on. A handle is resolved once and is then an
//! atomic; [`Telemetry`] is not needed to count. Nothing here is global.

use metrics::{Counter, Gauge, Histogram, Key, KeyName, Label, Level, Metadata, Recorder};
use metrics_exporter_prometheus::{
    BuildError, Matcher, PrometheusBuilder, PrometheusHandle, PrometheusRecorder,
};

use super::metrics::{DeviceMetrics, StreamMetrics};
use super::table::{BUILD_INFO, Kind, ROWS, Row, Scope};
use super::turned_away::TurnedAwayMetrics;

const METADATA: Metadata<'static> = Metadata::new("hapticd", Level::INFO, None);

/// The exporter did not take the table.
#[derive(Debug, thiserror::Error)]
#[error("metrics cannot be set up: {0}")]
pub struct TelemetryError(#[from] BuildError);

/// The registry of one server.
#[derive(Debug)]
pub struct Telemetry {
    recorder: PrometheusRecorder,
}

impl Telemetry {
    /// A registry with the rows of the server at zero; devices come with [`Self::device`].
    pub fn new() -> Result<Self, TelemetryError> {
        let mut builder = PrometheusBuilder::new();
        for row in ROWS {
            if let Kind::Histogram(buckets) = row.kind {
                let name = Matcher::Full(row.name.to_owned());
                builder = builder.set_buckets_for_metric(name, buckets)?;
            }
        }
        let telemetry = Self { recorder: builder.build_recorder() };
        telemetry.begin(Scope::Server, None);
        for info in telemetry.gauges(&BUILD_INFO, None) {
            info.set(1.0);
        }
        Ok(telemetry)
    }

    /// The metrics of one device, all of them from now on at zero in the scrape.
    pub fn device(&self, name: &str) -> DeviceMetrics {
        self.begin(Scope::Device, Some(name));
        DeviceMetrics::new(self, name)
    }

    /// The metrics of a device's sessions.
    pub fn stream(&self, name: &str) -> StreamMetrics {
        self.begin(Scope::Device, Some(name));
        StreamMetrics::new(self, name)
    }

    /// The metrics of what reaches no session.
    pub fn turned_away(&self) -> TurnedAwayMetrics {
        TurnedAwayMetrics::new(self)
    }

    /// What a scrape asks.
    pub fn scrape(&self) -> Scrape {
        Scrape { handle: self.recorder.handle() }
    }

    /// The counter of a row without labels of its own.
    pub(super) fn counter(&self, row: &Row, device: Option<&str>) -> Counter {
        debug_assert!(row.labels.is_empty(), "{} has labels", row.name);
        self.recorder.register_counter(&key(row, device, vec![]), &METADATA)
    }

    /// The histogram of a row without labels of its own.
    pub(super) fn histogram(&self, row: &Row, device: Option<&str>) -> Histogram {
        debug_assert!(row.labels.is_empty(), "{} has labels", row.name);
        self.recorder.register_histogram(&key(row, device, vec![]), &METADATA)
    }

    /// Counters of `row`, in the order of [`Row::combinations`].
    pub(super) fn counters(&self, row: &Row, device: Option<&str>) -> Vec<Counter> {
        let keys = keys(row, device);
        keys.map(|key| self.recorder.register_counter(&key, &METADATA)).collect()
    }

    /// Gauges of `row`, in the order of [`Row::combinations`].
    pub(super) fn gauges(&self, row: &Row, device: Option<&str>) -> Vec<Gauge> {
        let keys = keys(row, device);
        keys.map(|key| self.recorder.register_gauge(&key, &METADATA)).collect()
    }

    /// Histograms of `row`, in the order of [`Row::combinations`].
    pub(super) fn histograms(&self, row: &Row, device: Option<&str>) -> Vec<Histogram> {
        let keys = keys(row, device);
        keys.map(|key| self.recorder.register_histogram(&key, &METADATA)).collect()
    }

    /// Describes and registers every row of a scope.
    fn begin(&self, scope: Scope, device: Option<&str>) {
        for row in ROWS.iter().filter(|row| row.scope == scope) {
            let (name, help) = (KeyName::from(row.name), row.help.into());
            match row.kind {
                Kind::Counter => {
                    self.recorder.describe_counter(name, None, help);
                    self.counters(row, device);
                }
                Kind::Gauge => {
                    self.recorder.describe_gauge(name, None, help);
                    self.gauges(row, device);
                }
                Kind::Histogram(_) => {
                    self.recorder.describe_histogram(name, None, help);
                    self.histograms(row, device);
                }
            }
        }
    }
}

fn keys(row: &Row, device: Option<&str>) -> impl Iterator<Item = Key> {
    row.combinations().into_iter().map(move |own| key(row, device, own))
}

fn key(row: &Row, device: Option<&str>, own: Vec<(&'static str, &'static str)>) -> Key {
    let device = device.map(|name| Label::new("device", name.to_owned()));
    let own = own.into_iter().map(|(key, value)| Label::new(key, value));
    let labels: Vec<_> = device.into_iter().chain(own).collect();
    Key::from_parts(row.name, labels)
}

/// What answers a scrape; cheap to clone, may outlive the [`Telemetry`].
#[derive(Clone, Debug)]
pub struct Scrape {
    handle: PrometheusHandle,
}

impl Scrape {
    /// All metrics in Prometheus' text format.
    pub fn render(&self) -> String {
        self.handle.render()
    }

    /// Sorts waiting samples into their buckets. A histogram keeps every sample until this or
    /// a scrape: call it every few seconds.
    pub fn upkeep(&self) {
        self.handle.run_upkeep();
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use super::*;
    use crate::control::{Record, Report};
    use crate::session::Transport;

    fn telemetry() -> (Telemetry, DeviceMetrics) {
        let telemetry = Telemetry::new().unwrap();
        let device = telemetry.device("cho-2005");
        (telemetry, device)
    }

    /// Samples of a scrape by name and labels; panics on a line that is no Prometheus text.
    fn parse(text: &str) -> BTreeMap<String, f64> {
        let (mut helped, mut typed) = (BTreeSet::new(), BTreeMap::new());
        let mut samples = BTreeMap::new();
        for line in text.lines().filter(|line| !line.is_empty()) {
            if let Some(help) = line.strip_prefix("# HELP ") {
                let (name, text) = help.split_once(' ').expect("a help text");
                assert!(!text.is_empty() && helped.insert(name.to_owned()), "{line}");
            } else if let Some(kind) = line.strip_prefix("# TYPE ") {
                let (name, kind) = kind.split_once(' ').expect("a type");
                assert!(helped.contains(name), "no help before {line}");
                assert!(typed.insert(name.to_owned(), kind.to_owned()).is_none(), "{line}");
            } else {
                let (series, value) = line.rsplit_once(' ').expect("a sample");
                let name = series.split('{').next().unwrap();
                let base = ["_bucket", "_sum", "_count"].iter().find_map(|end| {
                    name.strip_suffix(end)
                        .filter(|base| typed.get(*base).is_some_and(|kind| kind == "histogram"))
                });
                assert!(typed.contains_key(base.unwrap_or(name)), "no type before {line}");
                let value = value.parse().expect("a number");
                assert!(samples.insert(series.to_owned(), value).is_none(), "{line} twice");
            }
        }
        samples
    }

    fn series(row: &Row) -> Vec<String> {
        let device = (row.scope == Scope::Device).then_some(("device", "cho-2005"));
        let name = match row.kind {
            Kind::Histogram(_) => format!("{}_count", row.name),
            _ => row.name.to_owned(),
        };
        let all = row.combinations().into_iter().map(|own| {
            let labels: Vec<_> = device
                .into_iter()
                .chain(own)
                .map(|(key, value)| format!("{key}=\"{value}\""))
                .collect();
            if labels.is_empty() { name.clone() } else { format!("{name}{{{}}}", labels.join(",")) }
        });
        all.collect()
    }

    #[test]
    fn every_row_with_every_label_is_at_zero_in_the_first_scrape() {
        let (telemetry, _device) = telemetry();
        let samples = parse(&telemetry.scrape().render());
        for row in ROWS {
            for name in series(row) {
                let one = row.name == BUILD_INFO.name || name.ends_with("mode=\"disabled\"}");
                assert_eq!(samples.get(&name), Some(&f64::from(u8::from(one))), "{name}");
            }
        }
    }

    #[test]
    fn nothing_appears_that_is_not_in_the_table() {
        let (telemetry, _device) = telemetry();
        let text = telemetry.scrape().render();
        let typed = text.lines().filter_map(|line| line.strip_prefix("# TYPE "));
        let names: BTreeSet<_> = typed.filter_map(|line| line.split(' ').next()).collect();
        assert_eq!(names, ROWS.iter().map(|row| row.name).collect());
    }

    #[test]
    fn histograms_have_the_buckets_of_the_table() {
        let (telemetry, _device) = telemetry();
        let samples = parse(&telemetry.scrape().render());
        for row in ROWS {
            let Kind::Histogram(buckets) = row.kind else {
                continue;
            };
            let start = format!("{}_bucket{{", row.name);
            let found = samples.keys().filter(|name| name.starts_with(&start)).count();
            assert_eq!(found, (buckets.len() + 1) * row.combinations().len(), "{}", row.name);
        }
    }

    #[test]
    fn servers_in_one_process_do_not_share_metrics() {
        let (one, mut device) = telemetry();
        let (two, _device) = telemetry();
        let report = Report { tick: 9, ..Report::default() };
        device.observe(&Record { report, ..Record::default() });
        let name = "hapticd_loop_ticks_total{device=\"cho-2005\"}";
        assert_eq!(parse(&one.scrape().render())[name], 9.0);
        assert_eq!(parse(&two.scrape().render())[name], 0.0);
    }

    #[test]
    fn upkeep_loses_no_sample() {
        let (telemetry, _device) = telemetry();
        let stream = telemetry.stream("cho-2005");
        stream.rtt(Transport::Quic, 150_000);
        telemetry.scrape().upkeep();
        stream.rtt(Transport::Quic, 150_000);
        let samples = parse(&telemetry.scrape().render());
        let of = |end: &str| samples[&format!("hapticd_session_rtt_seconds_{end}")];
        assert_eq!(of("count{device=\"cho-2005\",transport=\"quic\"}"), 2.0);
        assert_eq!(of("bucket{device=\"cho-2005\",transport=\"quic\",le=\"0.0001\"}"), 0.0);
        assert_eq!(of("bucket{device=\"cho-2005\",transport=\"quic\",le=\"0.0002\"}"), 2.0);
    }
}
