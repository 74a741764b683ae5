//! A recording as it lies in a file, read as far as it makes sense.
//!
//! Everything here is from outside. A file that does not begin with the header of this very
//! version is refused; one that is cut short, or broken further on, is read up to there, and
//! [`End`] says so. Ticks stay bytes until they are asked for.

use std::collections::BTreeMap;
use std::ops::Range;

use prost::Message;

use super::exact::framed;
use crate::proto::record_entry::Entry;
use crate::proto::{RecordEntry, RecordHeader, RecordPlan, RecordSetpoint, RecordSnapshot};
use crate::proto::{RecordReport, RecordTick};

/// Of the entries and of what serde stores in them; changes when either does.
pub const LAYOUT: u32 = 3;

const MAGIC: &str = "hapticd recording";
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// No entry is larger: a state with every surface in use has half a megabyte.
const LARGEST_ENTRY: usize = 1 << 24;

/// A length takes at most this many bytes.
const LONGEST_LENGTH: usize = 10;

/// Why a file is not read at all.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FileError {
    /// Something else.
    #[error("this is no recording of hapticd")]
    NotARecording,
    /// Made by another version.
    #[error(
        "the recording was made by hapticd {version} (layout {layout}); this is {VERSION} (layout {LAYOUT}): replay it with that version"
    )]
    OtherVersion {
        /// Of the hapticd that made it.
        version: String,
        /// Of the file.
        layout: u32,
    },
}

/// How a recording ends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum End {
    /// After its last entry.
    Whole,
    /// Within an entry, which begins at this byte.
    CutShort {
        /// From the beginning of the file.
        at_byte: usize,
    },
    /// At an entry that cannot be understood.
    Broken {
        /// From the beginning of the file.
        at_byte: usize,
        /// What is wrong with it.
        why: String,
    },
}

/// A recording.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// Where it comes from.
    pub header: RecordHeader,
    /// How it ends.
    pub end: End,
    bytes: Vec<u8>,
    ticks: Vec<Range<usize>>,
    pub(super) plans: BTreeMap<u64, RecordPlan>,
    pub(super) setpoints: BTreeMap<u64, RecordSetpoint>,
    pub(super) snapshots: BTreeMap<u64, RecordSnapshot>,
}

/// The first entry of a file.
pub fn header(device: &str, utc_minus_device_ns: i64, cause: &str) -> Vec<u8> {
    framed(Entry::Header(RecordHeader {
        magic: MAGIC.to_owned(),
        layout: LAYOUT,
        version: VERSION.to_owned(),
        device: device.to_owned(),
        utc_minus_device_ns,
        cause: cause.to_owned(),
    }))
}

/// One step through the bytes.
enum Next {
    Entry(Box<Entry>, Range<usize>),
    End(End),
}

impl Recorded {
    /// Reads the bytes of a file.
    pub fn read(bytes: Vec<u8>) -> Result<Self, FileError> {
        let Next::Entry(entry, first) = next(&bytes, 0) else {
            return Err(FileError::NotARecording);
        };
        let Entry::Header(header) = *entry else { return Err(FileError::NotARecording) };
        if header.magic != MAGIC {
            return Err(FileError::NotARecording);
        }
        let RecordHeader { layout, ref version, .. } = header;
        if layout != LAYOUT || version != VERSION {
            return Err(FileError::OtherVersion { version: version.clone(), layout });
        }
        let mut recorded = Self {
            header,
            end: End::Whole,
            bytes,
            ticks: Vec::new(),
            plans: BTreeMap::new(),
            setpoints: BTreeMap::new(),
            snapshots: BTreeMap::new(),
        };
        recorded.read_on(first.end);
        Ok(recorded)
    }

    fn read_on(&mut self, mut at: usize) {
        loop {
            let (entry, place) = match next(&self.bytes, at) {
                Next::Entry(entry, place) => (entry, place),
                Next::End(end) => {
                    self.end = end;
                    return;
                }
            };
            at = place.end;
            match *entry {
                Entry::Header(_) => {}
                Entry::Plan(plan) => {
                    self.plans.insert(plan.generation, plan);
                }
                Entry::Setpoint(setpoint) => {
                    self.setpoints.insert(setpoint.number, setpoint);
                }
                Entry::Snapshot(snapshot) => {
                    self.snapshots.insert(snapshot.after_tick, snapshot);
                }
                Entry::Tick(_) => self.ticks.push(place),
            }
        }
    }

    /// How many ticks it has.
    pub fn len(&self) -> usize {
        self.ticks.len()
    }

    /// True without any.
    pub fn is_empty(&self) -> bool {
        self.ticks.is_empty()
    }

    /// Its ticks, in the order of the file.
    pub fn ticks(&self) -> impl Iterator<Item = RecordTick> {
        self.ticks.iter().filter_map(|place| {
            match RecordEntry::decode(&self.bytes[place.clone()]).ok()?.entry? {
                Entry::Tick(tick) => Some(tick),
                _ => None,
            }
        })
    }

    /// The ticks with their reports; one without is no tick of hapticd.
    pub fn reports(&self) -> impl Iterator<Item = (RecordTick, RecordReport)> {
        self.ticks().filter_map(|mut tick| {
            let report = tick.report.take()?;
            Some((tick, report))
        })
    }
}

fn next(bytes: &[u8], at: usize) -> Next {
    let mut rest = &bytes[at..];
    if rest.is_empty() {
        return Next::End(End::Whole);
    }
    let broken = |why: String| Next::End(End::Broken { at_byte: at, why });
    let length = match prost::decode_length_delimiter(&mut rest) {
        Ok(length) if length <= LARGEST_ENTRY => length,
        Ok(length) => return broken(format!("an entry of {length} bytes")),
        Err(_) if rest.len() < LONGEST_LENGTH => return Next::End(End::CutShort { at_byte: at }),
        Err(error) => return broken(error.to_string()),
    };
    let begin = bytes.len() - rest.len();
    let Some(entry) = rest.get(..length) else {
        return Next::End(End::CutShort { at_byte: at });
    };
    match RecordEntry::decode(entry) {
        Ok(RecordEntry { entry: Some(entry) }) => {
            Next::Entry(Box::new(entry), begin..begin + length)
        }
        Ok(_) => broken("an entry of no known kind".to_owned()),
        Err(error) => broken(error.to_string()),
    }
}
