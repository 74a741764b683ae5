//! DeviceService: what a device is and does, and its switch.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep};
use tonic::{Request, Response, Status};

use super::desk::{Desk, Desks};
use super::guard::Asker;
use super::places::Places;
use super::{convert, explain, field_status, manipulability, names, settings, watches};
use crate::actuation::ActuatorKind;
use crate::analysis::workspace;
use crate::audit::What;
use crate::config::{DeviceDefinition, Id, Settings};
use crate::control::{ModeCommand, Report};
use crate::host::DeviceHost;
use crate::mechanism::Mechanism;
use crate::net::SessionDesk;
use crate::proto::device_service_server::DeviceService;
use crate::proto::{
    self, ActuatorDescription, ClearFaultRequest, Device, DeviceDescription, DeviceMode,
    DeviceState, DisableRequest, EnableRequest, GetDescriptionRequest, GetStateRequest,
    ListDevicesRequest, ListDevicesResponse, StopRequest, WatchStateRequest, WorkspaceOutline,
};
use crate::units::FieldError;

/// The longest pause between two watched states.
const MAX_INTERVAL_MS: u32 = 10_000;

/// The pause when none is asked for.
const DEFAULT_INTERVAL_MS: u32 = 100;

/// States that may wait for a slow reader before it is skipped.
const WAITING_STATES: usize = 4;

/// Reports come a few milliseconds after their tick; one that stays away so long does not come.
const NO_REPORT: Duration = Duration::from_millis(250);

/// Between two looks for a report.
const PAUSE: Duration = Duration::from_millis(1);

/// The service.
pub struct Devices {
    desks: Desks,
    sessions: SessionDesk,
    http_port: u16,
    watches: Places,
    stopped: watch::Receiver<bool>,
}

impl Devices {
    /// Of these devices; watches end when `stopped` is true or its sender gone.
    pub fn new(
        desks: Desks,
        sessions: SessionDesk,
        http_port: u16,
        stopped: watch::Receiver<bool>,
    ) -> Self {
        let watches = Places::new("watches of devices", watches::MOST);
        Self { desks, sessions, http_port, watches, stopped }
    }

    fn find(&self, asker: &Asker, name: &str) -> Result<&Desk, Status> {
        names::find_device(&self.desks, asker, "name", name)
    }

    /// A place among the watches.
    fn watch(
        &self,
        asker: Asker,
        device: &str,
        unfinished: Option<&'static str>,
    ) -> Result<watches::Watch, Status> {
        let place = self.watches.take(&asker)?;
        let (stopped, device) = (self.stopped.clone(), device.to_owned());
        Ok(watches::Watch { _place: place, stopped, asker, device, unfinished })
    }

    async fn change(
        &self,
        asker: &Asker,
        name: &str,
        command: ModeCommand,
    ) -> Result<Response<DeviceMode>, Status> {
        let Desk { host, modes, stops, .. } = self.find(asker, name)?;
        let lane = if command == ModeCommand::Stop { stops } else { modes };
        let (changed, name, asker) = (Arc::clone(host), names::device(host), asker.clone());
        let mode = lane.run(move || {
            let mode = changed.change_mode(command)?;
            let name = names::device(&changed);
            tracing::info!(name, ?command, ?mode, "mode");
            // Here: told even if nobody waits for the answer.
            asker.did(deed(command), &name, "");
            Ok(mode)
        });
        let mode = mode.await?;
        Ok(Response::new(DeviceMode { name, mode: proto::Mode::from(mode).into() }))
    }
}

fn deed(command: ModeCommand) -> What {
    match command {
        ModeCommand::Enable => What::Enabled,
        ModeCommand::Disable => What::Disabled,
        ModeCommand::Stop => What::Stopped,
        ModeCommand::ClearFault => What::FaultCleared,
    }
}

/// The newest report, never one from before something that was acknowledged, unless the loop
/// has stopped reporting.
pub(super) async fn report(host: &DeviceHost) -> Report {
    let deadline = Instant::now() + NO_REPORT;
    loop {
        let report = host.report();
        if host.is_current(&report) || Instant::now() >= deadline {
            return report;
        }
        sleep(PAUSE).await;
    }
}

#[tonic::async_trait]
impl DeviceService for Devices {
    async fn list_devices(
        &self,
        request: Request<ListDevicesRequest>,
    ) -> Result<Response<ListDevicesResponse>, Status> {
        let asker = Asker::of(request.extensions())?;
        let mut devices = Vec::new();
        let seen = |desk: &&Desk| asker.sees(&names::device(&desk.host));
        for Desk { host, .. } in self.desks.iter().filter(seen) {
            devices.push(listed(host, &report(host).await));
        }
        let http_port = self.http_port.into();
        Ok(Response::new(ListDevicesResponse { devices, http_port }))
    }

