//! `hapticd ctl`: describe, watch and switch a running device, and edit its scene.

use anyhow::bail;
use clap::{Args, Subcommand};
use serde_json::{Value, json};

use super::target::Target;
use super::{
    events, format, hand, manipulability, object, recording, scene_file, sessions, settings, wall,
};
use crate::client::{Services, told};
use crate::proto::{
    ActuatorKind, ActuatorState, ClearFaultRequest, ContactState, DeviceDescription, DeviceMode,
    DeviceState, DisableRequest, EnableRequest, Fault, GetDescriptionRequest, GetStateRequest,
    HomeRequest, Homing, StopRequest, Vector3, WatchStateRequest,
};

/// Talk to the services of a running server.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd ctl describe
  hapticd ctl state --watch
  hapticd ctl stop
  hapticd ctl wall add table --point 0,0.4,0 --normal=0,-1,0 --stiffness 5000
  hapticd ctl object add ball sphere --centre 0,0.3,0 --radius 0.02 --friction 0.3
  hapticd ctl scene show")]
pub struct Ctl {
    #[command(flatten)]
    target: Target,
    /// Print JSON
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// What the device is
    #[command(after_help = "Examples:
  hapticd ctl describe
  hapticd ctl describe --json")]
    Describe,
    /// What it senses and does
    #[command(after_help = "Examples:
  hapticd ctl state
  hapticd ctl state --watch --interval 50")]
    State {
        /// Again and again, until Ctrl-C
        #[arg(long)]
        watch: bool,
        /// Milliseconds between two lines
        #[arg(long, value_name = "MS", default_value_t = 200)]
        interval: u32,
    },
    /// Say that the handle is at its home place (incremental encoders)
    #[command(after_help = "Example:
  hapticd ctl home")]
    Home,
    /// Begin to render forces
    #[command(after_help = "Example:
  hapticd ctl enable")]
    Enable,
    /// Release everything
    #[command(after_help = "Example:
  hapticd ctl disable")]
    Disable,
    /// Stop now; leave with `disable`
    #[command(after_help = "Example:
  hapticd ctl stop")]
    Stop,
    /// Leave a fault, once its cause is gone
    #[command(after_help = "Example:
  hapticd ctl clear-fault")]
    ClearFault,
    /// What may be changed while it runs
    #[command(after_help = "Examples:
  hapticd ctl settings
  hapticd ctl settings --json")]
    Settings,
    Devices(events::ListDevices),
    Events(events::Events),
    Manipulability(manipulability::ShowManipulability),
    Set(settings::Set),
    Strategy(settings::ChooseStrategy),
    Object(Box<object::ObjectCommand>),
    Scene(scene_file::SceneCommand),
    Wall(wall::WallCommand),
    #[command(subcommand)]
    Session(sessions::SessionCommand),
    #[command(subcommand)]
    Lease(sessions::LeaseCommand),
    #[command(subcommand)]
    Recording(recording::RecordingCommand),
    Hand(hand::Hand),
}

impl Ctl {
    /// Does it and prints the answer.
    pub fn run(self) -> anyhow::Result<()> {
        super::runtime()?.block_on(self.act())
    }

    async fn act(self) -> anyhow::Result<()> {
        let Self { target, action, json } = self;
        let action = match action {
            // These are about all devices, unless one is named.
            Action::Devices(list) => {
                return list.run(&mut target.services().await?.devices, json).await;
            }
            Action::Session(command) => {
                let sessions = &mut target.services().await?.sessions;
                return command.run(sessions, target.device(), json).await;
            }
            Action::Lease(command) => {
                return command.run(&mut target.services().await?.sessions, json).await;
            }
            Action::Recording(command) => {
                return command.run(&mut target.services().await?.recordings, json).await;
            }
            action => action,
        };
        let (mut services, name) = target.open().await?;
        let devices = &mut services.devices;
        let mode = match action {
            // Answered above.
            Action::Devices(_) | Action::Session(_) | Action::Lease(_) | Action::Recording(_) => {
                return Ok(());
            }
            Action::Describe => {
                let description = devices.get_description(GetDescriptionRequest { name }).await;
                print_description(&description.map_err(plain)?.into_inner(), json);
                return Ok(());
            }
            Action::State { watch: false, .. } => {
                let state = devices.get_state(GetStateRequest { name }).await.map_err(plain)?;
                print_state(&state.into_inner(), json);
                return Ok(());
            }
            Action::State { watch: true, interval } => {
                return watch(&mut services, name, interval, json).await;
            }
            Action::Object(command) => {
                return command.run(&mut services.scenes, &name, json).await;
            }
            Action::Scene(command) => {
                return command.run(&mut services.scenes, &name, json).await;
            }
            Action::Settings => return settings::show(devices, name, json).await,
            Action::Manipulability(show) => return show.run(devices, name, json).await,
            Action::Events(events) => return events.run(devices, name, json).await,
            Action::Set(set) => return set.run(devices, name, json).await,
            Action::Strategy(strategy) => return strategy.run(devices, name, json).await,
            Action::Home => {
                let state = devices.home(HomeRequest { name }).await.map_err(plain)?;
                print_state(&state.into_inner(), json);
                return Ok(());
            }
            Action::Hand(hand) => return hand.run(&target.connect, &name).await,
            Action::Wall(command) => {
                return command.run(&mut services.scenes, &name, json).await;
            }
            Action::Enable => devices.enable(EnableRequest { name }).await,
            Action::Disable => devices.disable(DisableRequest { name }).await,
            Action::Stop => devices.stop(StopRequest { name }).await,
            Action::ClearFault => devices.clear_fault(ClearFaultRequest { name }).await,
        };
        print_mode(&mode.map_err(plain)?.into_inner(), json);
        Ok(())
    }
}

