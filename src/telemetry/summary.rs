//! The figures of one run, as `demo --json` prints them.
//!
//! Everything is aggregated Record by Record in constant memory; percentiles come from
//! histograms with three significant digits. A share over nothing is zero where it counts
//! events (stuck), and absent (`null`) where no value was ever there (a force error, an angle,
//! a lag): unknown is not zero. *Slide time* is when the hand holds button 0, as the program
//! `press-and-slide` does while it pushes along a wall.

use std::sync::{Arc, Mutex, PoisonError};

use hdrhistogram::Histogram;
use serde::Serialize;

use crate::actuation::Region;
use crate::control::{Record, Report};

/// The hand holds this button while it slides.
const SLIDING: u32 = 1;

/// What a run amounts to so far.
#[derive(Clone, Debug)]
pub struct RunSummary {
    tick_s: f64,
    ticks: u64,
    overruns: u64,
    lateness_ns: Histogram<u64>,
    execution_ns: Histogram<u64>,
    commanded: Commanded,
    energy: Energy,
    penetration_m: f64,
    force_error_N: Mean,
    approximation_angle_rad: Option<f64>,
    slide: Slide,
    regions: [u64; Region::ALL.len()],
}

/// Ticks from the first command on.
#[derive(Clone, Copy, Debug, Default)]
struct Commanded {
    began: bool,
    ticks: u64,
    next_tick: u64,
    in_force: u64,
    /// Ticks since the last one with a command in force.
    idle: u64,
    last_seq: u64,
    /// Numbers skipped by the commands that came into force.
    lost: u64,
}

/// What the handle gave to the hand, rendered force times motion.
#[derive(Clone, Copy, Debug, Default)]
struct Energy {
    given_J: f64,
    least_J: f64,
    /// The most that was given on balance over any stretch of time.
    risen_J: f64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    sum: f64,
    count: u64,
}

/// What happened while the hand slid.
#[derive(Clone, Copy, Debug, Default)]
struct Slide {
    ticks: u64,
    stuck: u64,
    switches: u64,
    /// Any actuator engaged in the tick before, if that was slide time too.
    engaged: Option<bool>,
}

/// The round trips of a session core's pings, shared by who measures and who shows them.
#[derive(Clone, Debug)]
pub struct RoundTrips(Arc<Mutex<Histogram<u64>>>);

impl Default for RoundTrips {
    fn default() -> Self {
        Self(Arc::new(Mutex::new(durations_ns())))
    }
}

impl RoundTrips {
    /// One more.
    pub fn record(&self, rtt_ns: u64) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).saturating_record(rtt_ns);
    }

    /// As if there had been none.
    pub fn clear(&self) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// A quantile, microseconds; `None` before the first.
    pub fn quantile_us(&self, quantile: f64) -> Option<f64> {
        let histogram = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        (!histogram.is_empty()).then(|| quantile_us(&histogram, quantile))
    }
}

/// The figures, by the names they are printed under.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunFigures {
    /// Ticks measured.
    pub ticks: u64,
    /// Ticks not done when the next was due, and those never run for it.
    pub overruns: u64,
    /// Lateness of a tick's begin, median, microseconds.
    pub wakeup_p50_us: f64,
    /// 99th percentile.
    pub wakeup_p99_us: f64,
    /// 99.9th percentile.
    pub wakeup_p999_us: f64,
    /// Time of a tick without device input and output, 99th percentile, microseconds.
    pub tick_p99_us: f64,
    /// Round trip, median, microseconds.
    pub rtt_p50_us: Option<f64>,
    /// Round trip, 99th percentile.
    pub rtt_p99_us: Option<f64>,
    /// Share of ticks, between the first and the last command in force, in which a new command
    /// computed from the State of the tick before was applied.
    pub command_lag_one_ratio: Option<f64>,
    /// Share of the same ticks with a command in force.
    pub commanded_ratio: Option<f64>,
    /// Commands sent that never came into force.
    pub commands_lost: u64,
    /// Energy that the hand put into the handle on balance.
    pub energy_taken_j: f64,
    /// The most that it got back over any stretch of the run: what moving links give back, and
    /// what a motor or a late force feeds.
    pub energy_given_max_j: f64,
    /// Deepest contact.
    pub penetration_max_mm: f64,
    /// Mean distance between what was asked (clipped) and what was chosen.
    pub force_error_mean_n: Option<f64>,
    /// Largest angle between them.
    pub approximation_angle_max_deg: Option<f64>,
    /// Share of slide time in which the handle was stuck.
    pub stuck_ratio: f64,
    /// How often in a second of slide time the actuators went from all released to some
    /// engaged or back.
    pub wall_switches_per_s: f64,
    /// Ticks by region.
    pub regions: RegionTicks,
}

