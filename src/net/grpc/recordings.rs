//! RecordingService: recordings of the server's devices, made, fetched and deleted.

use std::fs::File;
use std::io::Read;
use std::sync::Arc;

use tokio::sync::{Semaphore, watch};
use tokio::time::timeout;
use tonic::{Request, Response, Status};

use super::desk::{Desk, Desks};
use super::guard::Asker;
use super::places::Places;
use super::watches::{Answers, PATIENCE, Teller, Watch, answers, not_taken};
use super::{field_status, host_status, names};
use crate::archive::{Archive, ArchiveError, Info};
use crate::audit::What;
use crate::host::DeviceHost;
use crate::proto::recording_service_server::RecordingService;
use crate::proto::{
    DeleteRecordingRequest, DeleteRecordingResponse, DownloadRecordingRequest, GetRecordingRequest,
    ListRecordingsRequest, ListRecordingsResponse, Recording, RecordingChunk,
    StartRecordingRequest, StopRecordingRequest,
};

/// Bytes of a piece, and pieces that wait for a client.
const PIECE: usize = 64 * 1024;
const PIECES: usize = 4;

/// Downloads at a time.
const DOWNLOADS: usize = 8;

/// Calls that work at a time.
const AT_WORK: usize = 4;

/// The service.
pub struct Recordings {
    desks: Desks,
    archive: Arc<Archive>,
    at_work: Semaphore,
    downloads: Places,
    stopped: watch::Receiver<bool>,
}

impl Recordings {
    /// Of these devices.
    pub fn new(desks: Desks, archive: Arc<Archive>, stopped: watch::Receiver<bool>) -> Self {
        let downloads = Places::new("downloads", DOWNLOADS);
        Self { desks, archive, at_work: Semaphore::new(AT_WORK), downloads, stopped }
    }

    /// The device that a recording is of.
    fn host_of(&self, info: &Info) -> Option<Arc<DeviceHost>> {
        let is = |desk: &&Desk| desk.host.definition().name.as_str() == info.device;
        self.desks.iter().find(is).map(|desk| Arc::clone(&desk.host))
    }

    /// A recording, for this caller.
    async fn get(&self, asker: &Asker, id: &str) -> Result<Info, Status> {
        let id = id.to_owned();
        let info = self.ask(move |archive| archive.get(&id)).await?;
        asker.on(&device_of(&info))?;
        Ok(info)
    }

    /// Asks the archive where waiting for the disk is allowed.
    async fn ask<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Archive) -> Result<T, ArchiveError> + Send + 'static,
    ) -> Result<T, Status> {
        // Few at a time: whoever waits here takes no thread that a Stop may need.
        let place = self.at_work.acquire().await;
        let _place = place.map_err(|error| Status::internal(error.to_string()))?;
        let archive = Arc::clone(&self.archive);
        let done = tokio::task::spawn_blocking(move || work(&archive)).await;
        let done = done.map_err(|error| Status::internal(error.to_string()))?;
        done.map_err(|error| status(&error))
    }
}

/// Sends a file in pieces. Whoever reads slowly holds no thread: each is read when there is room.
async fn pour(mut file: File, teller: Teller<RecordingChunk>) -> Result<(), Status> {
    let internal = |error: &dyn std::error::Error| Status::internal(error.to_string());
    loop {
        let Ok(room) = timeout(PATIENCE, teller.reserve()).await else {
            return Err(not_taken());
        };
        let Ok(room) = room else { return Ok(()) };
        let read = tokio::task::spawn_blocking(move || {
            let mut data = vec![0; PIECE];
            let length = file.read(&mut data)?;
            data.truncate(length);
            Ok::<_, std::io::Error>((file, data))
        });
        let (same, data) =
            read.await.map_err(|error| internal(&error))?.map_err(|e| internal(&e))?;
        if data.is_empty() {
            return Ok(());
        }
        room.send(Ok(RecordingChunk { data }));
        file = same;
    }
}

/// Name of the device that a recording is of.
fn device_of(info: &Info) -> String {
    format!("devices/{}", info.device)
}

/// The ID in `recordings/ID`.
fn id_of(name: &str) -> Result<String, Status> {
    let id = name.strip_prefix("recordings/").map(str::to_owned);
    id.ok_or_else(|| Status::not_found(format!("name = {name:?}: must be recordings/ID")))
}

