//! A stream of State over bad paths: promise 5.
//!
//! A server in a process of its own, `netsim` before it, and a client that answers every State
//! with a wall. Every State has a number and the device's time, and all run on one machine with
//! one clock: what of the numbers came, and how late. The paths are those of the table that made
//! us leave QUIC's usual congestion control (see docs/network.md), and the same without a loss.
//! The row `delivered` counts States that came of all that there were, so that what the server
//! itself drops is lost, too; the delay is one way and includes the tick itself.

mod measure;
mod server;

use std::time::{Duration, Instant};

use anyhow::ensure;
use hapticd::app::netsim::{Netsim, NetsimConfig};
use hapticd::client::{Client, ConnectString, Incoming, Options};
use hapticd::clock::now_ns;
use hapticd::impairment::Impairment;
use hapticd::proto::{Contact, HalfSpaceContact, Role, contact::Shape};
use measure::{Series, quick};
use server::Server;

/// Round trip in milliseconds, per cent lost, how many in a row.
const PATHS: [(u64, f64, f64); 8] = [
    (0, 0.0, 1.0),
    (4, 3.0, 1.0),
    (20, 1.0, 1.0),
    (20, 3.0, 1.0),
    (60, 0.0, 1.0),
    (60, 1.0, 1.0),
    (60, 3.0, 1.0),
    (60, 3.0, 5.0),
];

/// Handshake and first pings are not the load.
const WARM_UP: Duration = Duration::from_secs(1);

/// Beyond the path's own delay, by promise 5.
const BOUND_MS: f64 = 5.0;

fn main() -> anyhow::Result<()> {
    if let Some(config) = server::asked() {
        return server::serve(&config);
    }
    let time = Duration::from_secs(if quick() { 2 } else { 8 });
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    println!(
        "round trip, loss, in a row    delivered/%  of not lost/%   p50/ms   p99/ms  p99 - path/ms"
    );
    let mut all_kept = true;
    for (rtt_ms, loss_percent, burst) in PATHS {
        let server = Server::start("")?;
        let impairment = Impairment {
            delay_ns: rtt_ms * 500_000,
            loss: loss_percent / 100.0,
            burst,
            ..Impairment::NONE
        };
        let found = runtime.block_on(block(server.target(), impairment, time))?;
        let delivered = 100.0 * found.came as f64 / found.due as f64;
        let path_ms = rtt_ms as f64 / 2.0;
        let p99_ms = found.delay.us(0.99) * 1e-3;
        let kept = delivered >= 96.0 && p99_ms - path_ms <= BOUND_MS;
        println!(
            "{rtt_ms:>6} ms {loss_percent:>6} % {burst:>6}          {delivered:>8.1} {:>14.1} {:>8.1} {p99_ms:>8.1} {:>14.1}{}",
            delivered / (1.0 - impairment.loss),
            found.delay.us(0.5) * 1e-3,
            p99_ms - path_ms,
            if kept { "" } else { "  not kept" },
        );
        all_kept &= kept;
    }
    ensure!(all_kept, "less than 96 % delivered, or more than {BOUND_MS} ms beside the path");
    Ok(())
}

struct Found {
    due: u64,
    came: u64,
    delay: Series,
}

async fn block(server: &ConnectString, bad: Impairment, time: Duration) -> anyhow::Result<Found> {
    let target = (server.host.parse::<std::net::IpAddr>()?, server.stream_port).into();
    let listen = ([127, 0, 0, 1], 0).into();
    let proxy = Netsim::start(NetsimConfig { listen, target, impairment: bad, seed: 1 })?;
    let through = ConnectString {
        host: proxy.address.ip().to_string(),
        stream_port: proxy.address.port(),
        ..server.clone()
    };
    let options = Options { every_state: true, ..Options::new("network bench", Role::Controller) };
    let mut client = Client::connect(&through, options).await?;
    let wall = client.welcome().example_wall.as_deref().cloned().unwrap_or_else(wall);
    let begin = Instant::now() + WARM_UP;
    let end = begin + time;
    let (mut first, mut last, mut came) = (0, 0, 0);
    let mut delay = Series::new("delay");
    while Instant::now() < end {
        let Incoming::State(state) = client.next().await? else { continue };
        // It may have been overtaken; an old number is refused by the server itself.
        let _ = client.send_contacts(state.seq, 100, vec![wall.clone()]);
        if Instant::now() < begin {
            continue;
        }
        first = if first == 0 { state.seq } else { first };
        last = last.max(state.seq);
        came += 1;
        delay.record(Duration::from_nanos(now_ns().saturating_sub(state.device_time_ns)));
    }
    client.close().await;
    Ok(Found { due: last - first + 1, came, delay })
}

fn wall() -> Contact {
    let half_space =
        HalfSpaceContact { point_m: vec![0.3, 0.0, 0.0], normal: vec![-1.0, 0.0, 0.0] };
    let shape = Some(Shape::HalfSpace(half_space));
    Contact { id: 1, revision: 1, stiffness_n_per_m: 1e7, shape, ..Contact::default() }
}
