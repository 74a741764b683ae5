//! Wake-up lateness of hapticd's loop beside that of `cyclictest`: promise 1.
//!
//! Two kinds of blocks take turns, in changing order. In the one, processor P runs the loop of
//! a hapticd; in the other it runs `cyclictest`, while the same hapticd, its loop on another
//! processor, serves the same sessions. The load is the same both times: eight sessions at
//! 1 kHz that answer every State (one is the controller, the commands of the others are read
//! and refused), each a thread of this process, and the server's other threads, all of them
//! free to run on any processor. The server is a process of its own with all its rights, or it
//! does not start.
//!
//! Both measured threads are pinned to P, under SCHED_FIFO 80, with locked memory and no deep
//! sleep of the processors; both sleep to absolute times 1 ms apart, skip those that are past,
//! and report how long after such a time they read the clock.
//!
//! The load comes in bursts, one after every tick, and two threads of the same period never
//! drift apart. So `cyclictest` is made to wake up shortly before the loop on the other
//! processor, as far from the burst as a tick is, and not wherever chance puts it.
//!
//! `--pairs N`, `--seconds N` (of a block) and `--cpu P`; `--quick` is a trial.

mod clients;
mod measure;
mod server;

use std::io::ErrorKind;
use std::process::Command;
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::Context;
use clients::{Crowd, Session};
use hapticd::client::{Client, ConnectString, Incoming, Options};
use hapticd::proto::Role;
use measure::{Series, quick};
use rustix::thread::{CpuSet, sched_getaffinity};
use server::Server;

/// The tool of the comparison, of Debian's package `rt-tests`.
const CYCLICTEST: &str = "cyclictest";

/// Sessions, one of them the controller.
const SESSIONS: usize = 8;

/// Before a block: handshakes are not the load.
const WARM_UP: Duration = Duration::from_secs(1);

/// Between two wake-ups.
const PERIOD_US: u64 = 1000;

/// `cyclictest` wakes up so long before the loop on the other processor: when what the tick
/// before has set going is as far done, and not in the same moment.
const BEFORE_US: u64 = 50;

/// Ticks that tell when the loop wakes up.
const PHASE_TICKS: usize = 201;

/// What is later counts as this late.
const LATEST_US: u64 = 100_000;

fn main() -> anyhow::Result<()> {
    if let Some(config) = server::asked() {
        return server::serve(&config);
    }
    let (pairs, seconds) = if quick() { (2, 3) } else { (5, 20) };
    let pairs = argument("--pairs")?.unwrap_or(pairs).max(1);
    let seconds = argument("--seconds")?.unwrap_or(seconds).max(1) as u64;
    let Some([measured, other]) = processors(argument("--cpu")?)? else {
        println!("nothing measured: the comparison needs two processors");
        return Ok(());
    };
    if !is_there()? {
        println!("nothing measured: no {CYCLICTEST}; `apt-get install rt-tests` brings it");
        return Ok(());
    }
    println!(
        "wake-up lateness at 1 kHz, SCHED_FIFO 80, pinned to processor {measured}, beside {SESSIONS} sessions that answer every State; {seconds} s a block"
    );
    println!(
        "{:4} | {:-^27} {:>8} | {:-^27} {:>8} | p99.9 ratio",
        "pair", " hapticd's loop, us ", "answers", " cyclictest, us ", "answers"
    );
    let columns = format!("{:>6} {:>6} {:>6} {:>6}", "p50", "p99", "p99.9", "wakes");
    println!("{:4} | {columns} {:>8} | {columns} {:>8} |", "", "per s", "per s");
    let mut ratios = Vec::new();
    for pair in 0..pairs {
        let ours = || block(measured, |server| ours(server, seconds));
        let theirs = || block(other, |server| theirs(server, measured, seconds));
        let (ours, theirs) = if pair % 2 == 0 {
            let ours = ours()?;
            (ours, theirs()?)
        } else {
            let theirs = theirs()?;
            (ours()?, theirs)
        };
        let ratio = ours.lateness.p999_us / theirs.lateness.p999_us;
        println!("{:4} | {ours} | {theirs} | {ratio:.2}", pair + 1);
        ratios.push(ratio);
    }
    ratios.sort_by(f64::total_cmp);
    println!(
        "p99.9 of hapticd's loop beside cyclictest: {:.2} (median of {pairs} pairs; {:.2} to {:.2})",
        ratios[pairs / 2],
        ratios[0],
        ratios[pairs - 1],
    );
    Ok(())
}

/// Where P is measured and another one is, if there are two that this process may use.
fn processors(wanted: Option<usize>) -> anyhow::Result<Option<[usize; 2]>> {
    let allowed = sched_getaffinity(None)?;
    let allowed: Vec<_> = (0..CpuSet::MAX_CPU).filter(|&cpu| allowed.is_set(cpu)).collect();
    let Some(measured) = wanted.or(allowed.last().copied()) else { return Ok(None) };
    let other = allowed.into_iter().find(|&cpu| cpu != measured);
    Ok(other.map(|other| [measured, other]))
}

/// The number after `name` on the command line.
fn argument(name: &str) -> anyhow::Result<Option<usize>> {
    let mut arguments = std::env::args().skip_while(|argument| argument != name).skip(1);
    let parse = |text: String| text.parse().with_context(|| format!("{name} {text}: no number"));
    arguments.next().map(parse).transpose()
}