fn status(error: &ArchiveError) -> Status {
    let text = error.to_string();
    match error {
        ArchiveError::NotFound(_) => Status::not_found(text),
        ArchiveError::Field(error) => field_status(error),
        ArchiveError::Full(_) | ArchiveError::Busy => Status::resource_exhausted(text),
        ArchiveError::UnderWay(_) => Status::failed_precondition(text),
        ArchiveError::Host(error) => host_status(error),
        ArchiveError::Io { .. } => Status::internal(text),
    }
}

fn recording(info: Info) -> Recording {
    Recording {
        name: format!("recordings/{}", info.id),
        device: format!("devices/{}", info.device),
        complete: info.complete,
        seconds: info.seconds.unwrap_or(0.0),
        ticks: info.ticks,
        lost_ticks: info.lost_ticks,
        bytes: info.bytes,
        error: info.error.unwrap_or_default(),
    }
}

#[tonic::async_trait]
impl RecordingService for Recordings {
    async fn start_recording(
        &self,
        request: Request<StartRecordingRequest>,
    ) -> Result<Response<Recording>, Status> {
        let asker = Asker::of(request.extensions())?;
        let StartRecordingRequest { parent, seconds } = request.into_inner();
        let host = &names::find_device(&self.desks, &asker, "parent", &parent)?.host;
        let host = Arc::clone(host);
        let start = move |archive: &Archive| {
            let info = archive.start(&host, seconds)?;
            asker.did(What::RecordingStarted, &device_of(&info), &info.id);
            Ok(info)
        };
        let info = self.ask(start).await?;
        Ok(Response::new(recording(info)))
    }

    async fn stop_recording(
        &self,
        request: Request<StopRecordingRequest>,
    ) -> Result<Response<Recording>, Status> {
        let asker = Asker::of(request.extensions())?;
        let id = id_of(&request.get_ref().name)?;
        let mut info = self.get(&asker, &id).await?;
        // One of a device that is served no more has come to its end already.
        if let Some(host) = self.host_of(&info) {
            info = self.ask(move |archive| archive.stop(&host, &id)).await?;
        }
        Ok(Response::new(recording(info)))
    }

    async fn get_recording(
        &self,
        request: Request<GetRecordingRequest>,
    ) -> Result<Response<Recording>, Status> {
        let asker = Asker::of(request.extensions())?;
        let id = id_of(&request.get_ref().name)?;
        let info = self.get(&asker, &id).await?;
        Ok(Response::new(recording(info)))
    }

    async fn list_recordings(
        &self,
        request: Request<ListRecordingsRequest>,
    ) -> Result<Response<ListRecordingsResponse>, Status> {
        let asker = Asker::of(request.extensions())?;
        let all = self.ask(|archive| Ok(archive.list())).await?;
        let seen = all.into_iter().filter(|info| asker.sees(&device_of(info)));
        let recordings = seen.map(recording).collect();
        Ok(Response::new(ListRecordingsResponse { recordings }))
    }

    type DownloadRecordingStream = Answers<RecordingChunk>;

    async fn download_recording(
        &self,
        request: Request<DownloadRecordingRequest>,
    ) -> Result<Response<Self::DownloadRecordingStream>, Status> {
        let asker = Asker::of(request.extensions())?;
        let id = id_of(&request.get_ref().name)?;
        let device = device_of(&self.get(&asker, &id).await?);
        let place = self.downloads.take(&asker)?;
        let file = self.ask(move |archive| archive.open_file(&id)).await?;
        let watch = Watch {
            _place: place,
            stopped: self.stopped.clone(),
            asker,
            device,
            unfinished: Some("the server ends, and this is not the whole recording"),
        };
        Ok(Response::new(answers(PIECES, watch, |teller| pour(file, teller))))
    }

    async fn delete_recording(
        &self,
        request: Request<DeleteRecordingRequest>,
    ) -> Result<Response<DeleteRecordingResponse>, Status> {
        let asker = Asker::of(request.extensions())?;
        let id = id_of(&request.get_ref().name)?;
        let info = self.get(&asker, &id).await?;
        let delete = move |archive: &Archive| {
            archive.delete(&id)?;
            asker.did(What::RecordingDeleted, &device_of(&info), &info.id);
            Ok(())
        };
        self.ask(delete).await?;
        Ok(Response::new(DeleteRecordingResponse {}))
    }
}
