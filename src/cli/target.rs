//! Which server and which device a command talks to.

use anyhow::{Context, bail, ensure};
use clap::Args;

use super::ctl::plain;
use super::format::device_resource;
use crate::client::{ConnectString, DEFAULT_GRPC_PORT, DEFAULT_STREAM_PORT, Services, services};
use crate::proto::ListDevicesRequest;

/// Arguments that say so.
#[derive(Debug, Args)]
pub struct Target {
    /// Where the server is: the line that `serve` prints, or HOST:PORT of its stream
    #[arg(long, global = true, value_name = "STRING", default_value = "127.0.0.1:7351")]
    pub connect: ConnectString,
    /// Which device, where there are several
    #[arg(long, global = true, value_name = "NAME")]
    device: Option<String>,
}

impl Target {
    /// Its services, and the resource name of the device.
    pub async fn open(&self) -> anyhow::Result<(Services, String)> {
        let mut services = self.services().await?;
        let name = device_name(&mut services, self.device.as_deref()).await?;
        Ok((services, name))
    }

    /// The resource name of the device that was named; empty for none.
    pub fn device(&self) -> String {
        device_resource(self.device.as_deref())
    }

    /// Its services, for commands that are about all devices.
    pub async fn services(&self) -> anyhow::Result<Services> {
        let target = &self.connect;
        let elsewhere =
            target.stream_port != DEFAULT_STREAM_PORT && target.grpc_port == DEFAULT_GRPC_PORT;
        ensure!(
            !elsewhere || target.sha256.is_some(),
            "{target} does not say where the services are: use the whole connect string that `serve` prints (with grpc=PORT)"
        );
        services(target).await.with_context(|| {
            let authority = target.grpc_authority();
            format!("cannot reach the services at {authority}; is `hapticd serve` running? On another gRPC port, use the whole connect string")
        })
    }
}

async fn device_name(services: &mut Services, wanted: Option<&str>) -> anyhow::Result<String> {
    if wanted.is_some() {
        return Ok(device_resource(wanted));
    }
    let devices = services.devices.list_devices(ListDevicesRequest {}).await.map_err(plain)?;
    let mut names: Vec<_> = devices.into_inner().devices.into_iter().map(|d| d.name).collect();
    match (names.pop(), names.as_slice()) {
        (Some(only), []) => Ok(only),
        (None, _) => bail!("the server has no device"),
        (Some(last), others) => bail!(
            "the server has several devices, say which with --device: {}, {last}",
            others.join(", ")
        ),
    }
}
