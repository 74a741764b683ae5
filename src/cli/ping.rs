//! `hapticd ping`: the round trip to a server's stream, and a word on it.

use std::time::{Duration, Instant};

use anyhow::ensure;
use clap::Args;
use hdrhistogram::Histogram;
use serde_json::json;

use super::format::{device_resource, parse_seconds};
use crate::app::echo::{QuicEcho, Served, Way, block};
use crate::client::{Client, ConnectString, Incoming, Options};
use crate::proto::Role;
use crate::telemetry::durations_ns;

/// Bounds of the wait for the last answers.
const LEAST_PATIENCE: Duration = Duration::from_millis(100);
const MOST_PATIENCE: Duration = Duration::from_secs(1);

/// Pings of one block of a comparison, and rounds of two blocks at least.
const BLOCK: usize = 100;
const LEAST_ROUNDS: usize = 3;

/// Measure the round trip to a server's stream thread.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd ping 127.0.0.1:7351
  hapticd ping --baseline --seconds 5
  hapticd ping 'hapticd://127.0.0.1:7351/?sha256=...' --seconds 10 --json")]
pub struct Ping {
    /// Where the server is: the line that `serve` prints, or HOST:PORT on this machine
    #[arg(value_name = "TARGET", default_value = "127.0.0.1:7351")]
    target: ConnectString,
    /// Which device, where there are several
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
    /// How long to measure
    #[arg(long, value_name = "N", default_value = "3", value_parser = parse_seconds, allow_negative_numbers = true)]
    seconds: Duration,
    /// Pings per second, 1 to 1000
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rate: u32,
    /// Beside a bare QUIC echo on this machine, in turns: what hapticd adds
    #[arg(long)]
    baseline: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Ping {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        super::runtime()?.block_on(self.measure())
    }

    async fn measure(self) -> anyhow::Result<()> {
        // Few States, so that the pings measure the way and not each other's company.
        let state_interval = Duration::from_millis(100);
        let options = Options {
            state_interval,
            // Every ping is one of these, and every answer is one of theirs.
            pings: false,
            device: device_resource(self.device.as_deref()),
            ..Options::new("hapticd ping", Role::Observer)
        };
        if self.baseline {
            return self.compare(options).await;
        }
        let mut client = Client::connect(&self.target, options).await?;
        let mut round_trips_ns = durations_ns();
        let mut sent = 0u64;
        let mut pace = tokio::time::interval(Duration::from_secs(1) / self.rate);
        let mut over = Instant::now() + self.seconds;
        // When the last ping has been sent there is still its answer to wait for.
        let mut sending = true;
        while sending || round_trips_ns.len() < sent {
            tokio::select! {
                biased;
                incoming = client.next() => {
                    if let Incoming::RoundTrip(time) = incoming? {
                        round_trips_ns.saturating_record(time.as_nanos() as u64);
                    }
                }
                _ = pace.tick(), if sending && Instant::now() < over => {
                    client.send_ping()?;
                    sent += 1;
                }
                () = tokio::time::sleep_until(over.into()) => {
                    if !sending {
                        break;
                    }
                    sending = false;
                    over += patience(&round_trips_ns);
                }
            }
        }
        client.close().await;
        self.print(sent, &round_trips_ns)
    }

