//! What a scene saw of its wall: figures of a run from the client's side of the network.

use hdrhistogram::Histogram;
use serde_json::{Value, json};

use crate::proto::{Region, State};

/// Round trips are counted up to a minute, microseconds.
const LONGEST_US: u64 = 60_000_000;

/// Of all States that came, in constant memory.
#[derive(Debug)]
pub struct Figures {
    /// Seen; those that a newer one had overtaken when they could be seen came and were not.
    states: u64,
    came: u64,
    /// Numbers of the first State and of the newest.
    numbers: Option<(u64, u64)>,
    /// From a Command to the State that echoes it, less the time that the server held it.
    round_trips_us: Histogram<u64>,
    touching: u64,
    approximate: u64,
    depth_m: (f64, f64),
    asked_N: f64,
    lag_ticks: u64,
    commanded: u64,
    echoed_ns: u64,
}

impl Figures {
    /// Nothing was seen.
    pub fn new() -> Self {
        let histogram = Histogram::new_with_bounds(1, LONGEST_US, 3);
        Self {
            states: 0,
            came: 0,
            numbers: None,
            round_trips_us: histogram.expect("the bounds are constants"),
            touching: 0,
            approximate: 0,
            depth_m: (0.0, 0.0),
            asked_N: 0.0,
            lag_ticks: 0,
            commanded: 0,
            echoed_ns: 0,
        }
    }

    /// How many came, seen or not.
    pub fn came(&mut self, came: u64) {
        self.came = came;
    }

    /// A State that came when the client's own clock was at `now_ns`.
    pub fn saw(&mut self, state: &State, now_ns: u64) {
        self.states += 1;
        let (first, newest) = self.numbers.unwrap_or((state.seq, state.seq));
        self.numbers = Some((first.min(state.seq), newest.max(state.seq)));
        if state.command_seq > 0 {
            self.commanded += 1;
            self.lag_ticks += u64::from(state.command_lag_ticks);
        }
        // Each Command counts once, with the first State that tells of it.
        if state.echo_client_time_ns > self.echoed_ns {
            self.echoed_ns = state.echo_client_time_ns;
            let out_ns = now_ns.saturating_sub(state.echo_client_time_ns);
            let trip_us = out_ns.saturating_sub(state.echo_hold_ns.into()) / 1000;
            self.round_trips_us.saturating_record(trip_us.max(1));
        }
        let Some(depth_m) = state.contact_depth_m.iter().copied().reduce(f32::max) else { return };
        self.touching += 1;
        self.depth_m.0 += f64::from(depth_m);
        self.depth_m.1 = self.depth_m.1.max(depth_m.into());
        let squares = state.requested.iter().take(3).map(|part| f64::from(*part).powi(2));
        self.asked_N += squares.sum::<f64>().sqrt();
        self.approximate += u64::from(state.region() == Region::Approximate);
    }

    /// One object, units in the names; `null` where there is nothing to say.
    pub fn to_json(&self, commands: u64) -> Value {
        let share = |count: u64, of: u64| (of > 0).then(|| count as f64 / of as f64);
        let mean = |sum: f64, of: u64| (of > 0).then(|| sum / of as f64);
        let trips = &self.round_trips_us;
        let at_ms =
            |quantile| (!trips.is_empty()).then(|| trips.value_at_quantile(quantile) as f64 * 1e-3);
        let ticks = self.numbers.map_or(0, |(first, newest)| newest - first + 1);
        json!({
            "states": self.came.max(self.states),
            "ticks": ticks,
            "states_ratio": share(self.came.max(self.states), ticks),
            "commands": commands,
            "command_round_trips": trips.len(),
            "rtt_p50_ms": at_ms(0.5),
            "rtt_p99_ms": at_ms(0.99),
            "commanded_ratio": share(self.commanded, self.states),
            "command_lag_mean_ticks": mean(self.lag_ticks as f64, self.commanded),
            "touching_ratio": share(self.touching, self.states),
            "penetration_mean_mm": mean(self.depth_m.0 * 1e3, self.touching),
            "penetration_max_mm": (self.touching > 0).then_some(self.depth_m.1 * 1e3),
            "requested_mean_n": mean(self.asked_N, self.touching),
            "approximate_ratio": share(self.approximate, self.touching),
        })
    }

    /// The same in a line for people.
    pub fn in_words(&self, commands: u64) -> String {
        let figures = self.to_json(commands);
        let number = |name: &str, unit: &str| {
            figures[name].as_f64().map_or("-".to_owned(), |value| format!("{value:.3}{unit}"))
        };
        format!(
            "{} States, {commands} commands, round trip {} (p99 {}), touching {} of the time, \
             {} deep at most, {} asked on average",
            self.states,
            number("rtt_p50_ms", " ms"),
            number("rtt_p99_ms", " ms"),
            number("touching_ratio", ""),
            number("penetration_max_mm", " mm"),
            number("requested_mean_n", " N"),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_without_anything_has_no_figures_and_no_zero_for_unknown() {
        let figures = Figures::new();
        let told = figures.to_json(0);
        assert_eq!(told["states"], 0);
        for name in ["states_ratio", "rtt_p50_ms", "penetration_max_mm", "commanded_ratio"] {
            assert_eq!(told[name], Value::Null, "{name}");
        }
        assert!(figures.in_words(0).contains("round trip -"));
    }

    #[test]
    fn each_command_is_timed_once_without_the_time_that_the_server_held_it() {
        let mut figures = Figures::new();
        let state = State {
            seq: 10,
            command_seq: 1,
            command_lag_ticks: 3,
            echo_client_time_ns: 1_000_000,
            echo_hold_ns: 500_000,
            contact_depth_m: vec![1e-4, 2e-4],
            requested: vec![3.0, 4.0, 0.0],
            ..State::default()
        };
        figures.saw(&state, 3_500_000);
        // The next State tells of the same command; one in between was lost.
        figures.saw(&State { seq: 12, contact_depth_m: vec![], ..state }, 5_500_000);
        let told = figures.to_json(2);
        assert_eq!((&told["states"], &told["ticks"]), (&2.into(), &3.into()));
        assert_eq!(told["command_round_trips"], 1);
        assert!((told["rtt_p50_ms"].as_f64().unwrap() - 2.0).abs() < 0.01, "{told}");
        assert_eq!(told["touching_ratio"], 0.5);
        assert!((told["penetration_max_mm"].as_f64().unwrap() - 0.2).abs() < 1e-6);
        assert!((told["requested_mean_n"].as_f64().unwrap() - 5.0).abs() < 1e-9);
        assert_eq!(told["command_lag_mean_ticks"], 3.0);
    }
}
