//! Where calls for one device wait their turn.
//!
//! What blocks or takes long goes through a [`Lane`]: scene edits, which wait for the disk,
//! through one; settings, explanations and changes of mode through others; and Stop through one
//! of its own, so that nothing that anybody else has asked for can keep it waiting. Each device
//! has its own.

use std::sync::Arc;

use tokio::sync::{Mutex, watch};
use tonic::Status;

use super::host_status;
use crate::config::Scene;
use crate::host::{DeviceHost, HostError, Hosts};

/// All devices of a server.
pub type Desks = Arc<[Desk]>;

/// The desks of these devices.
pub fn desks(hosts: &Hosts) -> Desks {
    hosts.iter().map(|host| Desk::new(Arc::clone(host))).collect()
}

/// One device and its lanes.
pub struct Desk {
    /// The device.
    pub host: Arc<DeviceHost>,
    /// For what waits for the disk.
    pub edits: Lane,
    /// For settings.
    pub settings: Lane,
    /// For what takes milliseconds of thought: explanations.
    pub looks: Lane,
    /// For changes of mode.
    pub modes: Lane,
    /// For Stop alone.
    pub stops: Lane,
    /// The newest scene in force, for those who watch.
    pub newest_scene: Arc<watch::Sender<Arc<Scene>>>,
}

impl Desk {
    fn new(host: Arc<DeviceHost>) -> Self {
        let newest_scene = Arc::new(watch::Sender::new(host.scene()));
        let [edits, settings, looks, modes, stops] = std::array::from_fn(|_| Lane::default());
        Self { host, edits, settings, looks, modes, stops, newest_scene }
    }
}

/// Work that blocks for milliseconds: one piece after the other, each on a thread where that
/// is allowed. Whoever waits here holds no thread, and leaves the queue with its client.
#[derive(Clone, Default)]
pub struct Lane(Arc<Mutex<()>>);

impl Lane {
    /// Does it when its turn has come.
    pub async fn run<T: Send + 'static>(
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