/// Ticks by how much of the requested direction could be given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct RegionTicks {
    /// The requested direction.
    pub full: u64,
    /// Something near it.
    pub approximate: u64,
    /// Nothing.
    pub not_displayable: u64,
}

impl RunSummary {
    /// An empty summary of a loop with this period.
    pub fn new(tick_ns: u64) -> Self {
        Self {
            tick_s: tick_ns as f64 * 1e-9,
            ticks: 0,
            overruns: 0,
            lateness_ns: durations_ns(),
            execution_ns: durations_ns(),
            commanded: Commanded::default(),
            energy: Energy::default(),
            penetration_m: 0.0,
            force_error_N: Mean::default(),
            approximation_angle_rad: None,
            slide: Slide::default(),
            regions: [0; Region::ALL.len()],
        }
    }

    /// Takes one tick into account.
    pub fn observe(&mut self, record: &Record) {
        self.ticks += 1;
        self.overruns += u64::from(record.overrun) + record.skipped_ticks;
        self.lateness_ns.saturating_record(record.wakeup_lateness_ns);
        self.execution_ns.saturating_record(record.execution_ns);
        let report = &record.report;
        self.commanded.observe(report);
        self.slide.observe(report);
        self.energy.observe(report, self.tick_s);
        for contact in report.contacts() {
            self.penetration_m = self.penetration_m.max(contact.depth_m);
        }
        if let Some(error_N) = report.force_error_N {
            self.force_error_N.sum += error_N;
            self.force_error_N.count += 1;
        }
        if let Some(angle_rad) = report.approximation_angle_rad {
            let largest_rad = self.approximation_angle_rad.unwrap_or(0.0).max(angle_rad);
            self.approximation_angle_rad = Some(largest_rad);
        }
        if let Some(region) = report.region {
            self.regions[region as usize] += 1;
        }
    }

    /// What there is so far; this summary begins anew. The controller goes on: the commands it
    /// sent before are not lost ones of the next figures.
    pub fn take(&mut self) -> Self {
        let commanded = Commanded { last_seq: self.commanded.last_seq, ..Commanded::default() };
        let anew = Self { tick_s: self.tick_s, commanded, ..Self::new(0) };
        std::mem::replace(self, anew)
    }

