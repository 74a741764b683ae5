//! `hapticd netsim`: a bad network between a server and its clients.

use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use anyhow::Context;
use clap::Args;
use serde_json::{Value, json};
use tokio::net::TcpListener;

use super::format::parse_seconds;
use crate::app::Signals;
use crate::app::netsim::{Figures, Netsim as Proxy, NetsimConfig};
use crate::app::relay::relay;
use crate::client::{ConnectString, DEFAULT_UDP_PORT};
use crate::impairment::{Carried, Impairment};

/// Stand between a server and its clients as a bad network: whoever connects to the line that
/// is printed reaches the server's stream through it, whatever the transport
///
/// Each direction is as bad as is said: the round trip has twice the delay. Calls of the
/// services (gRPC) are passed on as well, and no worse for it.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd netsim --delay-ms 30 --loss-percent 3
  hapticd netsim --connect 127.0.0.1:7351 --loss-percent 20 --burst 8 --seconds 60 --json
  hapticd netsim --delay-ms 5 --jitter-ms 10 --corrupt-percent 0.1 --rate-kbit 2000

Then, in another terminal:  hapticd scene wall --connect 'LINE'")]
pub struct Netsim {
    /// Where the server is: the line that `serve` prints, or HOST:PORT on this machine
    #[arg(long, value_name = "STRING", default_value = "127.0.0.1:7351")]
    connect: ConnectString,
    /// Where clients of QUIC and WebTransport come, and beside it on free ports sealed UDP and
    /// calls; port 0: any that is free
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    listen: SocketAddr,
    #[command(flatten)]
    path: BadPath,
    /// End after this time; without it, at Ctrl-C
    #[arg(long, value_name = "N", value_parser = parse_seconds, allow_negative_numbers = true)]
    seconds: Option<Duration>,
    /// Print what became of the datagrams as one JSON object
    #[arg(long)]
    json: bool,
}

/// A network as bad as is said, the same each way.
#[derive(Clone, Copy, Debug, PartialEq, Args)]
pub struct BadPath {
    /// One-way delay
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = parse_ms, allow_negative_numbers = true)]
    delay_ms: f64,
    /// Up to this much more, drawn anew for each datagram: they overtake one another
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = parse_ms, allow_negative_numbers = true)]
    jitter_ms: f64,
    /// Share of datagrams that are lost
    #[arg(long, value_name = "%", default_value_t = 0.0, value_parser = parse_percent, allow_negative_numbers = true)]
    loss_percent: f64,
    /// How many are lost in a row, on average; 1 and less: each by chance
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = parse_burst, allow_negative_numbers = true)]
    burst: f64,
    /// Share of datagrams that come twice
    #[arg(long, value_name = "%", default_value_t = 0.0, value_parser = parse_percent, allow_negative_numbers = true)]
    duplicate_percent: f64,
    /// Share of datagrams that come with a bit turned over
    #[arg(long, value_name = "%", default_value_t = 0.0, value_parser = parse_percent, allow_negative_numbers = true)]
    corrupt_percent: f64,
    /// What the line carries; without it, whatever comes
    #[arg(long, value_name = "KBIT/S", value_parser = parse_rate, allow_negative_numbers = true)]
    rate_kbit: Option<f64>,
    /// What would wait longer than this for the line is lost
    #[arg(long, value_name = "MS", default_value_t = 100.0, value_parser = parse_ms, allow_negative_numbers = true)]
    queue_ms: f64,
    /// The same seed loses the same datagrams
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

impl Netsim {
    /// Runs until its time is over or Ctrl-C.
    pub fn run(self) -> anyhow::Result<()> {
        super::runtime()?.block_on(self.stand_between())
    }