    type WatchDevicesStream = watches::Answers<ListDevicesResponse>;

    async fn watch_devices(
        &self,
        request: Request<proto::WatchDevicesRequest>,
    ) -> Result<Response<Self::WatchDevicesStream>, Status> {
        let asker = Asker::of(request.extensions())?;
        // What it holds for as long as it lists: one that is bound to a device, for that.
        let device = asker.own_device();
        let watch = self.watch(asker.clone(), &device, None)?;
        // The first list is of what is, not of what was before the first tick.
        for desk in self.desks.iter() {
            report(&desk.host).await;
        }
        let (desks, http_port) = (Arc::clone(&self.desks), self.http_port.into());
        let list = move || {
            let seen = |desk: &&Desk| asker.sees(&names::device(&desk.host));
            let seen = desks.iter().filter(seen);
            let devices = seen.map(|desk| listed(&desk.host, &desk.host.report()));
            ListDevicesResponse { devices: devices.collect(), http_port }
        };
        Ok(Response::new(watches::devices(list, watch)))
    }

    type WatchEventsStream = watches::Answers<proto::DeviceEvent>;

    async fn watch_events(
        &self,
        request: Request<proto::WatchEventsRequest>,
    ) -> Result<Response<Self::WatchEventsStream>, Status> {
        let asker = Asker::of(request.extensions())?;
        let request = request.into_inner();
        let host = Arc::clone(&self.find(&asker, &request.name)?.host);
        let unfinished = request.only_past.then_some("the server ends, and more had happened");
        let watch = self.watch(asker, &request.name, unfinished)?;
        Ok(Response::new(watches::events(host, &request, watch)?))
    }

    async fn get_description(
        &self,
        request: Request<GetDescriptionRequest>,
    ) -> Result<Response<DeviceDescription>, Status> {
        Ok(Response::new(describe(
            &self.find(&Asker::of(request.extensions())?, &request.get_ref().name)?.host,
        )))
    }

    async fn get_state(
        &self,
        request: Request<GetStateRequest>,
    ) -> Result<Response<DeviceState>, Status> {
        let Desk { host, .. } =
            self.find(&Asker::of(request.extensions())?, &request.get_ref().name)?;
        Ok(Response::new(convert::state_to_proto(host, &report(host).await)))
    }

    type WatchStateStream = watches::Answers<DeviceState>;

    async fn watch_state(
        &self,
        request: Request<WatchStateRequest>,
    ) -> Result<Response<Self::WatchStateStream>, Status> {
        let asker = Asker::of(request.extensions())?;
        let WatchStateRequest { name, interval_ms } = request.into_inner();
        let host = Arc::clone(&self.find(&asker, &name)?.host);
        if interval_ms > MAX_INTERVAL_MS {
            let allowed =
                format!("must be 1 to {MAX_INTERVAL_MS} ms, or 0 for {DEFAULT_INTERVAL_MS}");
            return Err(field_status(&FieldError::new("interval_ms", interval_ms, allowed)));
        }
        let interval_ms = if interval_ms == 0 { DEFAULT_INTERVAL_MS } else { interval_ms };
        let watch = self.watch(asker, &name, None)?;
        let tell = move |teller: watches::Teller<_>| async move {
            let mut interval = interval(Duration::from_millis(interval_ms.into()));
            interval.set_missed_tick_behavior(MissedTickBehavior::Delay);
            loop {
                interval.tick().await;
                // A slow reader misses states; it never makes old ones pile up.
                let state = convert::state_to_proto(&host, &report(&host).await);
                let _ = teller.try_send(Ok(state));
            }
        };
        Ok(Response::new(watches::answers(WAITING_STATES, watch, tell)))
    }

    async fn get_settings(
        &self,
        request: Request<proto::GetSettingsRequest>,
    ) -> Result<Response<proto::Settings>, Status> {
        Ok(Response::new(settings::get(
            &self.find(&Asker::of(request.extensions())?, &request.get_ref().name)?.host,
        )))
    }

    async fn update_settings(
        &self,
        request: Request<proto::UpdateSettingsRequest>,
    ) -> Result<Response<proto::Settings>, Status> {
        let asker = Asker::of(request.extensions())?;
        let request = request.into_inner();
        let name = request.settings.as_ref().map_or("", |settings| &settings.name);
        let desk = names::find_device(&self.desks, &asker, "settings.name", name)?;
        let changed = settings::update(desk, asker, request).await?;
        let Settings { mount, tool, .. } = desk.host.settings().settings;
        let DeviceDefinition { name, mount: first, tool: with, .. } = desk.host.definition();
        if (mount, tool) != (*first, *with) {
            let name = name.to_string();
            self.sessions.ask(move |sessions, _| sessions.propose_nothing(&name)).await;
        }
        Ok(Response::new(changed))
    }

