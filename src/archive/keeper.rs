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

/// Ends the name of one that is being written.
const UNFINISHED: &str = "new";

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

/// Beside its place first, so that what has the name is whole. The oldest go before it is
/// written: a disk may be full of them.
fn write(directory: &Path, device: &str, black_box: &BlackBox) -> io::Result<PathBuf> {
    fs::create_dir_all(directory)?;
    prune(directory)?;
    let fault = black_box.fault.name();
    let mut seconds = unix_s();
    let path = loop {
        let path = directory.join(format!("{seconds}-{fault}.{EXTENSION}"));
        if !path.exists() {
            break path;
        }
        seconds += 1;
    };
    let temporary = path.with_extension(UNFINISHED);
    put(&temporary, &path, device, black_box)?;
    File::open(directory)?.sync_all()?;
    Ok(path)
}

fn put(temporary: &Path, path: &Path, device: &str, black_box: &BlackBox) -> io::Result<()> {
    let written = fill(temporary, device, black_box).and_then(|()| fs::rename(temporary, path));
    // Half a box takes room that the next one needs.
    written.inspect_err(|_| drop(fs::remove_file(temporary)))
}

fn fill(path: &Path, device: &str, black_box: &BlackBox) -> io::Result<()> {
    let mut file = File::create(path)?;
    let cause = format!("fault {} in tick {}", black_box.fault.name(), black_box.tick);
    file.write_all(&header(device, utc_minus_device_ns(), &cause))?;
    for segment in &black_box.segments {
        file.write_all(segment)?;
    }
    file.sync_all()
}

/// Room for one more: what a crash left unfinished goes, and the oldest, whose names begin with
/// their time.
fn prune(directory: &Path) -> io::Result<()> {
    let files: Vec<_> = fs::read_dir(directory)?.flatten().map(|entry| entry.path()).collect();
    let ending = |wanted: &'static str| {
        let has = move |path: &&PathBuf| path.extension().is_some_and(|found| found == wanted);
        files.iter().filter(has)
    };
    let mut boxes: Vec<_> = ending(EXTENSION).collect();
    boxes.sort();
    let spare = (boxes.len() + 1).saturating_sub(MOST_BOXES);
    ending(UNFINISHED).chain(boxes.into_iter().take(spare)).try_for_each(fs::remove_file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Fault;

    fn black_box() -> BlackBox {
        BlackBox { fault: Fault::Overrun, tick: 7, segments: vec![b"ticks".to_vec()] }
    }

    fn names(directory: &Path) -> Vec<String> {
        let files = fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().file_name());
        let mut names: Vec<_> = files.map(|name| name.into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn the_oldest_boxes_and_what_was_left_unfinished_go() {
        let folder = tempfile::tempdir().unwrap();
        for second in 100..110 {
            fs::write(folder.path().join(format!("{second}-overrun.hrec")), "old").unwrap();
        }
        fs::write(folder.path().join("105-overrun.new"), "half").unwrap();
        write(folder.path(), "left", &black_box()).unwrap();
        let names = names(folder.path());
        assert_eq!(names.len(), MOST_BOXES, "{names:?}");
        assert_eq!(names[0], "103-overrun.hrec", "{names:?}");
        assert!(names.iter().all(|name| name.ends_with(EXTENSION)), "{names:?}");
    }

    #[test]
    fn a_box_that_cannot_be_put_in_place_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        let temporary = folder.path().join("box.new");
        let nowhere = folder.path().join("none").join("box.hrec");
        put(&temporary, &nowhere, "left", &black_box()).unwrap_err();
        assert!(names(folder.path()).is_empty());
    }
}
