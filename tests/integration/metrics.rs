//! What Prometheus and a health check see of a running daemon, over plain HTTP.

use hapticd::proto::Role;
use hapticd::telemetry::table::{Kind, ROWS, Row, Scope};

use super::support::{Rig, command_until, http_get, wait_at_least, wait_until, wall_at};

const TICKS: &str = "hapticd_loop_ticks_total{device=\"cho-2005\"}";
const LATENESS: &str = "hapticd_loop_wakeup_lateness_seconds_count{device=\"cho-2005\"}";
const EXECUTION: &str = "hapticd_loop_execution_seconds_count{device=\"cho-2005\"}";
const DEVICE_IO: &str = "hapticd_device_io_seconds_count{device=\"cho-2005\"}";

/// Every sample that a row has to show, by its name with labels.
fn samples(row: &Row) -> Vec<String> {
    let sample = |own: Vec<(&str, &str)>| {
        let device = (row.scope == Scope::Device).then_some(("device", "cho-2005"));
        let labels: Vec<_> = device
            .into_iter()
            .chain(own)
            .map(|(key, value)| format!("{key}=\"{value}\""))
            .collect();
        let labels =
            if labels.is_empty() { String::new() } else { format!("{{{}}}", labels.join(",")) };
        match row.kind {
            Kind::Histogram(_) => format!("{}_count{labels}", row.name),
            Kind::Counter | Kind::Gauge => format!("{}{labels}", row.name),
        }
    };
    row.combinations().into_iter().map(sample).collect()
}

#[test]
fn the_first_scrape_holds_every_row_of_the_table() {
    let rig = Rig::start();
    let metrics = rig.scrape();
    for row in ROWS {
        let help = format!("# HELP {} {}", row.name, row.help);
        assert!(metrics.0.lines().any(|line| line == help), "{help}");
        let kind = match row.kind {
            Kind::Counter => "counter",
            Kind::Gauge => "gauge",
            Kind::Histogram(_) => "histogram",
        };
        let kind = format!("# TYPE {} {kind}", row.name);
        assert!(metrics.0.lines().any(|line| line == kind), "{kind}");
        for sample in samples(row) {
            assert!(metrics.value(&sample) >= 0.0, "{sample}");
        }
    }
    let known = |line: &str| ROWS.iter().any(|row| line.contains(row.name));
    let strangers: Vec<_> =
        metrics.0.lines().filter(|line| !line.is_empty() && !known(line)).collect();
    assert!(strangers.is_empty(), "not in the table: {strangers:?}");
    assert!(
        metrics.value(
            "hapticd_datagrams_total{device=\"cho-2005\",transport=\"quic\",direction=\"in\",outcome=\"accepted\"}"
        ) == 0.0
    );
}

#[test]
fn every_tick_is_counted_and_every_histogram_has_it() {
    let rig = Rig::start();
    let before = rig.scrape().value(TICKS);
    wait_at_least("500 more ticks", before + 500.0, || rig.scrape().value(TICKS));
    // The loop goes on while it is read: one scrape between two batches has all of them equal.
    wait_until("a scrape between two batches", || {
        let metrics = rig.scrape();
        let ticks = metrics.value(TICKS);
        [LATENESS, EXECUTION, DEVICE_IO].iter().all(|histogram| metrics.value(histogram) == ticks)
    });
}

#[test]
fn commands_sessions_and_round_trips_show() {
    let rig = Rig::start();
    rig.run(async {
        let mut client = rig.client("metrics", Role::Controller).await;
        let wall = [wall_at(0.3)];
        command_until(&mut client, &wall, |state| state.command_seq >= 200).await;
        let sessions =
            "hapticd_sessions{device=\"cho-2005\",role=\"controller\",transport=\"quic\"}";
        assert_eq!(rig.scrape().value(sessions), 1.0);
        client.close().await;
        wait_until("the session's end", || rig.scrape().value(sessions) == 0.0);
    });
    let count = |name: &str| format!("hapticd_{name}_count{{device=\"cho-2005\"}}");
    wait_at_least("200 commands", 1.0, || rig.scrape().value(&count("command_age_seconds")));
    let metrics = rig.scrape();
    let applied = metrics.value(&count("command_age_seconds"));
    assert_eq!(applied, metrics.value(&count("command_lag_ticks")));
    // Pongs are accepted too; nothing else was sent.
    assert!(metrics.datagrams("accepted") >= applied, "{applied} applied");
    assert!(
        metrics.value("hapticd_session_rtt_seconds_count{device=\"cho-2005\",transport=\"quic\"}")
            >= 1.0
    );
    for outcome in ["malformed", "oversize", "not_allowed", "invalid"] {
        assert_eq!(metrics.datagrams(outcome), 0.0, "{outcome}");
    }
    let released = metrics.value("hapticd_stale_total{device=\"cho-2005\",reason=\"released\"}");
    assert_eq!(released, 1.0, "it said goodbye while it commanded");
}

#[test]
fn a_daemon_whose_loop_turns_is_healthy() {
    let rig = Rig::start();
    wait_until("health", || http_get(rig.daemon().http_address, "/healthz").0 == 200);
    let (status, body) = http_get(rig.daemon().http_address, "/healthz");
    assert_eq!((status, body.as_str()), (200, "ok\n"));
    assert_eq!(http_get(rig.daemon().http_address, "/nothing").0, 404);
}
