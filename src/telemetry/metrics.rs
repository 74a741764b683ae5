//! Typed handles: what a tick's Record and a stream's events do to the rows of the table.
//!
//! A handle is resolved once from a row, never from a string; counting is then an atomic
//! addition. [`DeviceMetrics`] belongs to the telemetry thread, [`StreamMetrics`] to the one
//! that drives the sessions. Times arrive in nanoseconds and leave in seconds.

use metrics::{Counter, Gauge, Histogram};

use super::registry::Telemetry;
use super::table;
use crate::control::{Event, Limit, Mode, Record, Report};
use crate::rt::Right;
use crate::session::{Counters, Direction, Outcome, Quality, Role, StaleReason, Transport};

/// The metrics of one device.
#[derive(Debug)]
pub struct DeviceMetrics {
    lateness: Histogram,
    execution: Histogram,
    device_io: Histogram,
    ticks: Counter,
    overruns: Counter,
    reports_dropped: (Counter, u64),
    realtime: Vec<Gauge>,
    device_errors: Vec<Counter>,
    mode: Vec<Gauge>,
    faults: Vec<Counter>,
    command_age: Histogram,
    command_lag: Histogram,
    force_error: Histogram,
    approximation_angle: Histogram,
    regions: Vec<Counter>,
    stuck: Counter,
    limits: Vec<Counter>,
    last_tick: u64,
    last_mode: Mode,
}

impl DeviceMetrics {
    pub(super) fn new(telemetry: &Telemetry, device: &str) -> Self {
        let counter = |row| telemetry.counter(row, Some(device));
        let counters = |row| telemetry.counters(row, Some(device));
        let gauges = |row| telemetry.gauges(row, Some(device));
        let histogram = |row| telemetry.histogram(row, Some(device));
        let metrics = Self {
            lateness: histogram(&table::LOOP_LATENESS),
            execution: histogram(&table::LOOP_EXECUTION),
            device_io: histogram(&table::DEVICE_IO),
            ticks: counter(&table::LOOP_TICKS),
            overruns: counter(&table::LOOP_OVERRUNS),
            reports_dropped: (counter(&table::REPORTS_DROPPED), 0),
            realtime: gauges(&table::REALTIME_GRANTED),
            device_errors: counters(&table::DEVICE_ERRORS),
            mode: gauges(&table::MODE),
            faults: counters(&table::FAULTS),
            command_age: histogram(&table::COMMAND_AGE),
            command_lag: histogram(&table::COMMAND_LAG),
            force_error: histogram(&table::FORCE_ERROR),
            approximation_angle: histogram(&table::APPROXIMATION_ANGLE),
            regions: counters(&table::REGION_TICKS),
            stuck: counter(&table::STUCK_TICKS),
            limits: counters(&table::LIMIT_TICKS),
            last_tick: 0,
            last_mode: Mode::default(),
        };
        metrics.show_mode(Mode::default());
        metrics
    }

    /// Says whether the loop has a right that it asked for.
    pub fn realtime_granted(&self, what: Right, granted: bool) {
        self.realtime[what as usize].set(f64::from(u8::from(granted)));
    }

    /// Takes one tick into account.
    pub fn observe(&mut self, record: &Record) {
        self.lateness.record(seconds(record.wakeup_lateness_ns));
        self.execution.record(seconds(record.execution_ns));
        self.device_io.record(seconds(record.device_io_ns));
        self.overruns.increment(u64::from(record.overrun) + record.skipped_ticks);
        count_up(&mut self.reports_dropped, record.reports_dropped);
        if let Some(error) = record.device_error {
            self.device_errors[error as usize].increment(1);
        }
        self.observe_state(&record.report);
        self.observe_force(&record.report);
    }

    fn observe_state(&mut self, report: &Report) {
        // Counted by number, so that ticks whose Record found no room are not lost.
        self.ticks.increment(report.tick.saturating_sub(self.last_tick));
        self.last_tick = self.last_tick.max(report.tick);
        if report.mode != self.last_mode {
            self.last_mode = report.mode;
            self.show_mode(report.mode);
        }
        // The event and not the state: cleared and latched again in between is a fault, too.
        for event in report.events.iter().flatten() {
            if let Event::Fault(fault) = event {
                self.faults[*fault as usize].increment(1);
            }
        }
        if report.command_new && report.command_lag_ticks > 0 {
            self.command_age.record(seconds(report.command_age_ns));
            self.command_lag.record(report.command_lag_ticks as f64);
        }
    }

