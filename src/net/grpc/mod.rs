//! The services: resource names in, typed statuses out, everything else asked of the host.

mod convert;
mod devices;
mod names;
mod scenes;

use std::future::Future;
use std::sync::Arc;

use tokio::net::TcpListener;
use tokio_stream::wrappers::TcpListenerStream;
use tonic::Status;
use tonic::transport::Server;

use crate::config::SceneError;
use crate::host::{DeviceHost, HostError};
use crate::proto::DESCRIPTOR_SET;
use crate::proto::device_service_server::DeviceServiceServer;
use crate::proto::scene_service_server::SceneServiceServer;
use crate::units::FieldError;
use devices::Devices;
use scenes::Scenes;

/// Serves the services with health and reflection (v1 and v1alpha) until `shutdown` is done.
pub async fn serve(
    listener: TcpListener,
    host: Arc<DeviceHost>,
    shutdown: impl Future<Output = ()>,
) -> anyhow::Result<()> {
    let devices = DeviceServiceServer::new(Devices { host: Arc::clone(&host) });
    let scenes = SceneServiceServer::new(Scenes { host });
    let (reporter, health) = tonic_health::server::health_reporter();
    reporter.set_serving::<DeviceServiceServer<Devices>>().await;
    reporter.set_serving::<SceneServiceServer<Scenes>>().await;
    let reflection = || {
        tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(DESCRIPTOR_SET)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
    };
    Server::builder()
        .add_service(devices)
        .add_service(scenes)
        .add_service(health)
        .add_service(reflection().build_v1()?)
        .add_service(reflection().build_v1alpha()?)
        .serve_with_incoming_shutdown(TcpListenerStream::new(listener), shutdown)
        .await?;
    Ok(())
}

/// Runs something that blocks for milliseconds on a thread where that is allowed.
async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, HostError> + Send + 'static,
) -> Result<T, Status> {
    let done = tokio::task::spawn_blocking(work).await;
    done.map_err(|error| Status::internal(error.to_string()))?.map_err(|error| host_status(&error))
}

fn host_status(error: &HostError) -> Status {
    let text = error.to_string();
    match error {
        HostError::Mode(_) => Status::failed_precondition(text),
        HostError::Scene(error) => scene_status(error),
        HostError::State(_) => Status::internal(text),
        HostError::Unresponsive => Status::unavailable(text),
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
