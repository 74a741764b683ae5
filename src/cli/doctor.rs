//! `hapticd doctor`: is this machine fit to serve a device, and what would help?
//!
//! Looks and measures, changes nothing: the state directory is read, ports are tried and let
//! go. Every finding has a verdict and, where it is not `ok`, what to do about it.

mod files;
mod system;

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use serde::Serialize;

use super::format::parse_seconds;
use super::serve::Settings;
use crate::config::ServerConfig;
use crate::rt::{Processor, RtConfig, Wakeups, measure_wakeups};
use crate::telemetry::durations_ns;

/// The loop's usual rate.
const PERIOD_NS: u64 = 1_000_000;

/// A fifth of a tick: later than this, once in a thousand ticks, is felt in hard contact as a
/// law that decides on old data.
const GOOD_US: f64 = 200.0;

/// A whole tick.
const BEARABLE_US: f64 = 1000.0;

/// Share of the processors' time that a hypervisor took.
const BEARABLE_STEAL: f64 = 0.01;

/// Check whether this machine is fit to serve a device, and say what would help.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd doctor
  hapticd doctor --config /etc/hapticd.toml --seconds 30
  hapticd doctor --json | jq .verdict

The exit code is 1 when anything is found that keeps a server from starting.")]
pub struct Doctor {
    /// Configuration file of the server to check for
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Where that server keeps its state
    #[arg(long, value_name = "DIR")]
    state_dir: Option<PathBuf>,
    /// How long to measure the wake-ups of a real-time thread
    #[arg(long, value_name = "N", default_value = "5", value_parser = parse_seconds, allow_negative_numbers = true)]
    seconds: Duration,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// How something was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Verdict {
    /// As it should be.
    Ok,
    /// It works, but not as well as it could.
    Warn,
    /// A server would not start, or not keep what it promises.
    Fail,
}

/// One thing that was looked at.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Finding {
    check: &'static str,
    verdict: Verdict,
    found: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    advice: Option<String>,
}

impl Finding {
    fn ok(check: &'static str, found: impl Into<String>) -> Self {
        Self { check, verdict: Verdict::Ok, found: found.into(), advice: None }
    }

    fn warn(check: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { verdict: Verdict::Warn, advice: Some(advice.into()), ..Self::ok(check, found) }
    }

    fn fail(check: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { verdict: Verdict::Fail, ..Self::warn(check, found, advice) }
    }
}

/// What the measurement came to.
#[derive(Clone, Debug, Serialize)]
struct Measured {
    seconds: f64,
    wakeup_p50_us: f64,
    wakeup_p99_us: f64,
    wakeup_p999_us: f64,
    wakeup_max_us: f64,
    skipped: u64,
    /// Share of all processors' time; absent where the system does not say.
    steal_ratio: Option<f64>,
}

#[derive(Debug, Serialize)]
struct Examination {
    verdict: Verdict,
    measured: Measured,
    findings: Vec<Finding>,
}

impl Doctor {
    /// Looks, measures, prints.
    pub fn run(self) -> anyhow::Result<()> {
        let settings = Settings {
            config: self.config.clone(),
            state_dir: self.state_dir.clone(),
            ..Settings::default()
        };
        let mut findings = system::findings();
        let config = match settings.server_config() {
            Ok(config) => {
                findings.extend(files::findings(&config));
                config
            }
            Err(error) => {
                let told = super::told_once(&error);
                findings.push(Finding::fail("configuration", told, "correct the file"));
                ServerConfig::default()
            }
        };
        if !self.json {
            eprintln!("measuring for {} s ...", self.seconds.as_secs_f64());
        }
        let (measured, wakeups) = self.measure(&config)?;
        findings.push(rights(&wakeups));
        findings.extend(judge(&measured));
        let verdict = findings.iter().map(|finding| finding.verdict).max().unwrap_or(Verdict::Ok);
        let examination = Examination { verdict, measured, findings };
        if self.json {
            say!("{}", serde_json::to_string(&examination)?);
        } else {
            examination.print();
        }
        anyhow::ensure!(verdict != Verdict::Fail, "this machine is not ready to serve a device");
        Ok(())
    }

