//! WatchEvents and WatchDevices: tasks that look again and again, and send what is new.
//!
//! A reader that is slow holds up only its own task: what happens meanwhile waits in the
//! bounded history of the device, and what falls out of that is told as missed. Lists of
//! devices are whole, so a slow reader gets fewer of them and never an old one after a new.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{OwnedSemaphorePermit, mpsc, watch};
use tokio::time::{Instant, sleep_until};
use tokio_stream::wrappers::ReceiverStream;
use tonic::Status;

use super::{convert, field_status, names};
use crate::control::Event;
use crate::host::DeviceHost;
use crate::proto;
use crate::session::event_to_proto;
use crate::telemetry::{Happened, KEPT};
use crate::units::FieldError;

/// Between two looks: a few ticks.
const PERIOD: Duration = Duration::from_millis(10);

/// Messages that may wait for a slow reader; what is newer waits in the history.
const WAITING: usize = 16;

/// Events taken from the history in one look.
const AT_ONCE: usize = 64;

/// What a watch needs besides its subject: its place among the watches, and the end of all.
pub struct Watch {
    /// Given back when the watch ends.
    pub place: OwnedSemaphorePermit,
    /// True, or its sender gone: the server ends.
    pub stopped: watch::Receiver<bool>,
}

/// A stream of answers.
pub type Answers<T> = ReceiverStream<Result<T, Status>>;

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
    let (sender, answers) = mpsc::channel(WAITING);
    tokio::spawn(async move {
        let mut reader = Reader { host, seen };
        let mut watch = watch;
        loop {
            for event in reader.read() {
                // Whoever does not read waits here, and nobody else does.
                tokio::select! {
                    sent = sender.send(Ok(event)) => if sent.is_err() { return },
                    _ = watch.stopped.wait_for(|stopped| *stopped) => return,
                }
            }
            if only_past && reader.seen >= end || !pause(&sender, &mut watch).await {
                return;
            }
        }
    });
    Ok(ReceiverStream::new(answers))
}

/// The list of devices, at once and whenever it changes.
pub fn devices(
    list: impl Fn() -> proto::ListDevicesResponse + Send + 'static,
    watch: Watch,
) -> Answers<proto::ListDevicesResponse> {
    let (sender, answers) = mpsc::channel(1);
    tokio::spawn(async move {
        let (mut last, mut watch) = (None, watch);
        loop {
            let answer = list();
            if last.as_ref() != Some(&answer) && sender.try_send(Ok(answer.clone())).is_ok() {
                last = Some(answer);
            }
            if !pause(&sender, &mut watch).await {
                return;
            }
        }
    });
    ReceiverStream::new(answers)
}

/// Until the next look; false when there is none.
async fn pause<T>(sender: &mpsc::Sender<T>, watch: &mut Watch) -> bool {
    tokio::select! {
        () = sleep_until(Instant::now() + PERIOD) => true,
        () = sender.closed() => false,
        _ = watch.stopped.wait_for(|stopped| *stopped) => false,
    }
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