    async fn stand_between(self) -> anyhow::Result<()> {
        let mut signals = Signals::register()?;
        let place = (self.connect.host.as_str(), self.connect.stream_port);
        let target = tokio::net::lookup_host(place)
            .await
            .with_context(|| format!("cannot find {}", self.connect.host))?
            .next()
            .with_context(|| format!("{} has no address", self.connect.host))?;
        let ip = target.ip();
        let (proxies, mut through) = self.path.stand_before(&self.connect, ip, self.listen)?;
        let calls = TcpListener::bind((self.listen.ip(), 0)).await?;
        through.grpc_port = calls.local_addr()?.port();
        // With --json stdout is for the object alone.
        if self.json {
            eprintln!("{through}")
        } else {
            say!("{through}")
        }
        tokio::select! {
            () = signals.received() => {}
            () = tokio::time::sleep(self.seconds.unwrap_or_default()), if self.seconds.is_some() => {}
            () = relay(calls, (ip, self.connect.grpc_port).into()) => {}
        }
        let [stream, sealed] = proxies.map(|proxy| proxy.figures());
        let Figures { mut up, mut down } = stream;
        up += sealed.up;
        down += sealed.down;
        if self.json {
            say!("{}", json!({ "up": figures(&up), "down": figures(&down) }));
        } else {
            say!("to the server    {}", told(&up));
            say!("to the clients   {}", told(&down));
        }
        Ok(())
    }
}

impl BadPath {
    /// Whether it does anything.
    pub fn is_bad(&self) -> bool {
        let Impairment {
            delay_ns, jitter_ns, loss, duplicates, corruption, rate_bit_per_s, ..
        } = self.impairment();
        delay_ns + jitter_ns > 0
            || loss + duplicates + corruption > 0.0
            || rate_bit_per_s.is_finite()
    }

    /// Proxies before a server's stream and its sealed UDP, and the line by which clients reach
    /// them.
    pub fn stand_before(
        &self,
        server: &ConnectString,
        ip: IpAddr,
        listen: SocketAddr,
    ) -> anyhow::Result<([Proxy; 2], ConnectString)> {
        let (impairment, seed) = (self.impairment(), self.seed);
        let stand = |listen: SocketAddr, port| {
            let target = (ip, port).into();
            Proxy::start(NetsimConfig { listen, target, impairment, seed })
                .with_context(|| format!("cannot listen on {listen}"))
        };
        let stream = stand(listen, server.stream_port)?;
        let sealed = stand((listen.ip(), 0).into(), server.udp_port.unwrap_or(DEFAULT_UDP_PORT))?;
        let through = ConnectString {
            host: stream.address.ip().to_string(),
            stream_port: stream.address.port(),
            udp_port: Some(sealed.address.port()),
            ..server.clone()
        };
        Ok(([stream, sealed], through))
    }

    fn impairment(&self) -> Impairment {
        let ns = |ms: f64| (ms * 1e6) as u64;
        Impairment {
            delay_ns: ns(self.delay_ms),
            jitter_ns: ns(self.jitter_ms),
            loss: self.loss_percent / 100.0,
            burst: self.burst,
            duplicates: self.duplicate_percent / 100.0,
            corruption: self.corrupt_percent / 100.0,
            rate_bit_per_s: self.rate_kbit.map_or(f64::INFINITY, |kbit| kbit * 1e3),
            queue_ns: ns(self.queue_ms),
        }
    }
}

fn figures(carried: &Carried) -> Value {
    let Carried { sent, lost, crowded_out, doubled, damaged } = carried;
    json!({ "datagrams": sent, "lost": lost, "crowded_out": crowded_out, "doubled": doubled, "damaged": damaged })
}

fn told(carried: &Carried) -> String {
    let Carried { sent, lost, crowded_out, doubled, damaged } = carried;
    format!(
        "{sent} datagrams, {lost} lost, {crowded_out} crowded out, {doubled} came twice, {damaged} damaged"
    )
}

fn parse(text: &str, least: f64, most: f64, unit: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value| (least..=most).contains(value));
    value.ok_or_else(|| format!("must be a number in {least} to {most} {unit}"))
}

fn parse_ms(text: &str) -> Result<f64, String> {
    parse(text, 0.0, 10_000.0, "ms")
}

fn parse_percent(text: &str) -> Result<f64, String> {
    parse(text, 0.0, 100.0, "%")
}

fn parse_burst(text: &str) -> Result<f64, String> {
    parse(text, 0.0, 1e6, "datagrams")
}

fn parse_rate(text: &str) -> Result<f64, String> {
    parse(text, 1.0, 1e7, "kbit/s")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_is_refused_with_its_range() {
        assert_eq!(parse_percent("3"), Ok(3.0));
        assert_eq!(parse_percent("101"), Err("must be a number in 0 to 100 %".into()));
        for wrong in ["-1", "nan", "inf", "", "3%"] {
            assert!(parse_ms(wrong).is_err() && parse_rate(wrong).is_err(), "{wrong}");
        }
    }
}