    async fn explain(
        &self,
        request: Request<proto::ExplainRequest>,
    ) -> Result<Response<proto::Explanation>, Status> {
        let asker = Asker::of(request.extensions())?;
        let request = request.into_inner();
        let desk = self.find(&asker, &request.name)?;
        let device = names::device(&desk.host);
        let who = explain::who(&self.sessions, device, &request.session).await?;
        Ok(Response::new(explain::of_last_tick(desk, &request, who).await?))
    }

    async fn get_manipulability(
        &self,
        request: Request<proto::GetManipulabilityRequest>,
    ) -> Result<Response<proto::Manipulability>, Status> {
        let desk = self.find(&Asker::of(request.extensions())?, &request.get_ref().name)?;
        Ok(Response::new(manipulability::get(desk, request.get_ref()).await?))
    }

    async fn home(
        &self,
        request: Request<proto::HomeRequest>,
    ) -> Result<Response<DeviceState>, Status> {
        let asker = Asker::of(request.extensions())?;
        let Desk { host, modes, .. } = self.find(&asker, &request.get_ref().name)?;
        let homed = Arc::clone(host);
        let home = move || {
            homed.home()?;
            tracing::info!(name = names::device(&homed), "homed");
            asker.did(What::Homed, &names::device(&homed), "");
            Ok(())
        };
        modes.run(home).await?;
        Ok(Response::new(convert::state_to_proto(host, &report(host).await)))
    }

    async fn enable(
        &self,
        request: Request<EnableRequest>,
    ) -> Result<Response<DeviceMode>, Status> {
        self.change(&Asker::of(request.extensions())?, &request.get_ref().name, ModeCommand::Enable)
            .await
    }

    async fn disable(
        &self,
        request: Request<DisableRequest>,
    ) -> Result<Response<DeviceMode>, Status> {
        self.change(
            &Asker::of(request.extensions())?,
            &request.get_ref().name,
            ModeCommand::Disable,
        )
        .await
    }

    async fn stop(&self, request: Request<StopRequest>) -> Result<Response<DeviceMode>, Status> {
        self.change(&Asker::of(request.extensions())?, &request.get_ref().name, ModeCommand::Stop)
            .await
    }

    async fn clear_fault(
        &self,
        request: Request<ClearFaultRequest>,
    ) -> Result<Response<DeviceMode>, Status> {
        self.change(
            &Asker::of(request.extensions())?,
            &request.get_ref().name,
            ModeCommand::ClearFault,
        )
        .await
    }
}

fn listed(host: &DeviceHost, report: &Report) -> Device {
    Device {
        name: names::device(host),
        mechanism: host.definition().mechanism.name().to_owned(),
        simulated: true,
        mode: proto::Mode::from(report.mode).into(),
    }
}

/// Cells to a side of the grid behind the outlines: enough for a picture.
const OUTLINE_CELLS: usize = 48;

fn outlines(mechanism: &dyn Mechanism) -> Vec<WorkspaceOutline> {
    let curves = workspace::outlines(mechanism, 0.0, OUTLINE_CELLS);
    let split = |curve: workspace::Curve| {
        let (x_m, y_m) = curve.into_iter().map(|[x, y]| (x, y)).unzip();
        WorkspaceOutline { x_m, y_m }
    };
    curves.into_iter().map(split).collect()
}

fn describe(host: &DeviceHost) -> DeviceDescription {
    let device = host.definition();
    let Settings { guards, mount, .. } = host.settings().settings;
    let (min_radius_m, max_radius_m) = device.mechanism.reach_m();
    let freedoms = device.mechanism.freedoms() as u32;
    let actuator = |(i, name): (usize, &Id)| ActuatorDescription {
        name: name.to_string(),
        kind: match device.actuators.kinds[i] {
            ActuatorKind::Brake => proto::ActuatorKind::Brake.into(),
            ActuatorKind::Motor => proto::ActuatorKind::Motor.into(),
        },
        max_torque_nm: device.actuators.max_torque_Nm[i],
        lag_s: device.actuators.lag_s[i],
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
        force_limit_n: guards.force_limit_N,
        workspace_min_radius_m: min_radius_m,
        workspace_max_radius_m: max_radius_m,
        mount: convert::pose(&mount.p_WB_m, &mount.q_WB),
        parameters: device.parameters.iter().cloned().collect(),
        handle_mass_kg: device.handle_mass_kg,
        workspace: outlines(device.mechanism.as_ref()),
        home_m: device.home_m.map(|[x, y]| proto::Vector3 { x, y, z: 0.0 }),
    }
}
