//! The writer of the audit log.
//!
//! Whoever records something puts it into a queue of fixed room and goes on; a thread of its own
//! waits for the disk. What finds no room, or no disk, is counted, and the count becomes a line
//! as soon as one can be written. The first failure of a disk is told in the server's log; the
//! server goes on. Strangers cannot push others' deeds out of the log: only so many refusals a
//! minute become lines, the rest is a number.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::{Event, FILE, KEPT, Line, What};
use crate::credentials::private;
use crate::utc::Utc;

/// Lines that may wait for the disk.
const WAITING: usize = 1024;

/// Refusals among them.
const MOST_REFUSALS: u64 = WAITING as u64 / 2;

/// A file that would grow beyond this is put aside.
const LARGEST_BYTES: u64 = 10_000_000;

/// Refusals that become lines within [`MINUTE_MS`].
const REFUSALS: u64 = 30;
const MINUTE_MS: u64 = 60_000;

/// How long an end waits for the disk.
const FAREWELL: Duration = Duration::from_secs(2);
const PAUSE: Duration = Duration::from_millis(5);

/// The audit log of a running server. Dropped, it has written and synced what was recorded, if
/// the disk takes it within two seconds.
#[derive(Debug)]
pub struct AuditLog {
    to_writer: Option<SyncSender<(Line, Utc)>>,
    lost: Arc<Lost>,
    thread: Option<JoinHandle<()>>,
}

/// Lines that were not written.
#[derive(Debug, Default)]
struct Lost {
    untold: AtomicU64,
    total: AtomicU64,
    /// Not lost: refusals on their way to the writer.
    refusals_waiting: AtomicU64,
}

impl Lost {
    fn refusal_taken(&self) {
        let one_less = |waiting: u64| waiting.checked_sub(1);
        // There is none of a line that came without a queue.
        let _ = self.refusals_waiting.fetch_update(Ordering::Relaxed, Ordering::Relaxed, one_less);
    }

    fn add(&self, count: u64) {
        self.untold.fetch_add(count, Ordering::Relaxed);
        self.total.fetch_add(count, Ordering::Relaxed);
    }
}

impl AuditLog {
    /// Opens the log of a state directory, which is made where it is missing.
    pub fn open(state_dir: &Path) -> io::Result<Self> {
        fs::create_dir_all(state_dir)?;
        let mut writer = Writer::new(Files::new(state_dir, LARGEST_BYTES));
        writer.files.open()?;
        Self::start(writer, WAITING)
    }

    fn start(mut writer: Writer, waiting: usize) -> io::Result<Self> {
        let (to_writer, lines) = sync_channel(waiting);
        let lost = Arc::clone(&writer.lost);
        let thread = std::thread::Builder::new().name("hapticd-audit".into());
        let thread = thread.spawn(move || writer.run(&lines))?;
        Ok(Self { to_writer: Some(to_writer), lost, thread: Some(thread) })
    }

    /// Records something that has just been done. Never waits; what it keeps is bounded.
    pub fn record(&self, event: &Event<'_>) {
        let now = Utc::now();
        let line = (Line::new(event, now), now);
        // Strangers fill half of the queue at most, also while the disk takes its time.
        let refused = event.what == What::Refused;
        if refused && self.lost.refusals_waiting.fetch_add(1, Ordering::Relaxed) >= MOST_REFUSALS {
            self.lost.refusal_taken();
            return self.lost.add(1);
        }
        if self.to_writer.as_ref().is_none_or(|to_writer| to_writer.try_send(line).is_err()) {
            self.lost.add(1);
            if refused {
                self.lost.refusal_taken();
            }
        }
    }

    /// Lines that were not written since it was opened; refusals too many are not among them.
    pub fn lost(&self) -> u64 {
        self.lost.total.load(Ordering::Relaxed)
    }
}

impl Drop for AuditLog {
    fn drop(&mut self) {
        self.to_writer = None;
        let Some(thread) = self.thread.take() else { return };
        let deadline = Instant::now() + FAREWELL;
        while !thread.is_finished() && Instant::now() < deadline {
            std::thread::sleep(PAUSE);
        }
        if thread.is_finished() {
            // Its panic, if any, has been printed.
            let _ = thread.join();
        } else {
            tracing::error!("the audit log is not all on disk: the disk does not answer");
        }
    }
}

/// Appends one line and syncs it; for a command, beside a server that may be running.
pub fn append(state_dir: &Path, event: &Event<'_>) -> io::Result<()> {
    let mut files = Files::new(state_dir, u64::MAX);
    files.write(&Line::new(event, Utc::now()).to_json())?;
    files.sync()
}

/// What the thread owns.
#[derive(Debug)]
struct Writer {
    files: Files,
    lost: Arc<Lost>,
    refusals: Refusals,
    /// The failure has been told.
    failing: bool,
}

impl Writer {
    fn new(files: Files) -> Self {
        Self { files, lost: Arc::default(), refusals: Refusals::default(), failing: false }
    }

    fn run(&mut self, lines: &Receiver<(Line, Utc)>) {
        let mut since_told = 0;
        loop {
            // What was lost came after what still waits: it is told when nothing does, and now
            // and then where that never happens.
            let next = lines.try_recv();
            if next == Err(TryRecvError::Empty) || since_told >= WAITING {
                self.tell_lost(Utc::now());
                since_told = 0;
            }
            let next = match next {
                Ok(next) => next,
                Err(TryRecvError::Disconnected) => break,
                Err(TryRecvError::Empty) => match lines.recv() {
                    Ok(next) => next,
                    Err(_) => break,
                },
            };
            since_told += 1;
            self.take(next);
        }
        let now = Utc::now();
        if let Some(more) = self.refusals.end() {
            self.put(&Line::lost(more, Some(What::Refused), now));
        }
        self.tell_lost(now);
        let synced = self.files.sync();
        self.judge(&synced);
    }

