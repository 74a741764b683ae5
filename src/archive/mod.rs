//! Recordings and black boxes on disk, and the threads that keep them.
//!
//! ```text
//! STATE_DIR/recordings/ID.hrec                       what somebody asked for
//! STATE_DIR/devices/NAME/black-box/TIME-FAULT.hrec   the last seconds before a fault
//! ```
//!
//! Both are bounded: a full archive refuses until something is deleted, and of black boxes the
//! oldest go. Each recording has a thread of its own that waits for the disk, so that a slow
//! one costs entries, which are counted, and delays nobody. A recording that a crash cut short
//! can be read up to the cut, so it is kept.

mod keeper;
mod writer;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

pub use keeper::Keeper;

use crate::host::{DeviceHost, HostError};
use crate::recording::Message;
use crate::units::{self, FieldError};
use writer::Writer;

/// Ends the name of every file here.
const EXTENSION: &str = "hrec";

/// Most recordings that are kept.
const MOST_RECORDINGS: usize = 64;

/// Most bytes of all of them together.
const MOST_BYTES: u64 = 4 << 30;

/// Room that is set aside for a tick: a report with eight contacts and eight events.
const BYTES_PER_TICK: u64 = 2_000;

/// Room for the plans, the setpoints and the states of a second.
const BYTES_PER_SECOND: u64 = 1 << 20;

/// Most recordings under way.
const MOST_UNDER_WAY: usize = 4;

/// Time for one that was stopped to be on disk.
const PATIENCE: Duration = Duration::from_secs(5);