    fn observe_force(&self, report: &Report) {
        if let Some(error_N) = report.force_error_N {
            self.force_error.record(error_N);
        }
        if let Some(angle_rad) = report.approximation_angle_rad {
            self.approximation_angle.record(angle_rad);
        }
        if let Some(region) = report.region {
            self.regions[region as usize].increment(1);
        }
        self.stuck.increment(report.stuck.into());
        for limit in Limit::ALL {
            self.limits[limit as usize].increment(report.limits.contains(limit).into());
        }
    }

    fn show_mode(&self, mode: Mode) {
        for (gauge, shown) in self.mode.iter().zip(table::MODES) {
            gauge.set(f64::from(u8::from(shown == mode)));
        }
    }
}

/// The metrics of one device's sessions: the totals that they count and what they measure.
#[derive(Debug)]
pub struct StreamMetrics {
    datagrams: Vec<(Counter, u64)>,
    stale: Vec<(Counter, u64)>,
    sessions: Vec<(Gauge, usize)>,
    slowed: Vec<(Gauge, usize)>,
    qualities: Vec<(Gauge, usize)>,
    rtt: Vec<Histogram>,
    one_way: Vec<Histogram>,
}

impl StreamMetrics {
    pub(super) fn new(telemetry: &Telemetry, device: &str) -> Self {
        let device = Some(device);
        let counters =
            |row| telemetry.counters(row, device).into_iter().map(|counter| (counter, 0));
        let gauges = |row| telemetry.gauges(row, device).into_iter().map(|gauge| (gauge, 0));
        Self {
            datagrams: counters(&table::DATAGRAMS).collect(),
            stale: counters(&table::STALE).collect(),
            sessions: gauges(&table::SESSIONS).collect(),
            slowed: gauges(&table::SESSIONS_SLOWED).collect(),
            qualities: gauges(&table::SESSION_QUALITY).collect(),
            rtt: telemetry.histograms(&table::SESSION_RTT, device),
            one_way: telemetry.histograms(&table::ONE_WAY_DELAY, device),
        }
    }

    /// Brings the metrics up to the totals of the core.
    pub fn publish(&mut self, totals: &Counters) {
        for transport in Transport::ALL {
            for outcome in Outcome::ALL {
                let place = transport as usize * Outcome::ALL.len() + outcome as usize;
                count_up(&mut self.datagrams[place], totals.datagrams(transport, outcome));
            }
        }
        for reason in StaleReason::ALL {
            count_up(&mut self.stale[reason as usize], totals.stale(reason));
        }
    }

    /// Says how many sessions of a kind the core has now.
    pub fn sessions(&mut self, role: Role, transport: Transport, open: usize) {
        let place = role as usize * Transport::ALL.len() + transport as usize;
        show(&mut self.sessions[place], open);
    }

    /// Says how many sessions of a role get fewer States than they asked for.
    pub fn slowed(&mut self, role: Role, open: usize) {
        show(&mut self.slowed[role as usize], open);
    }

    /// Says how many sessions of a role have a path of this quality now.
    pub fn qualities(&mut self, role: Role, quality: Quality, open: usize) {
        let place = role as usize * Quality::ALL.len() + quality as usize;
        show(&mut self.qualities[place], open);
    }

    /// A ping came back.
    pub fn rtt(&self, transport: Transport, rtt_ns: u64) {
        self.rtt[transport as usize].record(seconds(rtt_ns));
    }

    /// One half of it was estimated.
    pub fn one_way(&self, direction: Direction, delay_ns: u64) {
        self.one_way[direction as usize].record(seconds(delay_ns));
    }
}

fn show((gauge, before): &mut (Gauge, usize), now: usize) {
    gauge.increment(now as f64 - *before as f64);
    *before = now;
}

