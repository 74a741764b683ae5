//! The services: resource names in, typed statuses out, everything else asked of the host.

mod convert;
mod desk;
mod devices;
mod explain;
mod guard;
mod manipulability;
mod names;
mod places;
mod recordings;
mod scenes;
mod sessions;
mod settings;
mod watches;

use std::sync::Arc;

use axum::Router;
use axum::extract::Request;
use axum::middleware::{Next, from_fn};
use tokio::sync::watch;
use tonic::Status;
use tonic::service::Routes;

use super::visit::{Speaks, receive};
use super::{Access, Door, Gate, SessionDesk};
use crate::archive::Archive;
use crate::config::SceneError;
use crate::host::{HostError, Hosts};
use crate::proto::DESCRIPTOR_SET;
use crate::proto::device_service_server::DeviceServiceServer;
use crate::proto::recording_service_server::RecordingServiceServer;
use crate::proto::scene_service_server::SceneServiceServer;
use crate::proto::session_service_server::SessionServiceServer;
use crate::units::FieldError;
use desk::desks;
use devices::Devices;
use recordings::Recordings;
use scenes::Scenes;
use sessions::SessionCallsService;

/// Longest question about health or reflection, which anybody may ask: the answer repeats it.
const QUESTION_BYTES: usize = 4 * 1024;

/// What the services need.
#[derive(Clone, Debug)]
pub struct GrpcParts {
    /// The devices.
    pub hosts: Hosts,
    /// The way to the sessions.
    pub sessions: SessionDesk,
    /// The recordings.
    pub archive: Arc<Archive>,
    /// Who may call.
    pub gate: Arc<Gate>,
    /// Whose pages may.
    pub access: Access,
    /// Where the metrics are.
    pub http_port: u16,
}

/// The services behind the guard, with health and reflection (v1 and v1alpha); watches end when
/// `stopped` is true or its sender gone.
pub async fn routes(parts: GrpcParts, stopped: watch::Receiver<bool>) -> anyhow::Result<Router> {
    let GrpcParts { hosts, sessions, archive, gate, access, http_port } = parts;
    let desks = desks(&hosts);
    let devices = Devices::new(desks.clone(), sessions.clone(), http_port, stopped.clone());
    let devices = DeviceServiceServer::new(devices);
    let recordings = Recordings::new(desks.clone(), archive, stopped.clone());
    let recordings = RecordingServiceServer::new(recordings);
    let scenes = SceneServiceServer::new(Scenes::new(desks, stopped));
    let sessions = SessionServiceServer::new(SessionCallsService::new(sessions, hosts));
    let (reporter, health) = tonic_health::server::health_reporter();
    reporter.set_serving::<DeviceServiceServer<Devices>>().await;
    reporter.set_serving::<SceneServiceServer<Scenes>>().await;
    reporter.set_serving::<RecordingServiceServer<Recordings>>().await;
    reporter.set_serving::<SessionServiceServer<SessionCallsService>>().await;
    let reflection = || {
        tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(DESCRIPTOR_SET)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
    };
    let access = Arc::new(access);
    let guard = from_fn(move |request: Request, next: Next| {
        guard::guard(Arc::clone(&gate), Arc::clone(&access), request, next)
    });
    let routes = Routes::new(devices)
        .add_service(scenes)
        .add_service(sessions)
        .add_service(recordings)
        .add_service(health.max_decoding_message_size(QUESTION_BYTES))
        .add_service(reflection().build_v1()?.max_decoding_message_size(QUESTION_BYTES))
        .add_service(reflection().build_v1alpha()?.max_decoding_message_size(QUESTION_BYTES));
    Ok(routes.into_axum_router().layer(guard))
}

/// Serves until `stopped` is true or its sender gone, and the calls under way are answered.
pub async fn serve(door: Door, routes: Router, stopped: watch::Receiver<bool>) {
    receive(door, Speaks::Http2, routes, stopped).await;
}

fn host_status(error: &HostError) -> Status {
    let text = error.to_string();
    match error {
        HostError::Mode(_) | HostError::Home(_) => Status::failed_precondition(text),
        HostError::Scene(error) => scene_status(error),
        HostError::Settings(error) => settings::status(error),
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
