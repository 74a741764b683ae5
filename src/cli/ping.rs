//! `hapticd ping`: the round trip to a server's stream over each transport, and a word on it.

use std::time::{Duration, Instant};

use anyhow::ensure;
use clap::Args;
use hdrhistogram::Histogram;
use serde_json::{Map, Value, json};

use super::format::{device_resource, parse_seconds};
use crate::app::echo::{QuicEcho, Served, UdpEcho, Way, block};
use crate::client::{Client, ConnectString, Incoming, Options, Transport};
use crate::proto::Role;
use crate::telemetry::durations_ns;

/// Bounds of the wait for the last answers.
const LEAST_PATIENCE: Duration = Duration::from_millis(100);
const MOST_PATIENCE: Duration = Duration::from_secs(1);

/// Pings of one block of a comparison, and rounds of two blocks at least.
const BLOCK: usize = 100;
const LEAST_ROUNDS: usize = 3;

/// Measure the round trip to a server's stream thread, over each transport in turn.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd ping 127.0.0.1:7351
  hapticd ping --transport udp
  hapticd ping --baseline --seconds 5
  hapticd ping 'hapticd://127.0.0.1:7351/?sha256=...' --seconds 10 --json")]
pub struct Ping {
    /// Where the server is: the line that `serve` prints, or HOST:PORT on this machine
    #[arg(value_name = "TARGET", default_value = "127.0.0.1:7351")]
    target: ConnectString,
    /// Which device, where there are several
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
    /// quic, webtransport or udp; without it, all of them
    #[arg(long, value_name = "TRANSPORT")]
    transport: Option<Transport>,
    /// How long to measure each
    #[arg(long, value_name = "N", default_value = "3", value_parser = parse_seconds, allow_negative_numbers = true)]
    seconds: Duration,
    /// Pings per second, 1 to 1000; 200 without it, and beside an echo as many as a scene has
    /// answers: 1000. The fewer, the more both have gone cold in between
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    rate: Option<u32>,
    /// Beside a bare echo on this machine, in turns: what hapticd adds. QUIC and WebTransport
    /// beside bare QUIC, sealed UDP beside bare UDP
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
        ensure!(
            !self.baseline || self.target.is_loopback(),
            "--baseline compares on one machine: {} is another",
            self.target
        );
        let every = Transport::ALL;
        let wanted = self.transport.as_ref().map_or(&every[..], std::slice::from_ref);
        let (mut figures, mut failed) = (Map::new(), Vec::new());
        for transport in wanted {
            let measured = match (self.baseline, transport) {
                (false, _) => self.alone(*transport).await,
                (true, Transport::Udp) => self.beside(*transport, UdpEcho::start().await?).await,
                (true, _) => self.beside(*transport, QuicEcho::start().await?).await,
            };
            match measured {
                Ok(measured) => self.take(*transport, &measured, &mut figures),
                // One that a firewall stops says nothing of the others.
                Err(error) if wanted.len() > 1 => {
                    failed.push(transport.name());
                    eprintln!("{transport}: {error:#}");
                    figures.insert(transport.name().into(), Value::Null);
                }
                Err(error) => return Err(error),
            }
        }
        if self.json {
            say!("{}", Value::Object(figures));
        }
        ensure!(failed.len() < wanted.len(), "no transport reaches {}", self.target);
        Ok(())
    }

    fn take(&self, transport: Transport, measured: &Measured, figures: &mut Map<String, Value>) {
        if !self.json {
            return measured.tell(transport);
        }
        if let Some(beside) = &measured.beside {
            let name = |what: &str| format!("{transport}_ratio{what}");
            figures.insert(name(""), json!(beside.ratio()));
            figures.insert(name("_least"), json!(beside.ratios.first()));
            figures.insert(name("_most"), json!(beside.ratios.last()));
        }
        figures.insert(transport.name().into(), measured.json());
    }

    fn pace(&self) -> Duration {
        let usual = if self.baseline { 1000 } else { 200 };
        Duration::from_secs(1) / self.rate.unwrap_or(usual)
    }

    async fn connect(&self, transport: Transport) -> anyhow::Result<Client> {
        // Few States, so that the pings measure the way and not each other's company.
        let state_interval = Duration::from_millis(100);
        let options = Options {
            state_interval,
            // Every ping is one of these, and every answer is one of theirs.
            pings: false,
            transport,
            device: device_resource(self.device.as_deref()),
            ..Options::new("hapticd ping", Role::Observer)
        };
        Ok(Client::connect(&self.target, options).await?)
    }

    async fn alone(&self, transport: Transport) -> anyhow::Result<Measured> {
        let mut client = self.connect(transport).await?;
        let mut served = Tally::new();
        let mut pace = tokio::time::interval(self.pace());
        let mut over = Instant::now() + self.seconds;
        // When the last ping has been sent there is still its answer to wait for.
        let mut sending = true;
        while sending || served.answered < served.sent {
            tokio::select! {
                biased;
                incoming = client.next() => {
                    if let Incoming::RoundTrip(time) = incoming? {
                        served.answered += 1;
                        served.record(time);
                    }
                }
                _ = pace.tick(), if sending && Instant::now() < over => {
                    client.send_ping()?;
                    served.sent += 1;
                }
                () = tokio::time::sleep_until(over.into()) => {
                    if !sending {
                        break;
                    }
                    sending = false;
                    over += patience(&served.times);
                }
            }
        }
        client.close().await;
        ensure!(served.answered > 0, "no ping was answered in {:?}", self.seconds);
        Ok(Measured { served, beside: None })
    }

    /// Blocks of pings to the server and to the bare echo, in turns, so that whatever else the
    /// machine does meets both; the ratio is the median of those of the rounds.
    async fn beside(&self, transport: Transport, mut echo: impl Way) -> anyhow::Result<Measured> {
        let mut server = Served(self.connect(transport).await?);
        let pace = self.pace();
        let over = Instant::now() + self.seconds;
        let (mut served, mut bare) = (Tally::new(), Tally::new());
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
        Ok(Measured { served, beside: Some(Beside { ratios, bare }) })
    }
}