fn is_there() -> std::io::Result<bool> {
    match Command::new(CYCLICTEST).arg("--help").output() {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
        found => found.map(|_| true),
    }
}

/// Whole microseconds, rounded down, as `cyclictest` counts them.
struct Lateness {
    p50_us: f64,
    p99_us: f64,
    p999_us: f64,
    wakes: f64,
}

/// What came of a block.
struct Block {
    lateness: Lateness,
    /// States that all sessions got and answered, per second: both blocks of a pair should
    /// have the same.
    answers_per_s: f64,
}

impl std::fmt::Display for Block {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Lateness { p50_us, p99_us, p999_us, wakes } = self.lateness;
        let answers = self.answers_per_s;
        write!(out, "{p50_us:>6} {p99_us:>6} {p999_us:>6} {wakes:>6} {answers:>8.0}")
    }
}

/// A server with its loop on `cpu`, the sessions, and what `measure` finds meanwhile.
fn block(
    cpu: usize,
    measure: impl FnOnce(&mut Server) -> anyhow::Result<Lateness>,
) -> anyhow::Result<Block> {
    let mut server = Server::start(&format!("rt_cpu = {cpu}\nrealtime = \"enforce\""))?;
    let mut crowd = Crowd::new(server.target());
    for number in 0..SESSIONS {
        let role = if number == 0 { Role::Controller } else { Role::Observer };
        crowd.join(&[Session { role, state_interval: Duration::ZERO, answers: true }])?;
    }
    sleep(WARM_UP);
    let (begin, before) = (Instant::now(), crowd.received());
    let lateness = measure(&mut server)?;
    let (took, after) = (begin.elapsed(), crowd.received());
    anyhow::ensure!(crowd.lost() == 0, "{} sessions were lost", crowd.lost());
    let answers = after.iter().sum::<u64>() - before.iter().sum::<u64>();
    Ok(Block { lateness, answers_per_s: answers as f64 / took.as_secs_f64() })
}

/// The loop tells of its own wake-ups.
fn ours(server: &mut Server, seconds: u64) -> anyhow::Result<Lateness> {
    server.take_figures()?;
    sleep(Duration::from_secs(seconds));
    let figures = server.take_figures()?;
    Ok(Lateness {
        p50_us: figures.get("wakeup_p50_us")?.floor(),
        p99_us: figures.get("wakeup_p99_us")?.floor(),
        p999_us: figures.get("wakeup_p999_us")?.floor(),
        wakes: figures.get("ticks")?,
    })
}

fn theirs(server: &Server, cpu: usize, seconds: u64) -> anyhow::Result<Lateness> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let phase_us =
        (runtime.block_on(phase_us(server.target()))? + PERIOD_US - BEFORE_US) % PERIOD_US;
    let mut command = Command::new(CYCLICTEST);
    command.args(["--quiet", "--mlockall", "--threads=1", "--priority=80", "--interval=1000"]);
    command.args([
        format!("--secaligned={phase_us}"),
        format!("--affinity={cpu}"),
        format!("--duration={seconds}"),
        format!("--histogram={LATEST_US}"),
    ]);
    let output = command.output()?;
    let said = String::from_utf8_lossy(&output.stderr);
    anyhow::ensure!(output.status.success(), "{CYCLICTEST}: {}: {}", output.status, said.trim());
    let series = histogram(&String::from_utf8_lossy(&output.stdout))?;
    let us = |quantile| series.us(quantile).floor();
    Ok(Lateness {
        p50_us: us(0.5),
        p99_us: us(0.99),
        p999_us: us(0.999),
        wakes: series.len() as f64,
    })
}

/// When, within a period of the monotonic clock, the loop wakes up: the median of its ticks,
/// counted from half a period before the first, so that hardly any is on the other side.
async fn phase_us(target: &ConnectString) -> anyhow::Result<u64> {
    let mut client = Client::connect(target, Options::new("phase", Role::Observer)).await?;
    let mut times_us = Vec::new();
    while times_us.len() < PHASE_TICKS {
        if let Incoming::State(state) = client.next().await? {
            times_us.push(state.device_time_ns / 1000);
        }
    }
    client.close().await;
    let start_us = times_us[0] - PERIOD_US / 2;
    let mut phases_us: Vec<_> = times_us.iter().map(|us| (us - start_us) % PERIOD_US).collect();
    phases_us.sort_unstable();
    Ok((start_us + phases_us[PHASE_TICKS / 2]) % PERIOD_US)
}

/// The latencies in the histogram that `cyclictest` prints: lines of microseconds and a count,
/// and how many there were beyond them.
fn histogram(text: &str) -> anyhow::Result<Series> {
    const BEYOND: &str = "# Histogram Overflows:";
    let mut series = Series::new(CYCLICTEST);
    for line in text.lines() {
        let (us, count) = match line.strip_prefix(BEYOND) {
            Some(count) => (LATEST_US, count.trim().parse()?),
            None if line.starts_with('#') || line.is_empty() => continue,
            None => {
                let (us, count) = line.split_once(' ').context("no histogram")?;
                (us.parse()?, count.trim().parse()?)
            }
        };
        for _ in 0..count {
            series.record(Duration::from_micros(us));
        }
    }
    anyhow::ensure!(series.len() > 0, "{CYCLICTEST} counted nothing");
    Ok(series)
}
