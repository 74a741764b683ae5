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
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

pub use keeper::Keeper;

use crate::host::{DeviceHost, HostError};
use crate::recording::{Message, Sink};
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

/// Room for plans and states however short it is: edits add plans, of which one with the
/// largest scene has about two megabytes, and a state has up to half of one.
const BYTES_AT_LEAST: u64 = 32 << 20;

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
        let room = room_of(host.definition().tick_ns, seconds);
        let (id, sink) = self.reserve(host.definition().name.as_str(), seconds, room)?;
        let sink_id = sink.id;
        host.tell_recorder(Message::Begin(sink));
        // The loop may keep this waiting for a second: nobody else is.
        if let Err(error) = host.snapshot() {
            host.tell_recorder(Message::End { id: sink_id });
            let kept = self.lock().remove(&id);
            // Waits for its thread.
            drop(kept);
            let _ = fs::remove_file(self.path(&id));
            return Err(error.into());
        }
        self.get(&id)
    }

    /// The place, the file and the thread of a recording that begins.
    fn reserve(
        &self,
        device: &str,
        seconds: f64,
        room: u64,
    ) -> Result<(String, Sink), ArchiveError> {
        let mut kept = self.lock();
        self.check_room(&kept, room)?;
        let id = self.free_id(&kept, device);
        let path = self.path(&id);
        let sink_id = self.last_sink.fetch_add(1, Ordering::Relaxed) + 1;
        let under_way = Arc::clone(&self.under_way);
        let (writer, sink) = Writer::start(&path, device, seconds, sink_id, room, under_way)
            .map_err(io_error(&path))?;
        kept.insert(id.clone(), Kept::Own(writer));
        Ok((id, sink))
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

    /// Deletes one that is complete. That somebody has deleted its file is no reason to keep it.
    pub fn delete(&self, id: &str) -> Result<(), ArchiveError> {
        self.complete(id)?;
        let path = self.path(id);
        let mut kept = self.lock();
        match fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(io_error(&path)(error)),
            _ => {
                kept.remove(id);
                Ok(())
            }
        }
    }

    fn complete(&self, id: &str) -> Result<(), ArchiveError> {
        let complete = self.get(id)?.complete;
        complete.then_some(()).ok_or_else(|| ArchiveError::UnderWay(id.to_owned()))
    }

    /// Only for identifiers that are known, or made here.
    fn path(&self, id: &str) -> PathBuf {
        self.directory.join(format!("{id}.{EXTENSION}"))
    }

    /// Of a name that neither a recording nor a file has.
    fn free_id(&self, kept: &BTreeMap<String, Kept>, device: &str) -> String {
        let ids = (unix_s()..).map(|seconds| format!("{device}-{seconds}"));
        let mut free = ids.filter(|id| !kept.contains_key(id) && !self.path(id).exists());
        free.next().unwrap_or_default()
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

/// Most bytes of a recording.
fn room_of(tick_ns: u64, seconds: f64) -> u64 {
    let rate_hz = 1e9 / tick_ns as f64;
    let bytes_per_s = rate_hz * BYTES_PER_TICK as f64 + BYTES_PER_SECOND as f64;
    BYTES_AT_LEAST + (seconds * bytes_per_s) as u64
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

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::config::{DeviceDefinition, Id, ObjectKind, Scene, SceneObject, build_plan};
    use crate::control::{ControlState, Mode};
    use crate::environment::{MAX_CORRIDOR_POINTS, MAX_OBJECTS, Material};
    use crate::recording::{plan_entry, snapshot_entry};

    fn largest_scene() -> Scene {
        let mut scene = Scene::default();
        let point = |i: usize| Vector3::new(i as f64 / 7.0, (i as f64).sqrt(), 1.0 / 3.0);
        for i in 0..MAX_OBJECTS {
            let points_m = (0..MAX_CORRIDOR_POINTS).map(point).collect();
            let kind = ObjectKind::Corridor { points_m, radius_m: 0.1 };
            let id = Id::parse("id", &format!("corridor-{i}")).unwrap();
            let object = SceneObject::new(id, kind, Some(Material::default()), false).unwrap();
            scene.create(object, None).unwrap();
        }
        scene
    }

    #[test]
    fn a_short_recording_has_room_for_edits_of_the_largest_scene() {
        let device = DeviceDefinition::load("cho-2005").unwrap();
        let scene = largest_scene();
        let plan = plan_entry(&build_plan(&device, &scene), &device, &scene);
        let state = snapshot_entry(&ControlState::new(Mode::Enabled));
        assert!(plan.len() > 1_000_000, "{}", plan.len());
        let room = room_of(device.tick_ns, 1e-3);
        assert!(room > 10 * (plan.len() + state.len()) as u64, "{} {room}", plan.len());
    }

    #[test]
    fn what_is_deleted_from_the_disk_can_be_deleted_from_the_archive() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("recordings/left-17.hrec");
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(&file, "ticks").unwrap();
        let archive = Archive::open(folder.path()).unwrap();
        assert_eq!(archive.get("left-17").unwrap().device, "left");
        fs::remove_file(&file).unwrap();
        archive.delete("left-17").unwrap();
        assert!(archive.list().is_empty());
        assert!(matches!(archive.delete("left-17"), Err(ArchiveError::NotFound(_))));
    }

    #[test]
    fn a_file_that_nobody_knows_keeps_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let archive = Archive::open(folder.path()).unwrap();
        let taken = archive.free_id(&BTreeMap::new(), "left");
        fs::write(archive.path(&taken), "ticks").unwrap();
        assert_ne!(archive.free_id(&BTreeMap::new(), "left"), taken);
    }
}
