//! The thread that writes one recording, and what is known of it.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use super::{Info, utc_minus_device_ns};
use crate::recording::{Delivery, Sink, header};

/// Deliveries that may wait for the disk: each has some milliseconds of ticks, so that a
/// stall of about a second costs nothing.
const WAITING: usize = 256;

/// A recording of this server.
#[derive(Debug)]
pub(super) struct Writer {
    device: String,
    seconds: f64,
    sink_id: u64,
    room: u64,
    progress: Arc<Progress>,
    /// Keeps the count of what the recorder could not hand over.
    lost: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug, Default)]
struct Progress {
    ticks: AtomicU64,
    bytes: AtomicU64,
    complete: AtomicBool,
    error: Mutex<Option<String>>,
}

impl Writer {
    /// Makes the file and a thread that writes what the sink is given, at most `room` bytes.
    pub fn start(
        path: &Path,
        device: &str,
        seconds: f64,
        sink_id: u64,
        room: u64,
        under_way: Arc<AtomicUsize>,
    ) -> io::Result<(Self, Sink)> {
        let mut file = BufWriter::new(File::create_new(path)?);
        file.write_all(&header(device, utc_minus_device_ns(), "asked for"))?;
        let (to, deliveries) = sync_channel(WAITING);
        let (progress, lost) = (Arc::new(Progress::default()), Arc::new(AtomicU64::new(0)));
        let told = Arc::clone(&progress);
        under_way.fetch_add(1, Ordering::Relaxed);
        let counted = Arc::clone(&under_way);
        let thread = std::thread::Builder::new().name("recording".into()).spawn(move || {
            if let Err(error) = write(file, &deliveries, room, &told) {
                *told.error.lock().unwrap_or_else(PoisonError::into_inner) =
                    Some(error.to_string());
            }
            counted.fetch_sub(1, Ordering::Relaxed);
            told.complete.store(true, Ordering::Release);
        });
        let thread = thread.inspect_err(|_| {
            under_way.fetch_sub(1, Ordering::Relaxed);
        })?;
        let length_ns = (seconds * 1e9) as u64;
        let sink = Sink { id: sink_id, length_ns, to, lost: Arc::clone(&lost) };
        let device = device.to_owned();
        Ok((Self { device, seconds, sink_id, room, progress, lost, thread: Some(thread) }, sink))
    }

    pub fn sink_id(&self) -> u64 {
        self.sink_id
    }

    pub fn info(&self, id: &str) -> Info {
        let complete = self.progress.complete.load(Ordering::Acquire);
        Info {
            id: id.to_owned(),
            device: self.device.clone(),
            complete,
            seconds: Some(self.seconds),
            ticks: self.progress.ticks.load(Ordering::Relaxed),
            lost_ticks: self.lost.load(Ordering::Relaxed),
            bytes: self.progress.bytes.load(Ordering::Relaxed),
            error: self.progress.error.lock().unwrap_or_else(PoisonError::into_inner).clone(),
        }
    }

    /// What it has, or may yet get.
    pub fn room(&self) -> u64 {
        let complete = self.progress.complete.load(Ordering::Acquire);
        if complete { self.progress.bytes.load(Ordering::Relaxed) } else { self.room }
    }
}

/// Whoever lets go of one waits until it is on disk: the recorder has ended, or was told to.
impl Drop for Writer {
    fn drop(&mut self) {
        if let Some(thread) = self.thread.take() {
            // Its panic, if any, has been printed.
            let _ = thread.join();
        }
    }
}

fn write(
    mut file: BufWriter<File>,
    deliveries: &Receiver<Delivery>,
    room: u64,
    progress: &Progress,
) -> io::Result<()> {
    let mut bytes = 0;
    for delivery in deliveries {
        bytes += delivery.bytes.len() as u64;
        if bytes > room {
            return Err(io::Error::other(format!("ended early: its room of {room} bytes is full")));
        }
        file.write_all(&delivery.bytes)?;
        progress.bytes.store(bytes, Ordering::Relaxed);
        progress.ticks.fetch_add(delivery.ticks, Ordering::Relaxed);
    }
    file.into_inner()?.sync_all()
}