/// Why something was not done.
#[derive(Debug, thiserror::Error)]
pub enum ArchiveError {
    /// No recording has this identifier.
    #[error("there is no recording {0:?}")]
    NotFound(String),
    /// The length makes no sense.
    #[error(transparent)]
    Field(#[from] FieldError),
    /// No room.
    #[error("the archive is full: {0}; download and delete some recordings")]
    Full(String),
    /// Too many at a time.
    #[error("{MOST_UNDER_WAY} recordings are under way: stop one first")]
    Busy,
    /// It has to be stopped first.
    #[error("recording {0:?} is under way: stop it first")]
    UnderWay(String),
    /// The device's loop gave no state to begin with.
    #[error(transparent)]
    Host(#[from] HostError),
    /// The system refuses.
    #[error("{path}: {source}")]
    Io {
        /// File or directory.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
}

/// A recording, as it is now.
#[derive(Clone, Debug, PartialEq)]
pub struct Info {
    /// ID of `recordings/ID`.
    pub id: String,
    /// The device's name.
    pub device: String,
    /// Nothing is added any more.
    pub complete: bool,
    /// Length that was asked for; `None` of an earlier server's.
    pub seconds: Option<f64>,
    /// Ticks in it; 0 of an earlier server's.
    pub ticks: u64,
    /// Ticks that the disk was too slow for.
    pub lost_ticks: u64,
    /// Size of the file.
    pub bytes: u64,
    /// Why it ended early.
    pub error: Option<String>,
}

/// All recordings of one server.
#[derive(Debug)]
pub struct Archive {
    directory: PathBuf,
    kept: Mutex<BTreeMap<String, Kept>>,
    last_sink: AtomicU64,
    under_way: Arc<AtomicUsize>,
}

#[derive(Debug)]
enum Kept {
    /// Made by this server.
    Own(Writer),
    /// Found on disk.
    Found { device: String, bytes: u64 },
}

impl Archive {
    /// The recordings in a state directory.
    pub fn open(state_dir: &Path) -> Result<Self, ArchiveError> {
        let directory = state_dir.join("recordings");
        fs::create_dir_all(&directory).map_err(io_error(&directory))?;
        let mut kept = BTreeMap::new();
        for entry in fs::read_dir(&directory).map_err(io_error(&directory))?.flatten() {
            let path = entry.path();
            let (Some(id), Ok(meta)) =
                (path.file_stem().and_then(|id| id.to_str()), entry.metadata())
            else {
                continue;
            };
            if meta.is_file() && path.extension().is_some_and(|found| found == EXTENSION) {
                let device = id.rsplit_once('-').map_or(id, |(device, _)| device).to_owned();
                kept.insert(id.to_owned(), Kept::Found { device, bytes: meta.len() });
            }
        }
        Ok(Self {
            directory,
            kept: Mutex::new(kept),
            last_sink: AtomicU64::new(0),
            under_way: Arc::default(),
        })
    }

    /// How many are under way: while there are any, states have to be taken.
    pub fn under_way(&self) -> Arc<AtomicUsize> {
        Arc::clone(&self.under_way)
    }

    /// Begins a recording of so many seconds.
    pub fn start(&self, host: &DeviceHost, seconds: f64) -> Result<Info, ArchiveError> {
        units::RECORDING.check("seconds", seconds)?;
        let rate_hz = 1e9 / host.definition().tick_ns as f64;
        let room = (seconds * (rate_hz * BYTES_PER_TICK as f64 + BYTES_PER_SECOND as f64)) as u64;
        let mut kept = self.lock();
        self.check_room(&kept, room)?;
        let device = host.definition().name.to_string();
        let id = free_id(&kept, &device);
        let path = self.path(&id);
        let sink_id = self.last_sink.fetch_add(1, Ordering::Relaxed) + 1;
        let under_way = Arc::clone(&self.under_way);
        let (writer, sink) = Writer::start(&path, &device, seconds, sink_id, room, under_way)
            .map_err(io_error(&path))?;
        host.tell_recorder(Message::Begin(sink));
        if let Err(error) = host.snapshot() {
            host.tell_recorder(Message::End { id: sink_id });
            drop(writer);
            let _ = fs::remove_file(&path);
            return Err(error.into());
        }
        let info = writer.info(&id);
        kept.insert(id, Kept::Own(writer));
        Ok(info)
    }

    /// Ends one before its time, and waits until what came is on disk.
    pub fn stop(&self, host: &DeviceHost, id: &str) -> Result<Info, ArchiveError> {
        if let Kept::Own(writer) = self.lock().get(id).ok_or_else(|| not_found(id))? {
            host.tell_recorder(Message::End { id: writer.sink_id() });
        }
        let until = Instant::now() + PATIENCE;
        loop {
            let info = self.get(id)?;
            if info.complete || Instant::now() > until {
                return Ok(info);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// One of them.
    pub fn get(&self, id: &str) -> Result<Info, ArchiveError> {
        self.lock().get(id).map(|kept| kept.info(id)).ok_or_else(|| not_found(id))
    }

    /// All of them.
    pub fn list(&self) -> Vec<Info> {
        self.lock().iter().map(|(id, kept)| kept.info(id)).collect()
    }

    /// The file of one that is complete.
    pub fn open_file(&self, id: &str) -> Result<fs::File, ArchiveError> {
        self.complete(id)?;
        let path = self.path(id);
        fs::File::open(&path).map_err(io_error(&path))
    }

    /// Deletes one that is complete.
    pub fn delete(&self, id: &str) -> Result<(), ArchiveError> {
        self.complete(id)?;
        let path = self.path(id);
        let mut kept = self.lock();
        fs::remove_file(&path).map_err(io_error(&path))?;
        kept.remove(id);
        Ok(())
    }

    fn complete(&self, id: &str) -> Result<(), ArchiveError> {
        let complete = self.get(id)?.complete;
        complete.then_some(()).ok_or_else(|| ArchiveError::UnderWay(id.to_owned()))
    }

    /// Only for identifiers that are known, or made here.
    fn path(&self, id: &str) -> PathBuf {
        self.directory.join(format!("{id}.{EXTENSION}"))
    }

    fn check_room(&self, kept: &BTreeMap<String, Kept>, room: u64) -> Result<(), ArchiveError> {
        if self.under_way.load(Ordering::Relaxed) >= MOST_UNDER_WAY {
            return Err(ArchiveError::Busy);
        }
        if kept.len() >= MOST_RECORDINGS {
            return Err(ArchiveError::Full(format!("at most {MOST_RECORDINGS} recordings")));
        }
        let used: u64 = kept.values().map(Kept::room).sum();
        if used + room > MOST_BYTES {
            let mebibytes = |bytes: u64| bytes >> 20;
            return Err(ArchiveError::Full(format!(
                "{} MiB of {} MiB are taken, and this one may need {} MiB",
                mebibytes(used),
                mebibytes(MOST_BYTES),
                mebibytes(room)
            )));
        }
        Ok(())
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, Kept>> {
        // A panic elsewhere leaves a whole map behind.
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Kept {
    fn info(&self, id: &str) -> Info {
        match self {
            Self::Own(writer) => writer.info(id),
            Self::Found { device, bytes } => Info {
                id: id.to_owned(),
                device: device.clone(),
                complete: true,
                seconds: None,
                ticks: 0,
                lost_ticks: 0,
                bytes: *bytes,
                error: None,
            },
        }
    }

    /// Bytes that it has, or may yet get.
    fn room(&self) -> u64 {
        match self {
            Self::Own(writer) => writer.room(),
            Self::Found { bytes, .. } => *bytes,
        }
    }
}

fn free_id(kept: &BTreeMap<String, Kept>, device: &str) -> String {
    let mut seconds = unix_s();
    while kept.contains_key(&format!("{device}-{seconds}")) {
        seconds += 1;
    }
    format!("{device}-{seconds}")
}

fn unix_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

/// Add it to a device time for UTC.
fn utc_minus_device_ns() -> i64 {
    let utc_ns = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos());
    (utc_ns as i64).wrapping_sub(crate::clock::now_ns() as i64)
}

fn not_found(id: &str) -> ArchiveError {
    ArchiveError::NotFound(id.to_owned())
}

fn io_error(path: &Path) -> impl FnOnce(std::io::Error) -> ArchiveError {
    let path = path.display().to_string();
    move |source| ArchiveError::Io { path, source }
}
