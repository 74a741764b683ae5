//! The telemetry thread: from the loop's ring of Records to metrics, summary and newest report.
//!
//! The loop never waits for it: it drains what is there every [`PERIOD`] and where it falls
//! behind by a whole ring, Records are lost on the loop's side, not ticks. One pass takes at
//! most what the ring holds, so a flood cannot keep it from stopping.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::{DeviceMetrics, EventHistory, RunSummary};
use crate::control::{Record, Report};
use crate::recording::Recorder;

/// Between two looks at the ring: a few ticks, so that a live view is not late.
const PERIOD: Duration = Duration::from_millis(4);

/// The newest report of a device and its newest events, for whoever asks.
#[derive(Clone, Debug, Default)]
pub struct LatestReport {
    report: Arc<Mutex<Report>>,
    events: EventHistory,
}

impl LatestReport {
    /// The newest report; tick 0 before the first.
    pub fn get(&self) -> Report {
        *self.report.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What happened lately.
    pub fn events(&self) -> &EventHistory {
        &self.events
    }

    fn set(&self, report: Report) {
        *self.report.lock().unwrap_or_else(PoisonError::into_inner) = report;
    }
}

/// Starts the thread. It ends soon after `stop` is true, or after the loop has let go of its
/// end of the ring, with everything drained, and returns the summary it was given.
pub fn spawn(
    mut records: rtrb::Consumer<Record>,
    mut metrics: DeviceMetrics,
    latest: LatestReport,
    summary: Option<Arc<Mutex<RunSummary>>>,
    mut recorder: Option<Recorder>,
    stop: Arc<AtomicBool>,
) -> io::Result<JoinHandle<()>> {
    thread::Builder::new().name("telemetry".into()).spawn(move || {
        loop {
            // Asked before draining, so that nothing written before is left behind.
            let last = stop.load(Ordering::Acquire) || records.is_abandoned();
            drain(&mut records, &mut metrics, &latest, summary.as_deref(), recorder.as_mut());
            if last {
                recorder.iter_mut().for_each(Recorder::finish);
                return;
            }
            thread::sleep(PERIOD);
        }
    })
}

fn drain(
    records: &mut rtrb::Consumer<Record>,
    metrics: &mut DeviceMetrics,
    latest: &LatestReport,
    summary: Option<&Mutex<RunSummary>>,
    mut recorder: Option<&mut Recorder>,
) {
    let mut newest = None;
    for _ in 0..records.slots() {
        let Ok(record) = records.pop() else { break };
        metrics.observe(&record);
        if let Some(summary) = summary {
            summary.lock().unwrap_or_else(PoisonError::into_inner).observe(&record);
        }
        latest.events.take_in(&record.report);
        if let Some(recorder) = &mut recorder {
            recorder.observe(&record);
        }
        newest = Some(record.report);
    }
    if let Some(recorder) = recorder {
        recorder.flush();
    }
    if let Some(report) = newest {
        latest.set(report);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::telemetry::{RoundTrips, Telemetry};

    fn record(tick: u64) -> Record {
        Record { report: Report { tick, ..Report::default() }, ..Record::default() }
    }

    #[test]
    fn everything_written_before_the_stop_arrives() {
        let telemetry = Telemetry::new().unwrap();
        let (mut producer, consumer) = rtrb::RingBuffer::new(64);
        let (latest, stop) = (LatestReport::default(), Arc::new(AtomicBool::new(false)));
        let summary = Arc::new(Mutex::new(RunSummary::new(1_000_000)));
        let metrics = telemetry.device("d");
        let observed = Some(Arc::clone(&summary));
        let thread =
            spawn(consumer, metrics, latest.clone(), observed, None, Arc::clone(&stop)).unwrap();
        for tick in 1..=1_000 {
            while producer.push(record(tick)).is_err() {
                thread::yield_now();
            }
        }
        stop.store(true, Ordering::Release);
        thread.join().unwrap();
        assert_eq!(summary.lock().unwrap().figures(&RoundTrips::default()).ticks, 1_000);
        assert_eq!(latest.get().tick, 1_000);
        let text = telemetry.scrape().render();
        assert!(text.contains("hapticd_loop_ticks_total{device=\"d\"} 1000\n"));
    }

    #[test]
    fn it_ends_when_the_loop_is_gone() {
        let telemetry = Telemetry::new().unwrap();
        let (mut producer, consumer) = rtrb::RingBuffer::new(4);
        producer.push(record(5)).unwrap();
        drop(producer);
        let latest = LatestReport::default();
        let stop = Arc::new(AtomicBool::new(false));
        let thread =
            spawn(consumer, telemetry.device("d"), latest.clone(), None, None, stop).unwrap();
        thread.join().unwrap();
        assert_eq!(latest.get().tick, 5);
    }
}
