//! Logs: for people or as JSON, on stderr, never per packet.
//!
//! Nobody who logs waits for whoever reads: lines go through a bounded queue to a thread of
//! their own. While stderr takes nothing the newest are lost and counted, and as soon as it
//! takes something again the count is told. What is queued at a normal end is still written
//! if stderr takes it within [`FAREWELL`].

use std::fs::File;
use std::io::{self, IsTerminal, Write};
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, TrySendError, sync_channel};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use tracing_subscriber::EnvFilter;

use crate::config::{LogConfig, LogFormat};

/// Lines that may wait for stderr.
const LINES: usize = 1024;

/// Time for the last lines at the end.
const FAREWELL: Duration = Duration::from_millis(500);

/// Between two attempts to have the last lines written.
const PAUSE: Duration = Duration::from_millis(5);

static QUEUE: OnceLock<Queue> = OnceLock::new();

/// The started log. Dropped, it has written what was logged before.
#[derive(Debug)]
pub struct Logs(Queue);

impl Logs {
    /// Writes a line as it is, in its turn and without waiting, beside what is logged.
    pub fn line(&self, line: &str) {
        self.0.push(format!("{line}\n").into_bytes());
    }

    /// Waits a moment until everything said so far is written: before something else draws on
    /// the same terminal.
    pub fn flush(&self) {
        self.0.flush(FAREWELL);
    }
}

impl Drop for Logs {
    fn drop(&mut self) {
        self.0.flush(FAREWELL);
    }
}

/// Starts logging; `HAPTICD_LOG` overrides the configured level, as in
/// `HAPTICD_LOG=hapticd=debug`. A second call changes nothing.
pub fn init(config: &LogConfig) -> io::Result<Logs> {
    if let Some(queue) = QUEUE.get() {
        return Ok(Logs(queue.clone()));
    }
    // A handle of its own: whoever else prints on stderr holds a lock while it waits.
    let queue = Queue::start(File::from(io::stderr().as_fd().try_clone_to_owned()?))?;
    let queue = QUEUE.get_or_init(|| queue);
    let level = || EnvFilter::new(format!("hapticd={}", config.level.name()));
    let filter = EnvFilter::try_from_env("HAPTICD_LOG").unwrap_or_else(|_| level());
    let builder =
        tracing_subscriber::fmt().with_env_filter(filter).with_writer(move || queue.clone());
    // Tests and embedding programs may have a subscriber already.
    let _ = match config.format {
        LogFormat::Human => {
            let ansi = io::stderr().is_terminal();
            builder.with_target(false).with_ansi(ansi).try_init()
        }
        LogFormat::Json => builder.json().try_init(),
    };
    Ok(Logs(queue.clone()))
}

enum Entry {
    Line(Vec<u8>),
    /// Everything before it has been written when it is answered.
    Flush(SyncSender<()>),
}

/// Where lines wait; each write is one line.
#[derive(Clone, Debug)]
struct Queue {
    entries: SyncSender<Entry>,
    lost: Arc<AtomicU64>,
}

impl Queue {
    fn start(sink: impl Write + Send + 'static) -> io::Result<Self> {
        let (entries, waiting) = sync_channel(LINES);
        let lost = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&lost);
        let thread = std::thread::Builder::new().name("hapticd-log".into());
        thread.spawn(move || write(&waiting, sink, &counted))?;
        Ok(Self { entries, lost })
    }

    /// Never waits.
    fn push(&self, line: Vec<u8>) {
        if self.entries.try_send(Entry::Line(line)).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Waits until everything before is written, or for `patience`.
    fn flush(&self, patience: Duration) {
        let deadline = Instant::now() + patience;
        let (done, written) = sync_channel(1);
        let mut entry = Entry::Flush(done);
        while let Err(TrySendError::Full(back)) = self.entries.try_send(entry) {
            if Instant::now() >= deadline {
                return;
            }
            entry = back;
            std::thread::sleep(PAUSE);
        }
        // Not written in time, it is lost: an end that waits for a reader is no end.
        let _ = written.recv_timeout(deadline.saturating_duration_since(Instant::now()));
    }
}

impl Write for Queue {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        self.push(line.to_vec());
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The thread. It waits for stderr so that nobody else does.
fn write(waiting: &Receiver<Entry>, mut sink: impl Write, lost: &AtomicU64) {
    loop {
        let entry = match waiting.try_recv() {
            Ok(entry) => entry,
            Err(TryRecvError::Disconnected) => return,
            Err(TryRecvError::Empty) => {
                let lost = lost.swap(0, Ordering::Relaxed);
                if lost > 0 {
                    tracing::warn!(lost, "log lines were lost, stderr took no more");
                }
                match waiting.recv() {
                    Ok(entry) => entry,
                    Err(_) => return,
                }
            }
        };
        match entry {
            // There is nobody to tell that stderr is closed.
            Entry::Line(line) => drop(sink.write_all(&line)),
            Entry::Flush(done) => drop(done.try_send(())),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    #[test]
    fn nobody_waits_for_a_reader_and_what_it_missed_is_counted() {
        let (mut reader, writer) = io::pipe().unwrap();
        let queue = Queue::start(writer).unwrap();
        // More than queue and pipe hold.
        for _ in 0..4 * LINES {
            queue.push(vec![b'x'; 1024]);
        }
        assert!(queue.lost.load(Ordering::Relaxed) > LINES as u64);
        queue.flush(Duration::from_millis(1));
        let read = std::thread::spawn(move || {
            let mut all = Vec::new();
            reader.read_to_end(&mut all).unwrap();
            all.len()
        });
        queue.flush(Duration::from_secs(30));
        drop(queue);
        assert!(read.join().unwrap() >= LINES * 1024);
    }

    #[test]
    fn what_was_logged_is_written_when_it_ends() {
        let (mut reader, writer) = io::pipe().unwrap();
        let queue = Queue::start(writer).unwrap();
        let logs = Logs(queue);
        for number in 0..100 {
            logs.line(&number.to_string());
        }
        drop(logs);
        let mut text = String::new();
        reader.read_to_string(&mut text).unwrap();
        assert!(text.starts_with("0\n1\n") && text.ends_with("98\n99\n"), "{text}");
    }
}
