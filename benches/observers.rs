//! A controller beside ever more observers: promises 6 and 3.
//!
//! Four companies of one controller that answers every State at 1 kHz take turns: it alone;
//! with seven observers of every tick; with 32 observers at 250 Hz, which are to get at least
//! 95 % of their States and to disturb neither the loop nor the controller; with 64 observers
//! of every tick, which is more than is promised and shows what gives way first. Each block
//! has a server of its own, in a process of its own, with the real-time rights that it gets.
//!
//! All clients are in this one process: promised is what the server sends and how its loop
//! fares, and 64 processes would first of all measure how this machine changes between them.
//! The controller has a thread to itself, as a simulator has; eight observers share one, each
//! with its own socket. A State is due once per interval of wall-clock time, so ticks that the
//! loop leaves out are States that an observer misses.

mod clients;
mod measure;
mod server;

use std::thread::sleep;
use std::time::{Duration, Instant};

use clients::{Crowd, Session};
use hapticd::proto::Role;
use measure::{quick, rounds};
use server::Server;

/// Before a block: handshakes are not the load.
const WARM_UP: Duration = Duration::from_secs(1);

/// Observers that share a thread.
const TOGETHER: usize = 8;

/// Who is there beside the controller.
struct Company {
    name: &'static str,
    observers: usize,
    interval: Duration,
}

const COMPANIES: [Company; 4] = [
    Company { name: "controller alone", observers: 0, interval: TICK },
    Company { name: "with 7 observers at 1 kHz", observers: 7, interval: TICK },
    Company {
        name: "with 32 observers at 250 Hz",
        observers: 32,
        interval: TICK.saturating_mul(4),
    },
    Company { name: "with 64 observers at 1 kHz", observers: 64, interval: TICK },
];

const TICK: Duration = Duration::from_millis(1);

/// The columns of the table, each with its decimals.
const COLUMNS: [(&str, usize); 9] = [
    ("next/%", 2),
    ("p50/us", 0),
    ("p99/us", 0),
    ("p99.9/us", 0),
    ("ticks", 0),
    ("overruns", 0),
    ("worst/%", 1),
    ("median/%", 1),
    ("lost", 0),
];

/// What came of a block, by the columns. Not a number: there was nobody.
type Row = [f64; COLUMNS.len()];

fn main() -> anyhow::Result<()> {
    if let Some(config) = server::asked() {
        return server::serve(&config);
    }
    let time = Duration::from_secs(if quick() { 2 } else { 4 });
    let rounds = rounds(3);
    println!(
        "next: ticks with a command computed from the State of the tick before; p50 to p99.9: wake-up\n\
         lateness of the loop; worst, median: States that an observer got of those due; lost: sessions"
    );
    print_header(&format!("{} s each", time.as_secs()));
    let mut found = [(); COMPANIES.len()].map(|()| Vec::new());
    for round in 0..rounds {
        for turn in 0..COMPANIES.len() {
            let which = (round + turn) % COMPANIES.len();
            let row = block(&COMPANIES[which], time)?;
            print_row(COMPANIES[which].name, &row);
            found[which].push(row);
        }
    }
    print_header(&format!("median of {rounds}"));
    for (company, rows) in COMPANIES.iter().zip(&found) {
        let medians = std::array::from_fn(|column| median(rows.iter().map(|row| row[column])));
        print_row(company.name, &medians);
    }
    Ok(())
}

/// One company beside a server of its own.
fn block(company: &Company, time: Duration) -> anyhow::Result<Row> {
    let mut server = Server::start("")?;
    let mut crowd = Crowd::new(server.target());
    let observer =
        Session { role: Role::Observer, state_interval: company.interval, answers: false };
    let observers = vec![observer; company.observers];
    for together in observers.chunks(TOGETHER) {
        crowd.join(together)?;
    }
    let every_tick = Duration::ZERO;
    crowd.join(&[Session { role: Role::Controller, state_interval: every_tick, answers: true }])?;
    sleep(WARM_UP);
    server.take_figures()?;
    let (begin, before) = (Instant::now(), crowd.received());
    sleep(time);
    let (took, after) = (begin.elapsed(), crowd.received());
    let figures = server.take_figures()?;
    let due = took.as_secs_f64() / company.interval.as_secs_f64();
    let received: Vec<_> = after
        .iter()
        .zip(&before)
        .take(company.observers)
        .map(|(after, before)| 100.0 * (after - before) as f64 / due)
        .collect();
    Ok([
        100.0 * figures.get("command_lag_one_ratio").unwrap_or(f64::NAN),
        figures.get("wakeup_p50_us")?,
        figures.get("wakeup_p99_us")?,
        figures.get("wakeup_p999_us")?,
        figures.get("ticks")?,
        figures.get("overruns")?,
        received.iter().copied().fold(f64::NAN, f64::min),
        median(received),
        crowd.lost() as f64,
    ])
}

/// Of nothing: not a number.
fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<_> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn print_header(title: &str) {
    print!("\n{title:27}");
    for (name, _) in COLUMNS {
        print!(" {name:>8}");
    }
    println!();
}

fn print_row(name: &str, row: &Row) {
    print!("{name:27}");
    for (value, (_, decimals)) in row.iter().zip(COLUMNS) {
        if value.is_nan() {
            print!(" {:>8}", "-");
        } else {
            print!(" {value:>8.decimals$}");
        }
    }
    println!();
}
