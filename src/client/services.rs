//! The gRPC services of a server, ready to call.
//!
//! Every call has a deadline for its answer to begin, and the connection is watched, so a
//! server that is silent or gone is an error and never a wait without end. What is streamed
//! after a first answer may take as long as it likes.

use std::time::Duration;

use tonic::transport::{Channel, Endpoint};
use tonic::{Code, Status};

use super::ConnectString;
use crate::proto::device_service_client::DeviceServiceClient;
use crate::proto::recording_service_client::RecordingServiceClient;
use crate::proto::scene_service_client::SceneServiceClient;
use crate::proto::session_service_client::SessionServiceClient;

/// Time for a connection.
const CONNECT: Duration = Duration::from_secs(3);

/// Time for the answer to a call; an edit waits for a disk, and for the edits before it.
const ANSWER: Duration = Duration::from_secs(10);

/// Between two looks whether the server is still there, and time for its sign of life.
const KEEP_ALIVE: Duration = Duration::from_secs(5);

/// A client of the DeviceService.
pub type Devices = DeviceServiceClient<Channel>;

/// Clients of the services on one channel.
#[derive(Clone, Debug)]
pub struct Services {
    /// Devices: describe, watch, switch.
    pub devices: Devices,
    /// Resident scenes.
    pub scenes: SceneServiceClient<Channel>,
    /// Who is connected, and who commands.
    pub sessions: SessionServiceClient<Channel>,
    /// Recordings.
    pub recordings: RecordingServiceClient<Channel>,
}

/// Why there are no services.
#[derive(Debug, thiserror::Error)]
pub enum ServicesError {
    /// They are plaintext, and the server is elsewhere.
    #[error(
        "{host} is not this machine, and the services are not encrypted: whoever is on the way can read and change what is said, and command the device"
    )]
    Plaintext { host: String },
    /// No connection.
    #[error("cannot connect to {authority}: {source}")]
    Connect { authority: String, source: tonic::transport::Error },
}

/// Connects to the services of a server on this machine. They are plaintext, so others are
/// refused; see [`services_in_plaintext`].
pub async fn services(target: &ConnectString) -> Result<Services, ServicesError> {
    if !target.is_loopback() {
        return Err(ServicesError::Plaintext { host: target.host.clone() });
    }
    services_in_plaintext(target).await
}

/// The same wherever the server is, for networks that are trusted as a whole.
pub async fn services_in_plaintext(target: &ConnectString) -> Result<Services, ServicesError> {
    let authority = target.grpc_authority();
    let connected = async {
        Endpoint::from_shared(format!("http://{authority}"))?
            .connect_timeout(CONNECT)
            .timeout(ANSWER)
            .http2_keep_alive_interval(KEEP_ALIVE)
            .keep_alive_timeout(KEEP_ALIVE)
            .keep_alive_while_idle(true)
            .connect()
            .await
    };
    let channel = connected.await.map_err(|source| ServicesError::Connect { authority, source })?;
    Ok(Services {
        devices: DeviceServiceClient::new(channel.clone()),
        scenes: SceneServiceClient::new(channel.clone()),
        sessions: SessionServiceClient::new(channel.clone()),
        recordings: RecordingServiceClient::new(channel),
    })
}

/// A refusal in the server's own words, or that there were none.
pub fn told(status: &Status) -> String {
    let expired = tonic::TimeoutExpired(()).to_string();
    match status.code() {
        Code::Cancelled if status.message() == expired => {
            format!("the server did not answer within {} s", ANSWER.as_secs())
        }
        code => format!("{} ({code:?})", status.message()),
    }
}
