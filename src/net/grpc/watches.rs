//! Answers that go on, and of them WatchEvents and WatchDevices: tasks that look again and
//! again, and send what is new.
//!
//! A reader that is slow holds up only its own task: what happens meanwhile waits in the
//! bounded history of the device, and what falls out of that is told as missed. Lists of
//! devices are whole, so a slow reader gets fewer of them and never an old one after a new.

use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::sleep;
use tokio_stream::Stream;
use tonic::Status;

use super::guard::Asker;
use super::places::Place;
use super::{convert, field_status, names};
use crate::control::Event;
use crate::host::DeviceHost;
use crate::proto;
use crate::session::event_to_proto;
use crate::telemetry::{Happened, KEPT};
use crate::units::FieldError;

/// Between two looks: a few ticks.
const PERIOD: Duration = Duration::from_millis(10);

/// Between two looks whether whoever watches still may.
const LOOK: Duration = Duration::from_secs(1);

/// How long a reader is waited for that takes nothing.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// Watches of a service at a time.
pub const MOST: usize = 64;

/// Messages that may wait for a slow reader; what is newer waits in the history.
const WAITING: usize = 16;

/// Events taken from the history in one look.
const AT_ONCE: usize = 64;

/// What a watch needs besides its subject: its place among the watches, and the end of all.
pub struct Watch {
    /// Given back when its last piece was taken, or was not for too long.
    pub _place: Place,
    /// True, or its sender gone: the server ends.
    pub stopped: watch::Receiver<bool>,
    /// Who watches.
    pub asker: Asker,
    /// What it watches; empty: all that is its business.
    pub device: String,
    /// Said where the server ends first; `None`: what there was until then is all.
    pub unfinished: Option<&'static str>,
}

impl Watch {
    /// Waits for the end of the server, or of the time for which the credential counts.
    async fn over(&mut self) -> Option<Status> {
        loop {
            tokio::select! {
                _ = self.stopped.wait_for(|stopped| *stopped) => {
                    return self.unfinished.map(Status::unavailable);
                }
                () = sleep(LOOK) => {}
            }
            if let Err(status) = self.asker.still(&self.device) {
                return Some(status);
            }
        }
    }
}

/// A stream of answers.
pub type Answers<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

/// Where they come from.
pub type Teller<T> = mpsc::Sender<Result<T, Status>>;

/// Answers of what `tell` does, of which so many may wait: until there is nothing more to tell,
/// nobody to tell it to, or the watch is over. The last word comes after whatever waits.
pub fn answers<T: Send + 'static, F>(
    waiting: usize,
    mut watch: Watch,
    tell: impl FnOnce(Teller<T>) -> F,
) -> Answers<T>
where
    F: Future<Output = Result<(), Status>> + Send + 'static,
{
    let (teller, told) = mpsc::channel(waiting);
    let (reading, all_read) = oneshot::channel();
    let shared = Arc::new(Mutex::new(Shared { told: Some(told), last: None }));
    let stream = Reading { shared: Arc::clone(&shared), _reading: reading };
    let tell = tell(teller.clone());
    tokio::spawn(async move {
        let (last, over) = tokio::select! {
            told = tell => (told.err(), false),
            () = teller.closed() => (None, false),
            last = watch.over() => (last, true),
        };
        let good = last.is_none();
        lock(&shared).last = Some(last);
        drop(teller);
        match (good, over) {
            // The server ends, and what was told is all.
            (true, true) => return,
            // What was told may wait for a slow reader still.
            (true, false) => {
                let last = tokio::select! {
                    _ = all_read => return,
                    () = sleep(PATIENCE) => None,
                    last = watch.over() => last,
                };
                lock(&shared).last = Some(Some(last.unwrap_or_else(not_taken)));
            }
            (false, _) => {}
        }
        // Nobody takes it: what waits goes before the place does, which goes with the watch.
        lock(&shared).told = None;
        drop(watch);
    });
    Box::pin(stream)
}

/// The end of an answer that nobody takes.
pub fn not_taken() -> Status {
    let waited = PATIENCE.as_secs();
    Status::deadline_exceeded(format!("nothing of it was taken for {waited} s"))
}

