//! The wall scene behind bad paths: does its wall stand, how deep does the hand get, and what
//! energy does the wall give back?
//!
//! Each cell is `hapticd demo wall` as a user runs it, daemon and scene in two processes, with
//! `netsim` between them; the figures are those that it prints. The hand presses 10 N into the
//! wall and slides; the row without delay and loss is what the others are compared with. A wall
//! is rendered where the device is, so that nothing of the path should be seen in it but the
//! time in which it is not there.

mod measure;

use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use measure::quick;
use serde_json::Value;

const DELAYS_MS: [u32; 4] = [0, 50, 100, 200];

/// Per cent lost, how many in a row.
const LOSSES: [(u32, u32); 6] = [(0, 1), (10, 1), (30, 1), (30, 10), (50, 1), (50, 10)];

fn main() -> anyhow::Result<()> {
    println!(
        "one-way delay, loss, in a row   wall stood/%   deepest/mm   taken/J   given back at most/J"
    );
    for delay_ms in DELAYS_MS {
        for (loss_percent, burst) in LOSSES {
            if quick() && delay_ms >= 100 && loss_percent >= 30 {
                continue; // two seconds are no more than the beginning
            }
            let seconds = seconds(delay_ms, loss_percent, burst);
            let figures = demo(seconds, delay_ms, loss_percent, burst)?;
            let figure = |name: &str| figures[name].as_f64().context("the wall never stood");
            let stood = figure("commanded_ratio")?;
            println!(
                "{delay_ms:>6} ms {loss_percent:>6} % {burst:>6} {:>17.2} {:>12.3} {:>9.2} {:>22.3}",
                100.0 * stood,
                figure("penetration_max_mm")?,
                figure("energy_taken_j")?,
                figure("energy_given_max_j")?,
            );
            ensure!(stood > 0.95, "the wall did not stand");
        }
    }
    Ok(())
}

/// Where half is lost by chance, or a third on a long way, the beginning alone takes seconds.
fn seconds(delay_ms: u32, loss_percent: u32, burst: u32) -> u32 {
    match (delay_ms, loss_percent, burst) {
        _ if quick() => 2,
        (100.., 50, 1) | (200, 30, 1) => 30,
        _ => 8,
    }
}

fn demo(seconds: u32, delay_ms: u32, loss_percent: u32, burst: u32) -> anyhow::Result<Value> {
    let said = Command::new(env!("CARGO_BIN_EXE_hapticd"))
        .args(["demo", "wall", "--json", "--seconds", &seconds.to_string()])
        .args(["--delay-ms", &delay_ms.to_string()])
        .args(["--loss-percent", &loss_percent.to_string(), "--burst", &burst.to_string()])
        .stderr(Stdio::inherit())
        .output()?;
    ensure!(said.status.success(), "the demo ended with {}", said.status);
    Ok(serde_json::from_slice(&said.stdout)?)
}