    /// Blocks of pings to the server and to the bare echo, in turns, so that whatever else the
    /// machine does meets both; the ratio is the median of those of the rounds.
    async fn compare(self, options: Options) -> anyhow::Result<()> {
        ensure!(
            self.target.is_loopback(),
            "--baseline compares on one machine: {} is another",
            self.target
        );
        let mut server = Served(Client::connect(&self.target, options).await?);
        let mut echo = QuicEcho::start().await?;
        let pace = Duration::from_secs(1) / self.rate;
        let over = Instant::now() + self.seconds;
        let (mut served, mut bare) = (durations_ns(), durations_ns());
        let mut ratios = Vec::new();
        while ratios.len() < LEAST_ROUNDS || Instant::now() < over {
            let [of_server, of_echo] = if ratios.len() % 2 == 0 {
                let first = p50_us(&mut server, pace, &mut served).await?;
                [first, p50_us(&mut echo, pace, &mut bare).await?]
            } else {
                let first = p50_us(&mut echo, pace, &mut bare).await?;
                [p50_us(&mut server, pace, &mut served).await?, first]
            };
            ratios.push(of_server / of_echo);
        }
        server.0.close().await;
        ratios.sort_by(f64::total_cmp);
        let ratio = ratios[ratios.len() / 2];
        let us = |times: &Histogram<u64>, quantile| times.value_at_quantile(quantile) as f64 * 1e-3;
        if self.json {
            let figures = json!({
                "quic_ratio": ratio,
                "quic_ratio_least": ratios[0],
                "quic_ratio_most": ratios[ratios.len() - 1],
                "rounds": ratios.len(),
                "rtt_p50_us": us(&served, 0.5),
                "rtt_p99_us": us(&served, 0.99),
                "baseline_p50_us": us(&bare, 0.5),
                "baseline_p99_us": us(&bare, 0.99),
            });
            say!("{figures}");
            return Ok(());
        }
        for (name, times) in [("hapticd", &served), ("bare QUIC echo", &bare)] {
            say!("{name:<15} p50 {:>5.0} us, p99 {:>5.0} us", us(times, 0.5), us(times, 0.99));
        }
        say!(
            "ratio of the medians {ratio:.2} (median of {} rounds, {:.2} to {:.2})",
            ratios.len(),
            ratios[0],
            ratios[ratios.len() - 1]
        );
        Ok(())
    }

    fn print(&self, sent: u64, round_trips_ns: &Histogram<u64>) -> anyhow::Result<()> {
        let answered = round_trips_ns.len();
        ensure!(answered > 0, "no ping was answered in {:?}", self.seconds);
        let us = |quantile| round_trips_ns.value_at_quantile(quantile) as f64 * 1e-3;
        if self.json {
            let figures = json!({
                "sent": sent,
                "answered": answered,
                "rtt_min_us": round_trips_ns.min() as f64 * 1e-3,
                "rtt_p50_us": us(0.5),
                "rtt_p99_us": us(0.99),
                "rtt_max_us": round_trips_ns.max() as f64 * 1e-3,
            });
            say!("{figures}");
            return Ok(());
        }
        let lost = 100.0 * (sent - answered) as f64 / sent as f64;
        say!("{answered} of {sent} pings answered ({lost:.1} % lost)");
        say!("round trip: p50 {:.0} us, p99 {:.0} us, worst {:.0} us", us(0.5), us(0.99), us(1.0));
        say!("{}", verdict(us(0.5), us(0.99)));
        Ok(())
    }
}

/// Median of one block, which also goes to the figures of the whole run.
async fn p50_us(
    way: &mut impl Way,
    pace: Duration,
    all: &mut Histogram<u64>,
) -> anyhow::Result<f64> {
    let mut here = durations_ns();
    let record = |time: Duration| {
        here.saturating_record(time.as_nanos() as u64);
        all.saturating_record(time.as_nanos() as u64);
    };
    block(way, BLOCK, pace, record).await?;
    Ok(here.value_at_quantile(0.5) as f64 * 1e-3)
}

/// How long the last answers are waited for: the longest round trip so far, and some more.
fn patience(round_trips_ns: &Histogram<u64>) -> Duration {
    (2 * Duration::from_nanos(round_trips_ns.max())).clamp(LEAST_PATIENCE, MOST_PATIENCE)
}

/// What the figures mean to a scene that answers every State.
fn verdict(p50_us: f64, p99_us: f64) -> &'static str {
    if p99_us < 500.0 {
        "a scene's command arrives before the next tick at 1 kHz"
    } else if p99_us < 20_000.0 {
        "good for streamed contacts: they are rendered at the device"
    } else if p50_us < 100_000.0 {
        "contacts work with a longer time-to-live; expect walls to arrive late"
    } else {
        "too slow for anything but configuration"
    }
}