/// A refusal in the server's own words, or that there were none.
pub fn plain(status: tonic::Status) -> anyhow::Error {
    anyhow::anyhow!(told(&status))
}

fn print_mode(mode: &DeviceMode, as_json: bool) {
    let word = format::mode(mode.mode());
    if as_json {
        say!("{}", json!({ "name": mode.name, "mode": word }));
    } else {
        say!("{}: {word}", mode.name);
    }
}

async fn watch(
    services: &mut Services,
    name: String,
    interval_ms: u32,
    as_json: bool,
) -> anyhow::Result<()> {
    let request = WatchStateRequest { name, interval_ms };
    let mut states = services.devices.watch_state(request).await.map_err(plain)?.into_inner();
    loop {
        tokio::select! {
            state = states.message() => match state.map_err(plain)? {
                Some(state) if as_json => say!("{}", state_json(&state)),
                Some(state) => say!("{}", state_line(&state)),
                None => bail!("the server ended"),
            },
            signal = tokio::signal::ctrl_c() => return Ok(signal?),
        }
    }
}

fn print_description(description: &DeviceDescription, as_json: bool) {
    let kind = |kind: ActuatorKind| format::word(kind.as_str_name(), "ACTUATOR_KIND_");
    if as_json {
        let actuators: Vec<Value> = description
            .actuators
            .iter()
            .map(|a| json!({ "name": a.name, "kind": kind(a.kind()), "max_torque_nm": a.max_torque_nm, "lag_s": a.lag_s, "counts_per_revolution": a.counts_per_revolution }))
            .collect();
        let outlines: Vec<Vec<[f64; 2]>> = description
            .workspace
            .iter()
            .map(|curve| curve.x_m.iter().zip(&curve.y_m).map(|(x, y)| [*x, *y]).collect())
            .collect();
        let parameters: serde_json::Map<_, _> =
            description.parameters.iter().map(|(k, v)| (k.clone(), json!(v))).collect();
        say!(
            "{}",
            json!({
                "name": description.name,
                "mechanism": description.mechanism,
                "simulated": description.simulated,
                "actuated_freedoms": description.actuated_freedoms,
                "tick_period_s": description.tick_period_s,
                "hand_force_sensor": description.hand_force_sensor,
                "force_limit_n": description.force_limit_n,
                "workspace_radius_m": [description.workspace_min_radius_m, description.workspace_max_radius_m],
                "handle_mass_kg": description.handle_mass_kg,
                "home_m": description.home_m.as_ref().map(|home| [home.x, home.y]),
                "workspace_outlines_m": outlines,
                "actuators": actuators,
                "parameters": parameters,
            })
        );
        return;
    }
    let simulated = if description.simulated { ", simulated" } else { "" };
    let sensor = if description.hand_force_sensor { "with" } else { "without" };
    say!(
        "{} ({}{simulated}), {} freedoms",
        description.name,
        description.mechanism,
        description.actuated_freedoms
    );
    say!(
        "  tick {:.3} ms, {sensor} a force sensor, requests up to {} N",
        description.tick_period_s * 1e3,
        description.force_limit_n
    );
    say!(
        "  reaches {:.3} to {:.3} m, {} kg at the handle",
        description.workspace_min_radius_m,
        description.workspace_max_radius_m,
        description.handle_mass_kg
    );
    if let Some(home) = &description.home_m {
        say!("  incremental encoders, to be homed at ({}, {}) m of its plane", home.x, home.y);
    }
    for actuator in &description.actuators {
        say!(
            "  {}: {}, {} N m, lag {} ms, {} counts",
            actuator.name,
            kind(actuator.kind()),
            actuator.max_torque_nm,
            actuator.lag_s * 1e3,
            actuator.counts_per_revolution
        );
    }
    let mut parameters: Vec<_> = description.parameters.iter().collect();
    parameters.sort_by(|a, b| a.0.cmp(b.0));
    for (name, value) in parameters {
        say!("  {name} = {value}");
    }
}

fn array(v: Option<&Vector3>) -> Value {
    v.map_or(Value::Null, |v| json!([v.x, v.y, v.z]))
}