fn count_up((counter, before): &mut (Counter, u64), total: u64) {
    counter.increment(total.saturating_sub(*before));
    *before = total;
}

fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuation::Region;
    use crate::control::{DeviceError, Fault, Inputs, Limits};

    fn sample(telemetry: &Telemetry, series: &str) -> f64 {
        let text = telemetry.scrape().render();
        let line = text.lines().find(|line| line.split(' ').next() == Some(series));
        line.and_then(|line| line.rsplit(' ').next()?.parse().ok()).expect(series)
    }

    fn record() -> Record {
        let mut limits = Limits::default();
        limits.set(Limit::Torque, true);
        let report = Report {
            tick: 1,
            mode: Mode::Enabled,
            force_error_N: Some(4.0),
            approximation_angle_rad: Some(0.6),
            region: Some(Region::Approximate),
            stuck: true,
            limits,
            command_seq: 9,
            command_new: true,
            command_lag_ticks: 1,
            command_age_ns: 1_100_000,
            ..Report::default()
        };
        Record {
            report,
            wakeup_lateness_ns: 3_000,
            execution_ns: 2_500,
            device_io_ns: 15_000,
            overrun: true,
            skipped_ticks: 4,
            reports_dropped: 2,
            device_error: Some(DeviceError::Disconnected),
            inputs: Inputs::default(),
        }
    }

    #[test]
    fn a_record_moves_its_metrics_and_no_others() {
        let telemetry = Telemetry::new().unwrap();
        let mut device = telemetry.device("d");
        let before = telemetry.scrape().render();
        device.observe(&record());
        let after = telemetry.scrape().render();
        let count = |name: &str| format!("hapticd_{name}_count{{device=\"d\"}} 1");
        let mut expected = vec![
            "hapticd_loop_ticks_total{device=\"d\"} 1".to_owned(),
            "hapticd_loop_overruns_total{device=\"d\"} 5".to_owned(),
            "hapticd_loop_reports_dropped_total{device=\"d\"} 2".to_owned(),
            "hapticd_stuck_ticks_total{device=\"d\"} 1".to_owned(),
            "hapticd_device_errors_total{device=\"d\",kind=\"disconnected\"} 1".to_owned(),
            "hapticd_render_region_ticks_total{device=\"d\",region=\"approximate\"} 1".to_owned(),
            "hapticd_limit_active_ticks_total{device=\"d\",limit=\"torque\"} 1".to_owned(),
            "hapticd_mode{device=\"d\",mode=\"enabled\"} 1".to_owned(),
            "hapticd_mode{device=\"d\",mode=\"disabled\"} 0".to_owned(),
        ];
        expected.extend(
            [
                "loop_wakeup_lateness_seconds",
                "loop_execution_seconds",
                "device_io_seconds",
                "command_age_seconds",
                "command_lag_ticks",
                "force_error_newtons",
                "force_approximation_angle_radians",
            ]
            .map(count),
        );
        let moved = after.lines().filter(|line| !before.lines().any(|old| old == *line));
        let mut moved: Vec<_> = moved
            .filter(|line| !line.contains("_bucket{") && !line.contains("_sum{"))
            .map(str::to_owned)
            .collect();
        moved.sort();
        expected.sort();
        assert_eq!(moved, expected);
    }

    #[test]
    fn times_are_seconds_and_land_in_their_bucket() {
        let telemetry = Telemetry::new().unwrap();
        telemetry.device("d").observe(&record());
        let bucket = |edge: &str| {
            let name = "hapticd_loop_execution_seconds_bucket";
            sample(&telemetry, &format!("{name}{{device=\"d\",le=\"{edge}\"}}"))
        };
        assert_eq!((bucket("0.000002"), bucket("0.000003")), (0.0, 1.0));
        assert_eq!(sample(&telemetry, "hapticd_command_lag_ticks_sum{device=\"d\"}"), 1.0);
    }

    #[test]
    fn ticks_whose_record_was_lost_still_count() {
        let telemetry = Telemetry::new().unwrap();
        let mut device = telemetry.device("d");
        for tick in [1, 2, 7] {
            device.observe(&Record { report: Report { tick, ..Report::default() }, ..record() });
        }
        assert_eq!(sample(&telemetry, "hapticd_loop_ticks_total{device=\"d\"}"), 7.0);
    }

    #[test]
    fn a_fault_counts_once_each_time_it_latches() {
        let telemetry = Telemetry::new().unwrap();
        let mut device = telemetry.device("d");
        // Cleared after the third tick, and back in the fourth.
        for latched in [false, true, false, true, false] {
            let mut report = Report { fault: Some(Fault::Closure), ..Report::default() };
            report.events[0] = latched.then_some(Event::Fault(Fault::Closure));
            device.observe(&Record { report, ..Record::default() });
        }
        let series = "hapticd_faults_total{device=\"d\",fault=\"closure\"}";
        assert_eq!(sample(&telemetry, series), 2.0);
    }

    #[test]
    fn a_command_is_counted_where_it_is_first_applied() {
        let telemetry = Telemetry::new().unwrap();
        let mut device = telemetry.device("d");
        for command_new in [true, false, false] {
            let report = Report { command_seq: 3, command_new, ..record().report };
            device.observe(&Record { report, ..Record::default() });
        }
        let series = "hapticd_command_age_seconds_count{device=\"d\"}";
        assert_eq!(sample(&telemetry, series), 1.0);
    }

    #[test]
    fn sessions_of_several_devices_are_told_apart() {
        let telemetry = Telemetry::new().unwrap();
        let (mut one, mut two) = (telemetry.stream("one"), telemetry.stream("two"));
        for (i, role) in Role::ALL.into_iter().enumerate() {
            one.sessions(role, Transport::Quic, 3);
            one.sessions(role, Transport::Quic, 2);
            two.sessions(role, Transport::Quic, i);
            let series = |device| {
                let role = role.name();
                format!(
                    "hapticd_sessions{{device=\"{device}\",role=\"{role}\",transport=\"quic\"}}"
                )
            };
            assert_eq!(sample(&telemetry, &series("one")), 2.0);
            assert_eq!(sample(&telemetry, &series("two")), i as f64);
        }
        one.publish(&Counters::default());
    }

    #[test]
    fn a_total_is_counted_once_however_often_it_is_published() {
        let telemetry = Telemetry::new().unwrap();
        let mut counted = (telemetry.counter(&table::LOOP_TICKS, Some("d")), 0);
        for total in [3, 3, 7] {
            count_up(&mut counted, total);
        }
        assert_eq!(sample(&telemetry, "hapticd_loop_ticks_total{device=\"d\"}"), 7.0);
    }

    #[test]
    fn every_right_reaches_its_own_series() {
        let telemetry = Telemetry::new().unwrap();
        let device = telemetry.device("d");
        for what in Right::ALL {
            device.realtime_granted(what, true);
            let name = what.name();
            let series = format!("hapticd_realtime_granted{{device=\"d\",what=\"{name}\"}}");
            assert_eq!(sample(&telemetry, &series), 1.0);
        }
    }

    #[test]
    fn the_order_of_labels_is_that_of_the_types_they_index() {
        let indices = |all: &[usize]| all.iter().enumerate().all(|(i, &index)| i == index);
        assert!(indices(&DeviceError::ALL.map(|kind| kind as usize)));
        assert!(indices(&Fault::ALL.map(|fault| fault as usize)));
        assert!(indices(&Limit::ALL.map(|limit| limit as usize)));
        assert!(indices(&table::MODES.map(|mode| mode as usize)));
        assert!(indices(&Region::ALL.map(|region| region as usize)));
        assert!(indices(&Right::ALL.map(|what| what as usize)));
        assert!(indices(&Role::ALL.map(|role| role as usize)));
        assert!(indices(&Transport::ALL.map(|transport| transport as usize)));
        assert!(indices(&Outcome::ALL.map(|outcome| outcome as usize)));
        assert!(indices(&StaleReason::ALL.map(|reason| reason as usize)));
        assert!(indices(&Quality::ALL.map(|quality| quality as usize)));
        assert!(indices(&Direction::ALL.map(|direction| direction as usize)));
    }
}
