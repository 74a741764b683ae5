//! Round trip of a Ping through a whole daemon, beside bare echoes: promise 4.
//!
//! Three ways take turns in short blocks of one run, in changing order, so that whatever else
//! the machine does meets all of them: a tokio UDP echo, a quinn datagram echo with the
//! transport settings of hapticd, and `hapticd` itself with its loop running. Every way has
//! one `current_thread` runtime at each end, the same payload and the same pace.

mod measure;

use std::time::Duration;

use hapticd::app::echo::{QuicEcho, Served, UdpEcho, Way, block};
use hapticd::app::{Daemon, Start};
use hapticd::client::{Client, ConnectString, Options};
use hapticd::config::ServerConfig;
use hapticd::proto::Role;
use measure::{Series, print_table, rounds};
use tokio::runtime::Runtime;

/// Between two pings: 500 Hz.
const PACE: Duration = Duration::from_millis(2);

/// Pings of one block.
const BLOCK: usize = 200;

/// State for an observer that only pings.
const SELDOM: Duration = Duration::from_secs(1);

fn main() -> anyhow::Result<()> {
    let (daemon, _state) = daemon()?;
    let target = daemon.connect_string().clone();
    runtime()?.block_on(take_turns(&target))
}

fn daemon() -> anyhow::Result<(Daemon, tempfile::TempDir)> {
    let state = tempfile::tempdir()?;
    let config = ServerConfig {
        grpc_port: 0,
        stream_port: 0,
        http_port: 0,
        state_dir: Some(state.path().to_owned()),
        ..ServerConfig::default()
    };
    Ok((Daemon::start(&config, Start::default())?, state))
}

fn runtime() -> anyhow::Result<Runtime> {
    Ok(tokio::runtime::Builder::new_current_thread().enable_all().build()?)
}

async fn take_turns(target: &ConnectString) -> anyhow::Result<()> {
    let options =
        Options { state_interval: SELDOM, ..Options::new("round trip bench", Role::Observer) };
    let mut hapticd = Served(Client::connect(target, options).await?);
    let (mut udp, mut quic) = (UdpEcho::start().await?, QuicEcho::start().await?);
    let mut all =
        ["bare tokio UDP echo", "bare quinn echo", "hapticd, Ping over QUIC"].map(Series::new);
    let mut ratios = Vec::new();
    for round in 0..rounds(12) {
        let mut here = ["", "", ""].map(Series::new);
        for turn in 0..here.len() {
            let which = (round + turn) % here.len();
            let out = [&mut here[which], &mut all[which]];
            match which {
                0 => ping(&mut udp, out).await?,
                1 => ping(&mut quic, out).await?,
                _ => ping(&mut hapticd, out).await?,
            }
        }
        ratios.push(here[2].us(0.5) / here[1].us(0.5));
    }
    let [udp, quic, hapticd] = &all;
    print_table("round trip at 500 Hz", quic, [udp, quic, hapticd]);
    ratios.sort_by(f64::total_cmp);
    println!(
        "hapticd beside the bare quinn echo: p50 {:.2} (median of {} rounds; {:.2} to {:.2}), p99 {:.2}\n",
        ratios[ratios.len() / 2],
        ratios.len(),
        ratios[0],
        ratios[ratios.len() - 1],
        hapticd.us(0.99) / quic.us(0.99),
    );
    Ok(())
}

/// One block, into both the block's figures and those of the whole run.
async fn ping(way: &mut impl Way, mut out: [&mut Series; 2]) -> anyhow::Result<()> {
    let record = |time| out.iter_mut().for_each(|series| series.record(time));
    block(way, BLOCK, PACE, record).await?;
    Ok(())
}