/// What the one who tells and the one who reads share.
struct Shared<T> {
    /// `None` once it will not be read.
    told: Option<mpsc::Receiver<Result<T, Status>>>,
    /// How it ended; `None` until it has.
    last: Option<Option<Status>>,
}

fn lock<T>(shared: &Mutex<Shared<T>>) -> MutexGuard<'_, Shared<T>> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A reader's end.
struct Reading<T> {
    shared: Arc<Mutex<Shared<T>>>,
    /// Goes with the stream.
    _reading: oneshot::Sender<()>,
}

impl<T> Drop for Reading<T> {
    fn drop(&mut self) {
        // The one who tells hears of it.
        lock(&self.shared).told = None;
    }
}

impl<T> Stream for Reading<T> {
    type Item = Result<T, Status>;

    fn poll_next(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        let mut shared = lock(&self.shared);
        if let Some(told) = &mut shared.told {
            match told.poll_recv(cx) {
                Poll::Ready(None) => shared.told = None,
                other => return other,
            }
        }
        let lost = || Some(Status::internal("whoever told it is gone"));
        let last = shared.last.replace(None).unwrap_or_else(lost);
        Poll::Ready(last.map(Err))
    }
}

/// The events of a device from where the request says.
pub fn events(
    host: Arc<DeviceHost>,
    request: &proto::WatchEventsRequest,
    watch: Watch,
) -> Result<Answers<proto::DeviceEvent>, Status> {
    let newest = host.events().last();
    let seen = request.after_id.unwrap_or(newest);
    if seen > newest {
        let allowed = format!("must be at most {newest}, the newest event of this run");
        return Err(field_status(&FieldError::new("after_id", seen, allowed)));
    }
    let (only_past, end) = (request.only_past, newest);
    Ok(answers(WAITING, watch, move |teller| async move {
        let mut reader = Reader { host, seen };
        loop {
            for event in reader.read() {
                // Whoever does not read waits here, and nobody else does.
                if teller.send(Ok(event)).await.is_err() {
                    return Ok(());
                }
            }
            if only_past && reader.seen >= end {
                return Ok(());
            }
            sleep(PERIOD).await;
        }
    }))
}

/// The list of devices, at once and whenever it changes.
pub fn devices(
    list: impl Fn() -> proto::ListDevicesResponse + Send + 'static,
    watch: Watch,
) -> Answers<proto::ListDevicesResponse> {
    answers(1, watch, move |teller| async move {
        let mut last = None;
        loop {
            let answer = list();
            if last.as_ref() != Some(&answer) && teller.try_send(Ok(answer.clone())).is_ok() {
                last = Some(answer);
            }
            sleep(PERIOD).await;
        }
    })
}

/// Reads the history once through.
struct Reader {
    host: Arc<DeviceHost>,
    seen: u64,
}

impl Reader {
    fn read(&mut self) -> Vec<proto::DeviceEvent> {
        let news = self.host.events().after(self.seen, AT_ONCE);
        let mut told = Vec::with_capacity(news.len());
        for happened in news {
            let missed = happened.id - self.seen - 1;
            self.seen = happened.id;
            told.push(to_proto(&self.host, &happened, missed));
        }
        told
    }
}

fn to_proto(host: &DeviceHost, happened: &Happened, missed: u64) -> proto::DeviceEvent {
    let event = event_to_proto(happened.id, happened.time_ns, happened.event);
    let mut told = proto::DeviceEvent {
        name: names::device(host),
        event: Some(event),
        missed,
        ..proto::DeviceEvent::default()
    };
    match happened.event {
        Event::ContactBegin { source, id } | Event::ContactEnd { source, id } => {
            told.contact = convert::surface(host, &host.scene(), source, id);
        }
        Event::Mode(mode) => told.mode = proto::Mode::from(mode).into(),
        Event::Fault(fault) => told.fault = proto::Fault::from(fault).into(),
        Event::StuckBegin | Event::StuckEnd | Event::Stale | Event::Button(_) => {}
    }
    told
}

/// The history never holds less than one look takes.
const _: () = assert!(KEPT >= AT_ONCE);
