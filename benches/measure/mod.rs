//! What every bench shares: its options, the time of single calls, and a table of percentiles.
//!
//! Every call is timed on its own, because a promise about the 99th percentile is not kept by
//! a mean over many calls; what reading the clock itself costs is a row of its own. A table
//! has one row as its unit: figures of different machines compare as ratios to it.

#![allow(dead_code)] // each bench takes what it needs

use std::hint::black_box;
use std::time::{Duration, Instant};

use hdrhistogram::Histogram;

/// `--quick` was given: a few seconds instead of a good figure. Other arguments, such as the
/// `--bench` that cargo adds, mean nothing here.
pub fn quick() -> bool {
    std::env::args().any(|argument| argument == "--quick")
}

/// `full`, or a tenth of it with `--quick`.
pub fn rounds(full: usize) -> usize {
    if quick() { full.div_ceil(10) } else { full }
}

/// Durations of one kind of call.
pub struct Series {
    name: String,
    ns: Histogram<u64>,
}

impl Series {
    /// No call yet.
    pub fn new(name: impl Into<String>) -> Self {
        let ns = Histogram::new_with_bounds(1, 10_000_000_000, 3);
        Self { name: name.into(), ns: ns.expect("constant bounds are valid") }
    }

    /// Calls `work` and takes its time.
    pub fn time<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let (took, result) = timed(work);
        self.record(took);
        result
    }

    /// Takes a time that was measured elsewhere.
    pub fn record(&mut self, took: Duration) {
        self.ns.saturating_record(took.as_nanos() as u64);
    }

    /// How many there are.
    pub fn len(&self) -> u64 {
        self.ns.len()
    }

    /// A quantile in microseconds.
    pub fn us(&self, quantile: f64) -> f64 {
        self.ns.value_at_quantile(quantile) as f64 * 1e-3
    }
}

/// Calls `work`; the time it took, and what came of it.
pub fn timed<T>(work: impl FnOnce() -> T) -> (Duration, T) {
    let begin = Instant::now();
    let result = black_box(work());
    (begin.elapsed(), result)
}

/// The time of doing nothing: every other figure contains it once.
pub fn clock_alone() -> Series {
    let mut clock = Series::new("(the clock alone)");
    for _ in 0..100_000 {
        clock.time(|| ());
    }
    clock
}

/// Prints the rows, each beside the median of `unit`.
pub fn print_table<'a>(title: &str, unit: &Series, rows: impl IntoIterator<Item = &'a Series>) {
    let rows: Vec<_> = rows.into_iter().collect();
    let width = rows.iter().map(|row| row.name.len()).max().unwrap_or(0).max(title.len());
    println!(
        "{title:width$} {:>8} {:>9} {:>9} {:>9} {:>8}",
        "calls", "p50/us", "p99/us", "p99.9/us", "p50/unit"
    );
    for row in rows {
        let [p50, p99, p999] = [0.5, 0.99, 0.999].map(|quantile| row.us(quantile));
        let ratio = p50 / unit.us(0.5);
        println!(
            "{:width$} {:>8} {p50:>9.3} {p99:>9.3} {p999:>9.3} {ratio:>8.2}",
            row.name,
            row.len()
        );
    }
    println!("unit: {}\n", unit.name);
}