    /// The figures so far.
    pub fn figures(&self, round_trips: &RoundTrips) -> RunFigures {
        let [full, approximate, not_displayable] = self.regions;
        let slide_s = self.slide.ticks as f64 * self.tick_s;
        RunFigures {
            ticks: self.ticks,
            overruns: self.overruns,
            wakeup_p50_us: quantile_us(&self.lateness_ns, 0.5),
            wakeup_p99_us: quantile_us(&self.lateness_ns, 0.99),
            wakeup_p999_us: quantile_us(&self.lateness_ns, 0.999),
            tick_p99_us: quantile_us(&self.execution_ns, 0.99),
            rtt_p50_us: round_trips.quantile_us(0.5),
            rtt_p99_us: round_trips.quantile_us(0.99),
            command_lag_one_ratio: ratio(
                self.commanded.next_tick as f64,
                self.commanded.ticks as f64,
            ),
            commanded_ratio: ratio(self.commanded.in_force as f64, self.commanded.ticks as f64),
            commands_lost: self.commanded.lost,
            energy_taken_j: -self.energy.given_J,
            energy_given_max_j: self.energy.risen_J,
            penetration_max_mm: self.penetration_m * 1e3,
            force_error_mean_n: ratio(self.force_error_N.sum, self.force_error_N.count as f64),
            approximation_angle_max_deg: self.approximation_angle_rad.map(f64::to_degrees),
            stuck_ratio: ratio(self.slide.stuck as f64, self.slide.ticks as f64).unwrap_or(0.0),
            wall_switches_per_s: ratio(self.slide.switches as f64, slide_s).unwrap_or(0.0),
            regions: RegionTicks { full, approximate, not_displayable },
        }
    }
}

impl Commanded {
    /// A gap between two commands counts as soon as it ends; the time after the last command
    /// does not, for nobody was commanding then.
    fn observe(&mut self, report: &Report) {
        let in_force = report.command_seq != 0;
        self.began |= in_force;
        if !self.began {
            return;
        }
        self.idle += 1;
        if in_force {
            self.in_force += 1;
            self.ticks += self.idle;
            self.idle = 0;
        }
        self.next_tick += u64::from(report.command_new && report.command_lag_ticks == 1);
        if report.command_new {
            // A lower number is another controller's; a client numbers from 1.
            let seq = report.command_seq;
            let before = if seq > self.last_seq { self.last_seq } else { 0 };
            self.lost += seq - before - 1;
            self.last_seq = seq;
        }
    }
}

impl Energy {
    fn observe(&mut self, report: &Report, tick_s: f64) {
        let Report { rendered, v_WT_m_per_s, omega_WT_rad_per_s, .. } = report;
        let power_W =
            rendered.force_N.dot(v_WT_m_per_s) + rendered.moment_Nm.dot(omega_WT_rad_per_s);
        // A blind tick knows neither.
        if power_W.is_finite() {
            self.given_J += power_W * tick_s;
            self.least_J = self.least_J.min(self.given_J);
            self.risen_J = self.risen_J.max(self.given_J - self.least_J);
        }
    }
}

impl Slide {
    fn observe(&mut self, report: &Report) {
        if report.buttons & SLIDING == 0 {
            self.engaged = None;
            return;
        }
        let engaged = report.commanded_Nm.iter().any(|torque_Nm| torque_Nm.abs() > 0.0);
        self.ticks += 1;
        self.stuck += u64::from(report.stuck);
        self.switches += u64::from(self.engaged.is_some_and(|before| before != engaged));
        self.engaged = Some(engaged);
    }
}

/// A histogram of durations in nanoseconds, from 1 ns to 10 s; what is longer counts as 10 s.
pub fn durations_ns() -> Histogram<u64> {
    Histogram::new_with_bounds(1, 10_000_000_000, 3).expect("constant bounds are valid")
}

fn quantile_us(histogram: &Histogram<u64>, quantile: f64) -> f64 {
    histogram.value_at_quantile(quantile) as f64 * 1e-3
}

