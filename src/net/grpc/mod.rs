//! The services: resource names in, typed statuses out, everything else asked of the host.
//!
//! What blocks goes through a [`Lane`]: scene edits, which wait for the disk, through one;
//! changes of mode through another; and Stop through one of its own, so that nothing that
//! anybody else has asked for can keep it waiting.

mod convert;
mod devices;
mod names;
mod recordings;
mod scenes;

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{Mutex, watch};
use tonic::Status;
use tonic::transport::Server;

use super::Door;
use crate::archive::Archive;
use crate::config::SceneError;
use crate::host::{DeviceHost, HostError};
use crate::proto::DESCRIPTOR_SET;
use crate::proto::device_service_server::DeviceServiceServer;
use crate::proto::recording_service_server::RecordingServiceServer;
use crate::proto::scene_service_server::SceneServiceServer;
use crate::units::FieldError;
use devices::Devices;
use recordings::Recordings;
use scenes::Scenes;

/// Pings to a client that says nothing, and the time for their answer: whoever is gone
/// without a word gives its place back.
const KEEP_ALIVE: Duration = Duration::from_secs(10);

/// Calls of one connection that may wait at a time.
const CALLS: u32 = 2048;

/// Serves the services with health and reflection (v1 and v1alpha) until `stopped` is true
/// or its sender gone, and the calls under way are answered.
pub async fn serve(
    door: Door,
    host: Arc<DeviceHost>,
    archive: Arc<Archive>,
    mut stopped: watch::Receiver<bool>,
) -> anyhow::Result<()> {
    let devices = DeviceServiceServer::new(Devices::new(Arc::clone(&host), stopped.clone()));
    let recordings =
        RecordingServiceServer::new(Recordings::new(Arc::clone(&host), archive, stopped.clone()));
    let scenes = SceneServiceServer::new(Scenes::new(host));
    let (reporter, health) = tonic_health::server::health_reporter();
    reporter.set_serving::<DeviceServiceServer<Devices>>().await;
    reporter.set_serving::<SceneServiceServer<Scenes>>().await;
    reporter.set_serving::<RecordingServiceServer<Recordings>>().await;
    let reflection = || {
        tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(DESCRIPTOR_SET)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
    };
    let shutdown = async move {
        let _ = stopped.wait_for(|stopped| *stopped).await;
    };
    Server::builder()
        .http2_keepalive_interval(Some(KEEP_ALIVE))
        .http2_keepalive_timeout(Some(KEEP_ALIVE))
        .max_concurrent_streams(CALLS)
        .add_service(devices)
        .add_service(scenes)
        .add_service(recordings)
        .add_service(health)
        .add_service(reflection().build_v1()?)
        .add_service(reflection().build_v1alpha()?)
        .serve_with_incoming_shutdown(door.visitors(), shutdown)
        .await?;
    Ok(())
}

/// Work that blocks for milliseconds: one piece after the other, each on a thread where that
/// is allowed. Whoever waits here holds no thread, and leaves the queue with its client.
#[derive(Clone, Default)]
struct Lane(Arc<Mutex<()>>);

impl Lane {
    async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> Result<T, HostError> + Send + 'static,
    ) -> Result<T, Status> {
        let turn = Arc::clone(&self.0).lock_owned().await;
        let done = tokio::task::spawn_blocking(move || {
            // Kept to the end, even where the client does not wait for it.
            let _turn = turn;
            work()
        });
        let done = done.await.map_err(|error| Status::internal(error.to_string()))?;
        done.map_err(|error| host_status(&error))
    }
}

fn host_status(error: &HostError) -> Status {
    let text = error.to_string();
    match error {
        HostError::Mode(_) => Status::failed_precondition(text),
        HostError::Scene(error) => scene_status(error),
        HostError::State(_) => Status::internal(text),
        HostError::Busy | HostError::Unresponsive => Status::unavailable(text),
    }
}

fn scene_status(error: &SceneError) -> Status {
    let text = error.to_string();
    match error {
        SceneError::NotFound { .. } => Status::not_found(text),
        SceneError::AlreadyExists { .. } => Status::already_exists(text),
        SceneError::Full { .. } => Status::resource_exhausted(text),
        SceneError::StaleRevision { .. } => Status::aborted(text),
        SceneError::Invalid(_) => Status::invalid_argument(text),
    }
}

fn field_status(error: &FieldError) -> Status {
    Status::invalid_argument(error.to_string())
}