/// Pings of one way, and the round trips of those that are no warming up.
struct Tally {
    sent: u64,
    answered: u64,
    times: Histogram<u64>,
}

impl Tally {
    fn new() -> Self {
        Self { sent: 0, answered: 0, times: durations_ns() }
    }

    fn record(&mut self, time: Duration) {
        self.times.saturating_record(time.as_nanos() as u64);
    }

    /// Share of pings that were not answered.
    fn loss(&self) -> f64 {
        1.0 - self.answered as f64 / self.sent as f64
    }
}

/// The round trips over one transport.
struct Measured {
    served: Tally,
    beside: Option<Beside>,
}

/// What they were compared with.
struct Beside {
    /// Of the rounds, the smallest first; at least one.
    ratios: Vec<f64>,
    bare: Tally,
}

impl Beside {
    fn ratio(&self) -> f64 {
        self.ratios[self.ratios.len() / 2]
    }
}

impl Measured {
    fn json(&self) -> Value {
        let Self { served: Tally { sent, answered, times }, beside } = self;
        let mut figures = json!({
            "sent": sent,
            "answered": answered,
            "rtt_min_us": times.min() as f64 * 1e-3,
            "rtt_p50_us": us(times, 0.5),
            "rtt_p99_us": us(times, 0.99),
            "rtt_max_us": times.max() as f64 * 1e-3,
            "verdict": verdict(us(times, 0.5), us(times, 0.99), self.served.loss()).0,
        });
        if let Some(Beside { ratios, bare }) = beside {
            figures["rounds"] = json!(ratios.len());
            figures["baseline_p50_us"] = json!(us(&bare.times, 0.5));
            figures["baseline_p99_us"] = json!(us(&bare.times, 0.99));
        }
        figures
    }