    fn measure(&self, config: &ServerConfig) -> anyhow::Result<(Measured, Wakeups)> {
        let count = (self.seconds.as_nanos() as u64 / PERIOD_NS).max(100) as usize;
        let first = config.devices.first().and_then(|device| device.rt_cpu);
        let cpu = first.map_or(Processor::FromLast(0), Processor::Number);
        let rt = RtConfig { priority: config.rt_priority, cpu, ..Default::default() };
        let before = system::processor_times();
        let wakeups = measure_wakeups(rt, PERIOD_NS, count)?;
        let steal_ratio = before.zip(system::processor_times()).map(|(a, b)| b.steal_since(&a));
        let mut lateness_ns = durations_ns();
        wakeups.lateness_ns.iter().for_each(|&ns| lateness_ns.saturating_record(ns));
        let at_us = |quantile| lateness_ns.value_at_quantile(quantile) as f64 * 1e-3;
        let measured = Measured {
            seconds: count as f64 * PERIOD_NS as f64 * 1e-9,
            wakeup_p50_us: at_us(0.5),
            wakeup_p99_us: at_us(0.99),
            wakeup_p999_us: at_us(0.999),
            wakeup_max_us: lateness_ns.max() as f64 * 1e-3,
            skipped: wakeups.skipped,
            steal_ratio,
        };
        Ok((measured, wakeups))
    }
}

/// The rights that the loop asks for.
fn rights(wakeups: &Wakeups) -> Finding {
    let denied = wakeups.denied.iter().map(|(right, why)| format!("{} ({why})", right.name()));
    let denied: Vec<_> = denied.collect();
    if denied.is_empty() {
        return Finding::ok("real-time rights", "scheduler, processor, memory and latency granted");
    }
    let advice = "run as root or by deploy/hapticd.service, which grants them; the server \
                  starts without, unless realtime = \"enforce\"";
    Finding::warn("real-time rights", format!("denied: {}", denied.join("; ")), advice)
}

/// What the figures mean.
fn judge(measured: &Measured) -> Vec<Finding> {
    let Measured { wakeup_p99_us: p99, wakeup_p999_us: p999, wakeup_max_us: max, .. } = *measured;
    let found = format!(
        "p99 {p99:.0} us, p99.9 {p999:.0} us, latest {max:.0} us, {} of {:.0} ticks skipped",
        measured.skipped,
        measured.seconds / (PERIOD_NS as f64 * 1e-9)
    );
    let busy =
        "stop other programs, isolate a processor (isolcpus, rt_cpu), or use a PREEMPT_RT kernel";
    let lateness = if p999 <= GOOD_US {
        Finding::ok("wake-ups at 1 kHz", found)
    } else if p999 <= BEARABLE_US {
        Finding::warn("wake-ups at 1 kHz", found, busy)
    } else {
        let advice = format!("fit for trying things only: {busy}");
        Finding::warn("wake-ups at 1 kHz", found, advice)
    };
    let steal = measured.steal_ratio.map(|ratio| {
        let found =
            format!("{:.1} % of the processors' time taken by the hypervisor", ratio * 100.0);
        if ratio <= BEARABLE_STEAL {
            Finding::ok("hypervisor", found)
        } else {
            Finding::warn("hypervisor", found, "no setting in here helps; use a machine of its own")
        }
    });
    std::iter::once(lateness).chain(steal).collect()
}

impl Examination {
    fn print(&self) {
        for finding in &self.findings {
            let word = match finding.verdict {
                Verdict::Ok => "ok  ",
                Verdict::Warn => "warn",
                Verdict::Fail => "FAIL",
            };
            say!("{word}  {:<18} {}", finding.check, finding.found);
            if let Some(advice) = &finding.advice {
                say!("{:<25}-> {advice}", "");
            }
        }
        say!("");
        say!(
            "{}",
            match self.verdict {
                Verdict::Ok => "Ready.",
                Verdict::Warn => "Ready, with reservations.",
                Verdict::Fail => "Not ready.",
            }
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(p999_us: f64, steal: f64) -> Measured {
        Measured {
            seconds: 5.0,
            wakeup_p50_us: 5.0,
            wakeup_p99_us: 20.0,
            wakeup_p999_us: p999_us,
            wakeup_max_us: 2.0 * p999_us,
            skipped: 0,
            steal_ratio: Some(steal),
        }
    }

    #[test]
    fn a_good_machine_is_good_and_a_bad_one_is_told_what_to_do() {
        assert!(judge(&measured(50.0, 0.0)).iter().all(|found| found.verdict == Verdict::Ok));
        for (p999_us, steal) in [(500.0, 0.0), (5000.0, 0.0), (50.0, 0.1)] {
            let found = judge(&measured(p999_us, steal));
            let worst = found.iter().max_by_key(|found| found.verdict).unwrap();
            assert!(worst.verdict == Verdict::Warn && worst.advice.is_some(), "{worst:?}");
        }
    }

    #[test]
    fn denied_rights_are_warnings_by_name() {
        let wakeups = Wakeups {
            denied: vec![(crate::rt::Right::Scheduler, "not allowed".into())],
            lateness_ns: vec![],
            skipped: 0,
        };
        let found = rights(&wakeups);
        assert!(found.found.contains("denied: scheduler (not allowed)"), "{found:?}");
    }
}
