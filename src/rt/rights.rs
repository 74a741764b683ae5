//! The rights a real-time thread asks of the system, and what it was granted.

use std::fs::{File, OpenOptions};
use std::io::Write;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, CpuSet, capabilities, sched_getaffinity, sched_setaffinity};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// Memory that must be lockable before `mlockall` is tried: with a smaller limit later
/// mappings and thread starts fail, which is worse than a page fault.
const LEAST_LOCKABLE_BYTES: u64 = 512 << 20;

/// Stack that is touched before the first tick.
const STACK_BYTES: usize = 128 << 10;

/// One thing a real-time thread needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Right {
    /// SCHED_FIFO.
    Scheduler,
    /// A processor of its own choice.
    Affinity,
    /// Memory that is never paged out.
    Memory,
    /// No deep sleep of the processors.
    CpuLatency,
}

impl Right {
    /// Every right, for tables and metrics.
    pub const ALL: [Self; 4] = [Self::Scheduler, Self::Affinity, Self::Memory, Self::CpuLatency];

    /// The name used in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scheduler => "scheduler",
            Self::Affinity => "affinity",
            Self::Memory => "memory",
            Self::CpuLatency => "cpu_latency",
        }
    }
}

/// Rights without which `enforce` does not start.
#[derive(Debug, thiserror::Error)]
#[error("real-time rights denied: {}", .0.iter().map(|(right, why)| format!("{} ({why})", right.name())).collect::<Vec<_>>().join("; "))]
pub struct RightsError(pub Vec<(Right, String)>);

/// What the calling thread was granted. Holds the latency request while it lives.
#[derive(Debug)]
pub struct Rights {
    denied: Vec<(Right, String)>,
    _cpu_latency: Option<File>,
}

/// On which processor a loop runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Processor {
    /// This one.
    Number(usize),
    /// Counted back from the last allowed one, and round again: loops side by side get one
    /// each, as far as there are enough.
    FromLast(usize),
}

impl Rights {
    /// Asks for everything, for the calling thread.
    pub fn claim(priority: u8, cpu: Processor) -> Self {
        let mut denied = Vec::new();
        let mut note = |right: Right, result: Result<(), String>| {
            if let Err(why) = result {
                denied.push((right, why));
            }
        };
        note(Right::Scheduler, fifo(priority));
        note(Right::Affinity, pin(cpu));
        note(Right::Memory, lock_memory());
        let latency = hold_cpu_latency();
        note(Right::CpuLatency, latency.as_ref().map(drop).map_err(Clone::clone));
        prefault_stack();
        Self { denied, _cpu_latency: latency.ok() }
    }

    /// What was denied, and why.
    pub fn denied(&self) -> &[(Right, String)] {
        &self.denied
    }
}

/// Raises the calling thread to SCHED_FIFO; the reason where that is not allowed.
pub fn fifo(priority: u8) -> Result<(), String> {
    let level = thread_priority::ThreadPriorityValue::try_from(priority)
        .map_err(|_| format!("priority {priority} is not in 0 to 99"))?;
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(level), policy)
        .map_err(|error| {
            format!("SCHED_FIFO {priority}: {error:?}; allow it with LimitRTPRIO or CAP_SYS_NICE")
        })
}

fn pin(cpu: Processor) -> Result<(), String> {
    let cpu = match cpu {
        Processor::Number(cpu) => cpu,
        Processor::FromLast(place) => {
            let allowed = sched_getaffinity(None).map_err(|error| error.to_string())?;
            let mut allowed: Vec<_> =
                (0..CpuSet::MAX_CPU).filter(|&cpu| allowed.is_set(cpu)).collect();
            allowed.reverse();
            *allowed.get(place % allowed.len().max(1)).ok_or("no processor allowed")?
        }
    };
    if cpu >= CpuSet::MAX_CPU {
        return Err(format!("processor {cpu} is not in 0 to {}", CpuSet::MAX_CPU - 1));
    }
    let mut only = CpuSet::new();
    only.set(cpu);
    sched_setaffinity(None, &only).map_err(|error| format!("processor {cpu}: {error}"))
}

fn lock_memory() -> Result<(), String> {
    let unlimited =
        capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK));
    let limit = getrlimit(Resource::Memlock).current;
    if let (false, Some(bytes)) = (unlimited, limit.filter(|&bytes| bytes < LEAST_LOCKABLE_BYTES)) {
        return Err(format!(
            "RLIMIT_MEMLOCK is {} KiB, at least {} KiB needed; allow it with LimitMEMLOCK or CAP_IPC_LOCK",
            bytes >> 10,
            LEAST_LOCKABLE_BYTES >> 10
        ));
    }
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT)
        .map_err(|error| format!("mlockall: {error}"))
}

fn hold_cpu_latency() -> Result<File, String> {
    let path = "/dev/cpu_dma_latency";
    let mut file =
        OpenOptions::new().write(true).open(path).map_err(|error| format!("{path}: {error}"))?;
    file.write_all(&0i32.to_ne_bytes()).map_err(|error| format!("{path}: {error}"))?;
    Ok(file)
}

#[inline(never)]
fn prefault_stack() {
    let mut stack = [0u8; STACK_BYTES];
    for page in stack.chunks_mut(4096) {
        page[0] = std::hint::black_box(1);
    }
    std::hint::black_box(&stack);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_impossible_processor_is_denied_by_name() {
        let why =
            std::thread::spawn(|| pin(Processor::Number(1 << 20))).join().unwrap().unwrap_err();
        assert!(why.contains("1048576"), "{why}");
    }

    #[test]
    fn denied_rights_are_listed_with_their_reasons() {
        let error =
            RightsError(vec![(Right::Scheduler, "no".into()), (Right::Memory, "limit".into())]);
        assert_eq!(error.to_string(), "real-time rights denied: scheduler (no); memory (limit)");
    }
}
