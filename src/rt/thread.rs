//! The thread that turns a [`Cycle`] on time.

use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread::JoinHandle;

use super::run::run;
use super::{Cycle, Processor, Right, Rights, RightsError};
use crate::device::Device;

/// What to do when a right is denied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Realtime {
    /// Start all the same and say so.
    #[default]
    BestEffort,
    /// Do not start.
    Enforce,
}

/// How the thread is set up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RtConfig {
    /// What a denied right means.
    pub realtime: Realtime,
    /// SCHED_FIFO priority; 80 leaves room for the kernel's own threads.
    pub priority: u8,
    /// Processor to run on.
    pub cpu: Processor,
}

impl Default for RtConfig {
    fn default() -> Self {
        Self { realtime: Realtime::BestEffort, priority: 80, cpu: Processor::FromLast(0) }
    }
}

/// Why the thread did not start.
#[derive(Debug, thiserror::Error)]
pub enum RtError {
    /// `realtime = "enforce"`, and something was denied.
    #[error(transparent)]
    Rights(#[from] RightsError),
    /// The system gave no thread.
    #[error("cannot start the real-time thread: {0}")]
    Thread(#[from] std::io::Error),
    /// It ended before it began.
    #[error("the real-time thread ended before its first tick")]
    Ended,
}

/// A running real-time thread. Dropping it stops the thread and releases the device.
#[derive(Debug)]
pub struct RtHandle {
    denied: Vec<(Right, String)>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl RtHandle {
    /// What the thread was denied, and why.
    pub fn denied(&self) -> &[(Right, String)] {
        &self.denied
    }

    /// Stops after the tick under way and releases the device.
    pub fn stop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic in the loop was reported by the panic hook; there is nothing to add.
            let _ = thread.join();
        }
    }
}

impl Drop for RtHandle {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Starts the thread. `doorbell` is an eventfd that is rung after every tick.
pub fn spawn<D: Device + 'static>(
    cycle: Cycle<D>,
    config: RtConfig,
    doorbell: OwnedFd,
) -> Result<RtHandle, RtError> {
    let stop = Arc::new(AtomicBool::new(false));
    let (granted, started) = mpsc::sync_channel(1);
    let stopped = Arc::clone(&stop);
    let thread = std::thread::Builder::new().name("hapticd-rt".into()).spawn(move || {
        let rights = Rights::claim(config.priority, config.cpu);
        let denied = rights.denied().to_vec();
        let refuse = config.realtime == Realtime::Enforce && !denied.is_empty();
        if granted.send(denied).is_ok() && !refuse {
            run(cycle, &stopped, &doorbell);
        }
    })?;
    let denied = started.recv().map_err(|_| RtError::Ended)?;
    let handle = RtHandle { denied, stop, thread: Some(thread) };
    if config.realtime == Realtime::Enforce && !handle.denied.is_empty() {
        return Err(RightsError(handle.denied.clone()).into());
    }
    Ok(handle)
}
