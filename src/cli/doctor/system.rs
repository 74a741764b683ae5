//! What the system is: kernel, processors, their clocks, and time taken by a hypervisor.

use std::fs;

use super::Finding;

/// Kernel and processors.
pub fn findings() -> Vec<Finding> {
    let mut findings = vec![kernel()];
    findings.push(processors());
    findings.extend(governor());
    findings
}

/// The first line of a file of the system, trimmed.
fn line(path: &str) -> Option<String> {
    Some(fs::read_to_string(path).ok()?.lines().next()?.trim().to_owned())
}

fn kernel() -> Finding {
    let uname = rustix::system::uname();
    let release = uname.release().to_string_lossy().into_owned();
    let real_time = line("/sys/kernel/realtime").as_deref() == Some("1")
        || uname.version().to_string_lossy().contains("PREEMPT_RT");
    if real_time {
        Finding::ok("kernel", format!("{release}, PREEMPT_RT"))
    } else {
        let advice = "fine for simulated devices; for hardware install a PREEMPT_RT kernel";
        Finding::warn("kernel", format!("{release}, not PREEMPT_RT"), advice)
    }
}

fn processors() -> Finding {
    let count = std::thread::available_parallelism().map_or(1, usize::from);
    let isolated = line("/sys/devices/system/cpu/isolated").filter(|list| !list.is_empty());
    let found = match isolated {
        Some(list) => format!("{count} to use, {list} isolated"),
        None => format!("{count} to use, none isolated"),
    };
    if count > 1 {
        Finding::ok("processors", found)
    } else {
        let advice = "loop, stream and simulator share one processor; give it another";
        Finding::warn("processors", found, advice)
    }
}

/// A processor that clocks down between ticks wakes up slowly. Many virtual machines do not say.
fn governor() -> Option<Finding> {
    let governor = line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")?;
    Some(if governor == "performance" {
        Finding::ok("clock governor", governor)
    } else {
        let advice = "set it to performance: cpupower frequency-set -g performance";
        Finding::warn("clock governor", governor, advice)
    })
}

/// Time of all processors since the start, in the kernel's ticks.
#[derive(Clone, Copy, Debug)]
pub struct ProcessorTimes {
    total: u64,
    steal: u64,
}

/// Now; `None` where the system does not say.
pub fn processor_times() -> Option<ProcessorTimes> {
    parse(&line("/proc/stat")?)
}

/// `cpu user nice system idle iowait irq softirq steal guest guest_nice` (proc_stat(5)); guest
/// time is part of user time.
fn parse(line: &str) -> Option<ProcessorTimes> {
    let times = line.strip_prefix("cpu ")?.split_ascii_whitespace();
    let times: Vec<u64> = times.map_while(|time| time.parse().ok()).take(8).collect();
    Some(ProcessorTimes { total: times.iter().sum(), steal: *times.get(7)? })
}

impl ProcessorTimes {
    /// Share of the time since `before` that a hypervisor took.
    pub fn steal_since(&self, before: &Self) -> f64 {
        let total = self.total.saturating_sub(before.total).max(1);
        self.steal.saturating_sub(before.steal) as f64 / total as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steal_is_its_share_of_all_time() {
        let before = parse("cpu  100 0 50 800 10 0 5 35 7 0").unwrap();
        let after = parse("cpu  150 0 60 900 10 0 5 75 9 0").unwrap();
        assert!((after.steal_since(&before) - 0.2).abs() < 1e-12);
        assert!(parse("cpu0 1 2 3").is_none() && parse("cpu 1 2 3").is_none());
    }
}