fn state_json(state: &DeviceState) -> Value {
    let force = |wrench: &Option<crate::proto::Wrench>| {
        array(wrench.as_ref().and_then(|w| w.force_n.as_ref()))
    };
    let contact = |c: &ContactState| json!({ "name": c.name, "depth_m": c.depth_m, "normal_n": c.normal_n, "friction_n": c.friction_n });
    let actuator = |a: &ActuatorState| json!({ "name": a.name, "angle_rad": a.angle_rad, "rate_rad_per_s": a.rate_rad_per_s, "lower_nm": a.lower_nm, "upper_nm": a.upper_nm, "commanded_nm": a.commanded_nm });
    json!({
        "name": state.name,
        "mode": format::mode(state.mode()),
        "fault": (state.fault() != Fault::Unspecified).then(|| format::word(state.fault().as_str_name(), "FAULT_")),
        "tick": state.tick,
        "homing": format::word(state.homing().as_str_name(), "HOMING_"),
        "position_m": array(state.measured_cp.as_ref().and_then(|pose| pose.position_m.as_ref())),
        "velocity_m_per_s": array(state.measured_cv.as_ref().and_then(|twist| twist.linear_m_per_s.as_ref())),
        "hand_force_n": force(&state.measured_cf),
        "requested_n": force(&state.requested),
        "achievable_n": force(&state.achievable),
        "rendered_n": force(&state.rendered),
        "region": format::word(state.region().as_str_name(), "REGION_"),
        "approximation_angle_rad": state.approximation_angle_rad,
        "stuck": state.stuck,
        "limits": state.limits().map(|limit| format::word(limit.as_str_name(), "LIMIT_")).collect::<Vec<_>>(),
        "law": format::law(state.law()),
        "scene_revision": state.scene_revision,
        "contacts": state.contacts.iter().map(contact).collect::<Vec<_>>(),
        "actuators": state.actuators.iter().map(actuator).collect::<Vec<_>>(),
    })
}

fn state_line(state: &DeviceState) -> String {
    let position = state.measured_cp.as_ref().and_then(|pose| pose.position_m.as_ref());
    let force = |wrench: &Option<crate::proto::Wrench>| {
        let force = wrench.as_ref().and_then(|wrench| wrench.force_n.as_ref());
        force.map_or("?".to_owned(), |force| format!("{:.1}", format::norm(force)))
    };
    format!(
        "{} at {} m  asked {} N, chosen {} N, felt {} N  {}{}",
        format::mode(state.mode()),
        format::vector(position, 4),
        force(&state.requested),
        force(&state.achievable),
        force(&state.rendered),
        format::law(state.law()),
        if state.stuck { "  STUCK" } else { "" },
    )
}

fn print_state(state: &DeviceState, as_json: bool) {
    if as_json {
        say!("{}", state_json(state));
        return;
    }
    let force = |wrench: &Option<crate::proto::Wrench>| {
        format::vector(wrench.as_ref().and_then(|wrench| wrench.force_n.as_ref()), 2)
    };
    say!("{}: {}, tick {}", state.name, format::mode(state.mode()), state.tick);
    if state.fault() != Fault::Unspecified {
        say!("  fault       {}", format::word(state.fault().as_str_name(), "FAULT_"));
    }
    if state.homing() == Homing::Needed {
        say!("  homing      needed: the place below means nothing before `hapticd ctl home`");
    }
    say!(
        "  position    {} m",
        format::vector(state.measured_cp.as_ref().and_then(|pose| pose.position_m.as_ref()), 4)
    );
    say!(
        "  velocity    {} m/s",
        format::vector(
            state.measured_cv.as_ref().and_then(|twist| twist.linear_m_per_s.as_ref()),
            3
        )
    );
    say!("  hand        {} N", force(&state.measured_cf));
    say!("  requested   {} N", force(&state.requested));
    say!("  achievable  {} N", force(&state.achievable));
    say!(
        "  rendered    {} N ({})",
        force(&state.rendered),
        format::word(state.rendered_source().as_str_name(), "RENDERED_SOURCE_")
    );
    say!("  region      {}", format::region(state.region()));
    if let Some(angle_rad) = state.approximation_angle_rad {
        say!("  approx.     {:.1} deg from what was asked", angle_rad.to_degrees());
    }
    say!("  law         {}{}", format::law(state.law()), if state.stuck { ", stuck" } else { "" });
    say!("  limits      {}", format::limits(state.limits()));
    say!("  scene       revision {}", state.scene_revision);
    for contact in &state.contacts {
        say!(
            "  touching    {}: {:.3} mm deep, {:.1} N",
            contact.name,
            contact.depth_m * 1e3,
            contact.normal_n
        );
    }
    for actuator in &state.actuators {
        say!(
            "  {:<11} {:.3} N m of [{:.1}, {:.1}], {:.3} rad/s",
            actuator.name,
            actuator.commanded_nm,
            actuator.lower_nm,
            actuator.upper_nm,
            actuator.rate_rad_per_s
        );
    }
}
