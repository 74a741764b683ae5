//! The gRPC services of a server, ready to call.

use tonic::transport::{Channel, Endpoint};

use super::ConnectString;
use crate::proto::device_service_client::DeviceServiceClient;
use crate::proto::scene_service_client::SceneServiceClient;

/// Clients of the services on one channel.
#[derive(Clone, Debug)]
pub struct Services {
    /// Devices: describe, watch, switch.
    pub devices: DeviceServiceClient<Channel>,
    /// Resident scenes.
    pub scenes: SceneServiceClient<Channel>,
}

/// Connects to the services of a server; plaintext, which is for this machine only.
pub async fn services(target: &ConnectString) -> Result<Services, tonic::transport::Error> {
    let endpoint = Endpoint::from_shared(format!("http://{}", target.grpc_authority()))?;
    let channel = endpoint.connect_timeout(std::time::Duration::from_secs(3)).connect().await?;
    Ok(Services {
        devices: DeviceServiceClient::new(channel.clone()),
        scenes: SceneServiceClient::new(channel),
    })
}
