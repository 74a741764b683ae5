//! The thread beside a device that asks for its states and writes its black boxes.
//!
//! It ends when the recorder has, after the last black box is on disk.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::{EXTENSION, unix_s, utc_minus_device_ns};
use crate::host::DeviceHost;
use crate::recording::{BlackBox, header};

/// Between two states: the black box keeps up to so much more than it has to.
const PERIOD: Duration = Duration::from_secs(2);

/// Black boxes of a device that are kept.
const MOST_BOXES: usize = 8;

/// The running thread.
#[derive(Debug)]
pub struct Keeper(Option<JoinHandle<()>>);

impl Keeper {
    /// Starts it. States are taken while there is a black box, or a recording is under way.
    pub fn start(
        host: Arc<DeviceHost>,
        frozen: Receiver<BlackBox>,
        state_dir: &Path,
        has_black_box: bool,
        under_way: Arc<AtomicUsize>,
    ) -> io::Result<Self> {
        let name = host.definition().name.to_string();
        let directory = state_dir.join("devices").join(&name).join("black-box");
        let thread = std::thread::Builder::new().name("keeper".into()).spawn(move || {
            let keep = || {
                if has_black_box || under_way.load(Ordering::Relaxed) > 0 {
                    // A loop that does not answer says so elsewhere; the next one may.
                    let _ = host.snapshot();
                }
            };
            keep();
            loop {
                match frozen.recv_timeout(PERIOD) {
                    Ok(black_box) => {
                        keep();
                        tell(&black_box, &name, write(&directory, &name, &black_box));
                    }
                    Err(RecvTimeoutError::Timeout) => keep(),
                    Err(RecvTimeoutError::Disconnected) => return,
                }
            }
        })?;
        Ok(Self(Some(thread)))
    }

    /// Waits for its end.
    pub fn join(&mut self) {
        if let Some(thread) = self.0.take() {
            // Its panic, if any, has been printed.
            let _ = thread.join();
        }
    }
}

fn tell(black_box: &BlackBox, device: &str, written: io::Result<PathBuf>) {
    let (fault, tick) = (black_box.fault.name(), black_box.tick);
    match written {
        Ok(path) => {
            let path = path.display();
            tracing::warn!(device, fault, tick, %path, "black box written; hapticd replay reads it");
        }
        Err(error) => {
            tracing::error!(device, fault, tick, %error, "black box could not be written")
        }
    }
}

/// Beside its place first, so that what has the name is whole.
fn write(directory: &Path, device: &str, black_box: &BlackBox) -> io::Result<PathBuf> {
    fs::create_dir_all(directory)?;
    let fault = black_box.fault.name();
    let mut seconds = unix_s();
    let path = loop {
        let path = directory.join(format!("{seconds}-{fault}.{EXTENSION}"));
        if !path.exists() {
            break path;
        }
        seconds += 1;
    };
    let temporary = path.with_extension("new");
    let mut file = File::create(&temporary)?;
    let cause = format!("fault {fault} in tick {}", black_box.tick);
    file.write_all(&header(device, utc_minus_device_ns(), &cause))?;
    for segment in &black_box.segments {
        file.write_all(segment)?;
    }
    file.sync_all()?;
    fs::rename(&temporary, &path)?;
    File::open(directory)?.sync_all()?;
    prune(directory)?;
    Ok(path)
}

/// The oldest go; their names begin with their time.
fn prune(directory: &Path) -> io::Result<()> {
    let files = fs::read_dir(directory)?.flatten().map(|entry| entry.path());
    let mut boxes: Vec<_> =
        files.filter(|path| path.extension().is_some_and(|found| found == EXTENSION)).collect();
    boxes.sort();
    let spare = boxes.len().saturating_sub(MOST_BOXES);
    boxes.iter().take(spare).try_for_each(fs::remove_file)
}
