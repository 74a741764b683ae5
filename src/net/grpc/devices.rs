//! DeviceService: what a device is and does, and its switch.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status};

use super::{blocking, convert, field_status, names};
use crate::actuation::ActuatorKind;
use crate::config::Id;
use crate::control::ModeCommand;
use crate::host::DeviceHost;
use crate::proto::device_service_server::DeviceService;
use crate::proto::{
    self, ActuatorDescription, ClearFaultRequest, Device, DeviceDescription, DeviceMode,
    DeviceState, DisableRequest, EnableRequest, GetDescriptionRequest, GetStateRequest,
    ListDevicesRequest, ListDevicesResponse, StopRequest, WatchStateRequest,
};
use crate::units::FieldError;

/// The longest pause between two watched states.
const MAX_INTERVAL_MS: u32 = 10_000;

/// The pause when none is asked for.
const DEFAULT_INTERVAL_MS: u32 = 100;

/// States that may wait for a slow reader before it is skipped.
const WAITING_STATES: usize = 4;

/// The service.
pub struct Devices {
    pub host: Arc<DeviceHost>,
}

impl Devices {
    async fn change(
        &self,
        name: &str,
        command: ModeCommand,
    ) -> Result<Response<DeviceMode>, Status> {
        names::expect_device(&self.host, "name", name)?;
        let host = Arc::clone(&self.host);
        let mode = blocking(move || host.change_mode(command)).await?;
        tracing::info!(?command, ?mode, "mode");
        let name = names::device(&self.host);
        Ok(Response::new(DeviceMode { name, mode: proto::Mode::from(mode).into() }))
    }
}

#[tonic::async_trait]
impl DeviceService for Devices {
    async fn list_devices(
        &self,
        _: Request<ListDevicesRequest>,
    ) -> Result<Response<ListDevicesResponse>, Status> {
        let device = Device {
            name: names::device(&self.host),
            mechanism: self.host.definition().mechanism.name().to_owned(),
            simulated: true,
            mode: proto::Mode::from(self.host.report().mode).into(),
        };
        Ok(Response::new(ListDevicesResponse { devices: vec![device] }))
    }

    async fn get_description(
        &self,
        request: Request<GetDescriptionRequest>,
    ) -> Result<Response<DeviceDescription>, Status> {
        names::expect_device(&self.host, "name", &request.get_ref().name)?;
        Ok(Response::new(describe(&self.host)))
    }

    async fn get_state(
        &self,
        request: Request<GetStateRequest>,
    ) -> Result<Response<DeviceState>, Status> {
        names::expect_device(&self.host, "name", &request.get_ref().name)?;
        Ok(Response::new(convert::state_to_proto(&self.host, &self.host.report())))
    }

    type WatchStateStream = ReceiverStream<Result<DeviceState, Status>>;

    async fn watch_state(
        &self,
        request: Request<WatchStateRequest>,
    ) -> Result<Response<Self::WatchStateStream>, Status> {
        let WatchStateRequest { name, interval_ms } = request.into_inner();
        names::expect_device(&self.host, "name", &name)?;
        if interval_ms > MAX_INTERVAL_MS {
            let allowed =
                format!("must be 1 to {MAX_INTERVAL_MS} ms, or 0 for {DEFAULT_INTERVAL_MS}");
            return Err(field_status(&FieldError::new("interval_ms", interval_ms, allowed)));
        }
        let interval_ms = if interval_ms == 0 { DEFAULT_INTERVAL_MS } else { interval_ms };
        let (states, watched) = mpsc::channel(WAITING_STATES);
        let host = Arc::clone(&self.host);
        tokio::spawn(async move {
            let mut interval = tokio::time::interval(Duration::from_millis(interval_ms.into()));
            interval.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
            loop {
                tokio::select! {
                    _ = interval.tick() => {}
                    () = states.closed() => return,
                }
                // A slow reader misses states; it never makes old ones pile up.
                let _ = states.try_send(Ok(convert::state_to_proto(&host, &host.report())));
            }
        });
        Ok(Response::new(ReceiverStream::new(watched)))
    }

    async fn enable(
        &self,
        request: Request<EnableRequest>,
    ) -> Result<Response<DeviceMode>, Status> {
        self.change(&request.get_ref().name, ModeCommand::Enable).await
    }

    async fn disable(
        &self,
        request: Request<DisableRequest>,
    ) -> Result<Response<DeviceMode>, Status> {
        self.change(&request.get_ref().name, ModeCommand::Disable).await
    }

    async fn stop(&self, request: Request<StopRequest>) -> Result<Response<DeviceMode>, Status> {
        self.change(&request.get_ref().name, ModeCommand::Stop).await
    }

    async fn clear_fault(
        &self,
        request: Request<ClearFaultRequest>,
    ) -> Result<Response<DeviceMode>, Status> {
        self.change(&request.get_ref().name, ModeCommand::ClearFault).await
    }
}

fn describe(host: &DeviceHost) -> DeviceDescription {
    let device = host.definition();
    let (min_radius_m, max_radius_m) = device.mechanism.reach_m();
    let freedoms = device.mechanism.freedoms() as u32;
    let actuator = |(i, name): (usize, &Id)| ActuatorDescription {
        name: name.to_string(),
        kind: match device.actuators.kinds[i] {
            ActuatorKind::Brake => proto::ActuatorKind::Brake.into(),
            ActuatorKind::Motor => proto::ActuatorKind::Motor.into(),
        },
        max_torque_nm: device.actuators.max_torque_Nm[i],
        lag_s: device.lag_s[i],
        counts_per_revolution: device.actuators.counts_per_revolution[i],
    };
    DeviceDescription {
        name: names::device(host),
        mechanism: device.mechanism.name().to_owned(),
        simulated: true,
        sensed_freedoms: freedoms,
        actuated_freedoms: freedoms,
        actuators: device.actuator_names.iter().enumerate().map(actuator).collect(),
        tick_period_s: device.tick_ns as f64 * 1e-9,
        hand_force_sensor: device.force_sensor.is_some(),
        force_limit_n: device.guards.force_limit_N,
        workspace_min_radius_m: min_radius_m,
        workspace_max_radius_m: max_radius_m,
        mount: convert::pose(&device.mount.p_WB_m, &device.mount.q_WB),
        parameters: device.parameters.iter().cloned().collect(),
        handle_mass_kg: device.handle_mass_kg,
    }
}