    fn take(&mut self, (line, now): (Line, Utc)) {
        if line.what == Some(What::Refused) {
            // Of a log that is open; a command has no queue.
            self.lost.refusal_taken();
            let (written, more) = self.refusals.count(now);
            if let Some(more) = more {
                self.put(&Line::lost(more, Some(What::Refused), now));
            }
            if !written {
                return;
            }
        }
        self.put(&line);
        if line.what.is_some_and(What::is_synced) {
            let synced = self.files.sync();
            self.judge(&synced);
        }
    }

    fn put(&mut self, line: &Line) {
        let written = self.files.write(&line.to_json());
        self.judge(&written);
        if written.is_err() {
            self.lost.add(line.lost.unwrap_or(1));
        }
    }

    fn tell_lost(&mut self, now: Utc) {
        let lost = self.lost.untold.swap(0, Ordering::Relaxed);
        if lost == 0 {
            return;
        }
        let written = self.files.write(&Line::lost(lost, None, now).to_json());
        self.judge(&written);
        if written.is_err() {
            // Told another time; it has been counted.
            self.lost.untold.fetch_add(lost, Ordering::Relaxed);
        }
    }

    /// Tells when the disk begins to fail, and when it takes something again.
    fn judge(&mut self, result: &io::Result<()>) {
        let path = self.files.path().display().to_string();
        match result {
            Ok(()) if self.failing => {
                tracing::warn!(
                    path,
                    "the audit log is written again; what was lost is counted in it"
                );
            }
            Err(error) if !self.failing => {
                tracing::error!(path, %error, "the audit log cannot be written; the server goes on without");
            }
            _ => {}
        }
        self.failing = result.is_err();
    }
}

/// Counts refusals, and says which of them become lines.
#[derive(Debug, Default)]
struct Refusals {
    since_ms: u64,
    count: u64,
}

impl Refusals {
    /// Whether this one is written; and how many of the minute before were not.
    fn count(&mut self, now: Utc) -> (bool, Option<u64>) {
        let over = now.ms().abs_diff(self.since_ms) >= MINUTE_MS;
        let more = if over { self.end() } else { None };
        if over {
            self.since_ms = now.ms();
        }
        self.count += 1;
        (self.count <= REFUSALS, more)
    }

    /// Ends the minute; how many of it were not written.
    fn end(&mut self) -> Option<u64> {
        let count = std::mem::take(&mut self.count);
        count.checked_sub(REFUSALS).filter(|more| *more > 0)
    }
}

/// The file that is written now, and those put aside.
#[derive(Debug)]
struct Files {
    path: PathBuf,
    largest: u64,
    file: Option<File>,
    /// The last write may have ended within a line.
    torn: bool,
}

impl Files {
    fn new(state_dir: &Path, largest: u64) -> Self {
        Self { path: state_dir.join(FILE), largest, file: None, torn: false }
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn open(&mut self) -> io::Result<()> {
        let options = &mut OpenOptions::new();
        let mut file = private::open(&self.path, options.read(true).append(true).create(true))?;
        private::sync_directory(&self.path)?;
        self.torn = !ends_a_line(&mut file)?;
        self.file = Some(file);
        Ok(())
    }

    /// Writes one line. A command may append beside it: one call, one line.
    fn write(&mut self, line: &str) -> io::Result<()> {
        let length = self.current()?;
        if length > 0 && length + line.len() as u64 > self.largest {
            self.rotate()?;
        }
        if self.file.is_none() {
            self.open()?;
        }
        let Some(file) = &mut self.file else { return Ok(()) };
        // Half a line stays half a line, but it spoils no other.
        let text = if self.torn { format!("\n{line}") } else { line.to_owned() };
        self.torn = true;
        file.write_all(text.as_bytes())?;
        self.torn = false;
        Ok(())
    }

    /// Length of the file at the path. One that was moved away or removed is let go.
    fn current(&mut self) -> io::Result<u64> {
        let found = match fs::metadata(&self.path) {
            Ok(found) => found,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                self.file = None;
                return Ok(0);
            }
            Err(error) => return Err(error),
        };
        let open = self.file.as_ref().map(File::metadata).transpose()?;
        if open.is_some_and(|open| (open.dev(), open.ino()) != (found.dev(), found.ino())) {
            self.file = None;
        }
        Ok(found.len())
    }

    fn rotate(&mut self) -> io::Result<()> {
        self.sync()?;
        self.file = None;
        let aside = |number: u32| aside(&self.path, number);
        for number in (1..KEPT).rev() {
            rename_if_there(&aside(number), &aside(number + 1))?;
        }
        rename_if_there(&self.path, &aside(1))?;
        private::sync_directory(&self.path)
    }

    fn sync(&self) -> io::Result<()> {
        self.file.as_ref().map_or(Ok(()), File::sync_all)
    }
}

/// An older file.
pub(super) fn aside(path: &Path, number: u32) -> PathBuf {
    path.with_extension(format!("jsonl.{number}"))
}

fn rename_if_there(from: &Path, to: &Path) -> io::Result<()> {
    match fs::rename(from, to) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

fn ends_a_line(file: &mut File) -> io::Result<bool> {
    if file.metadata()?.len() == 0 {
        return Ok(true);
    }
    let mut last = [0];
    file.seek(SeekFrom::End(-1))?;
    file.read_exact(&mut last)?;
    Ok(last == *b"\n")
}

#[cfg(test)]
#[path = "log_tests.rs"]
mod tests;