    fn tell(&self, transport: Transport) {
        let Tally { sent, answered, times } = &self.served;
        let (p50_us, p99_us) = (us(times, 0.5), us(times, 0.99));
        let loss = self.served.loss();
        say!("{transport}");
        say!("  {answered} of {sent} pings answered ({:.1} % lost)", 100.0 * loss);
        match &self.beside {
            None => {
                let worst_us = us(times, 1.0);
                say!(
                    "  round trip: p50 {p50_us:.0} us, p99 {p99_us:.0} us, worst {worst_us:.0} us"
                );
            }
            Some(beside) => {
                let bare = &beside.bare.times;
                say!("  hapticd    p50 {p50_us:>5.0} us, p99 {p99_us:>5.0} us");
                say!("  bare echo  p50 {:>5.0} us, p99 {:>5.0} us", us(bare, 0.5), us(bare, 0.99));
                say!(
                    "  ratio of the medians {:.2} (median of {} rounds, {:.2} to {:.2})",
                    beside.ratio(),
                    beside.ratios.len(),
                    beside.ratios[0],
                    beside.ratios[beside.ratios.len() - 1]
                );
            }
        }
        let (word, meaning) = verdict(p50_us, p99_us, loss);
        say!("  {word}: {meaning}");
    }
}

fn us(times: &Histogram<u64>, quantile: f64) -> f64 {
    times.value_at_quantile(quantile) as f64 * 1e-3
}

/// Median of one block, which also goes to the figures of the whole run.
async fn p50_us(way: &mut impl Way, pace: Duration, all: &mut Tally) -> anyhow::Result<f64> {
    let mut here = durations_ns();
    let record = |time: Duration| {
        here.saturating_record(time.as_nanos() as u64);
        all.record(time);
    };
    let answered = block(way, BLOCK, pace, record).await?;
    all.sent += BLOCK as u64;
    all.answered += answered as u64;
    Ok(here.value_at_quantile(0.5) as f64 * 1e-3)
}

/// How long the last answers are waited for: the longest round trip so far, and some more.
fn patience(round_trips_ns: &Histogram<u64>) -> Duration {
    (2 * Duration::from_nanos(round_trips_ns.max())).clamp(LEAST_PATIENCE, MOST_PATIENCE)
}

/// Go or no-go for a scene that answers every State, and what for; after the bounds by which a
/// session decides what may be commanded (docs/protocol.md), here of both ways together.
fn verdict(p50_us: f64, p99_us: f64, loss: f64) -> (&'static str, &'static str) {
    let late_us = p99_us - p50_us;
    if loss <= 0.01 && p99_us < 500.0 {
        ("GO", "a scene's command arrives before the next tick at 1 kHz")
    } else if loss <= 0.06 && late_us < 5_000.0 && p50_us < 50_000.0 {
        ("GO", "good for forces and for contacts, which are rendered at the device")
    } else if loss <= 0.30 && p50_us < 200_000.0 {
        ("GO for contacts", "walls stand, and arrive late; no direct forces")
    } else {
        ("NO-GO", "walls stand where they stood, and changes come too late for touch")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_word_gets_no_better_as_the_path_gets_worse() {
        let paths = [
            (100.0, 300.0, 0.0),
            (100.0, 3_000.0, 0.0),
            (30_000.0, 34_000.0, 0.03),
            (30_000.0, 50_000.0, 0.03),
            (30_000.0, 31_000.0, 0.2),
            (300_000.0, 300_100.0, 0.0),
            (1_000.0, 1_000.0, 0.6),
        ];
        let words = paths.map(|(p50_us, p99_us, loss)| verdict(p50_us, p99_us, loss).0);
        let contacts = "GO for contacts";
        assert_eq!(words, ["GO", "GO", "GO", contacts, contacts, "NO-GO", "NO-GO"]);
    }
}