fn ratio(part: f64, whole: f64) -> Option<f64> {
    (whole > 0.0).then_some(part / whole)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{ContactResult, Wrench};
    use crate::environment::MAX_TOUCHES;
    use crate::notation::ActuatorVector;
    use nalgebra::Vector3;

    fn figures(reports: impl IntoIterator<Item = Report>) -> RunFigures {
        let mut summary = RunSummary::new(1_000_000);
        for report in reports {
            summary.observe(&Record { report, ..Record::default() });
        }
        summary.figures(&RoundTrips::default())
    }

    #[test]
    fn percentiles_are_those_of_the_sorted_values() {
        let mut summary = RunSummary::new(1_000_000);
        for i in 1..=10_000_u64 {
            let ns = (i * 7_919) % 10_000 * 10;
            let record = Record {
                wakeup_lateness_ns: ns,
                execution_ns: ns / 2,
                overrun: i % 1_000 == 0,
                ..Record::default()
            };
            summary.observe(&record);
        }
        let found = summary.figures(&RoundTrips::default());
        assert_eq!((found.ticks, found.overruns), (10_000, 10));
        for (found_us, true_us) in [
            (found.wakeup_p50_us, 50.0),
            (found.wakeup_p99_us, 99.0),
            (found.wakeup_p999_us, 99.9),
            (found.tick_p99_us, 49.5),
        ] {
            assert!((found_us / true_us - 1.0).abs() < 2e-3, "{found_us} {true_us}");
        }
    }

    #[test]
    fn the_share_of_next_tick_commands_begins_with_the_first_command() {
        let tick = |command_seq, command_new, command_lag_ticks| Report {
            command_seq,
            command_new,
            command_lag_ticks,
            ..Report::default()
        };
        let none = tick(0, false, 0);
        let before = [none; 5];
        let during = [
            tick(1, true, 1),
            tick(2, true, 1),
            tick(2, false, 2),
            tick(3, true, 2),
            none,
            none,
            none,
            tick(4, true, 1),
        ];
        let after = [none; 7];
        let all = before.into_iter().chain(during).chain(after);
        assert_eq!(figures(all.clone()).command_lag_one_ratio, Some(3.0 / 8.0));
        assert_eq!(figures(all).commanded_ratio, Some(5.0 / 8.0));
        assert_eq!(figures(before).command_lag_one_ratio, None);
    }

    #[test]
    fn stuck_and_switches_count_slide_time_only() {
        let tick = |buttons, stuck, torque_Nm| Report {
            buttons,
            stuck,
            commanded_Nm: ActuatorVector::new(0.0, torque_Nm, 0.0, 0.0, 0.0, 0.0),
            ..Report::default()
        };
        let found = figures([
            tick(0, true, 1.0),
            tick(1, true, 0.0), // engaged before, but that was not slide time
            tick(1, false, 2.0),
            tick(1, false, 3.0),
            tick(1, false, 0.0),
            tick(0, true, 4.0),
        ]);
        assert!((found.stuck_ratio - 0.25).abs() < 1e-12);
        assert!((found.wall_switches_per_s - 2.0 / 0.004).abs() < 1e-9);
    }

    #[test]
    fn depth_error_angle_and_regions_are_taken_from_the_ticks_that_have_them() {
        let mut contacts = [ContactResult::default(); MAX_TOUCHES];
        contacts[0].depth_m = 2e-4;
        contacts[1].depth_m = 9.0; // not counted: only one contact
        let touching = Report {
            contacts,
            contact_count: 1,
            force_error_N: Some(3.0),
            approximation_angle_rad: Some(std::f64::consts::FRAC_PI_3),
            region: Some(Region::Approximate),
            ..Report::default()
        };
        let lighter = Report {
            force_error_N: Some(1.0),
            approximation_angle_rad: Some(0.1),
            region: Some(Region::Full),
            ..Report::default()
        };
        let found = figures([touching, Report::default(), lighter]);
        assert!((found.penetration_max_mm - 0.2).abs() < 1e-12);
        assert_eq!(found.force_error_mean_n, Some(2.0));
        assert!((found.approximation_angle_max_deg.unwrap() - 60.0).abs() < 1e-9);
        let regions = RegionTicks { full: 1, approximate: 1, not_displayable: 0 };
        assert_eq!(found.regions, regions);
    }

    #[test]
    fn energy_is_counted_by_its_sign_and_the_worst_stretch_is_kept() {
        let tick = |force_N: f64, v: f64, moment_Nm: f64, omega: f64| Report {
            rendered: Wrench {
                force_N: Vector3::new(force_N, 0.0, 0.0),
                moment_Nm: Vector3::new(0.0, 0.0, moment_Nm),
            },
            v_WT_m_per_s: Vector3::new(v, 0.0, 0.0),
            omega_WT_rad_per_s: Vector3::new(0.0, 0.0, omega),
            ..Report::default()
        };
        // Watts, a millisecond each: -3, +1, +2, -1, +2, -9.
        let found = figures([
            tick(-3.0, 1.0, 0.0, 0.0),
            tick(1.0, 1.0, 0.0, 0.0),
            tick(0.0, 0.0, 2.0, 1.0),
            tick(0.5, -2.0, 0.0, 0.0),
            tick(1.0, 1.0, 1.0, 1.0),
            tick(f64::NAN, 1.0, 0.0, 0.0),
            tick(9.0, -1.0, 0.0, 0.0),
        ]);
        assert!((found.energy_taken_j - 8e-3).abs() < 1e-12, "{}", found.energy_taken_j);
        assert!((found.energy_given_max_j - 4e-3).abs() < 1e-12, "{}", found.energy_given_max_j);
    }

    #[test]
    fn commands_that_never_came_into_force_are_the_numbers_skipped() {
        let applied = |command_seq| Report { command_seq, command_new: true, ..Report::default() };
        let held = Report { command_seq: 6, ..Report::default() };
        let found = figures([applied(2), applied(3), applied(6), held, applied(1), applied(2)]);
        assert_eq!(found.commands_lost, 3, "1, 4 and 5; a new controller begins again at 1");
    }

    #[test]
    fn figures_that_begin_anew_know_nothing_of_before_but_the_last_command() {
        let tick = |command_seq, wakeup_lateness_ns| {
            let report = Report {
                command_seq,
                command_new: true,
                command_lag_ticks: 1,
                ..Report::default()
            };
            Record { report, wakeup_lateness_ns, overrun: true, ..Record::default() }
        };
        let mut summary = RunSummary::new(1_000_000);
        summary.observe(&tick(40, 900_000));
        let before = summary.take().figures(&RoundTrips::default());
        assert_eq!((before.ticks, before.overruns, before.commands_lost), (1, 1, 39));
        assert_eq!(summary.figures(&RoundTrips::default()).ticks, 0);
        summary.observe(&tick(42, 10_000));
        let after = summary.take().figures(&RoundTrips::default());
        assert_eq!((after.ticks, after.overruns, after.commands_lost), (1, 1, 1));
        assert_eq!(after.command_lag_one_ratio, Some(1.0));
        assert!(after.wakeup_p999_us < 11.0, "{}", after.wakeup_p999_us);
    }

    #[test]
    fn the_figures_are_one_object_with_the_promised_names() {
        let round_trips = RoundTrips::default();
        round_trips.record(120_000);
        let figures = RunSummary::new(1_000_000).figures(&round_trips);
        let json = serde_json::to_value(figures).unwrap();
        for name in [
            "ticks",
            "overruns",
            "wakeup_p50_us",
            "wakeup_p99_us",
            "wakeup_p999_us",
            "tick_p99_us",
            "rtt_p50_us",
            "rtt_p99_us",
            "command_lag_one_ratio",
            "commanded_ratio",
            "commands_lost",
            "energy_taken_j",
            "energy_given_max_j",
            "penetration_max_mm",
            "force_error_mean_n",
            "approximation_angle_max_deg",
            "stuck_ratio",
            "wall_switches_per_s",
        ] {
            assert!(json.get(name).is_some(), "{name}");
        }
        for name in ["full", "approximate", "not_displayable"] {
            assert_eq!(json["regions"][name], 0);
        }
        assert!((json["rtt_p50_us"].as_f64().unwrap() / 120.0 - 1.0).abs() < 1e-2);
        assert_eq!(json["commands_lost"], 0);
        assert!(json["force_error_mean_n"].is_null());
    }
}
