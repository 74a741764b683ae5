//! `hapticd ctl events` and `ctl devices`: what happens and what there is, as it changes.

use clap::Args;
use serde_json::{Value, json};

use super::ctl::plain;
use super::format;
use crate::client::Devices;
use crate::proto::{
    Device, DeviceEvent, EventKind, ListDevicesRequest, WatchDevicesRequest, WatchEventsRequest,
};

/// What happened on the device: contacts, modes, faults, commands that ran out
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd ctl events
  hapticd ctl events --watch --json
  hapticd ctl events --after 120 --watch")]
pub struct Events {
    /// Go on with what happens, until Ctrl-C
    #[arg(long)]
    watch: bool,
    /// Begin after this event; without it, with the oldest kept, or with --watch from now on
    #[arg(long, value_name = "ID")]
    after: Option<u64>,
}

/// The devices of the server with their modes
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd ctl devices
  hapticd ctl devices --watch")]
pub struct ListDevices {
    /// Again whenever one changes, until Ctrl-C
    #[arg(long)]
    watch: bool,
}

impl Events {
    /// Prints them one by one.
    pub async fn run(
        self,
        devices: &mut Devices,
        name: String,
        as_json: bool,
    ) -> anyhow::Result<()> {
        let after_id = self.after.or((!self.watch).then_some(0));
        let request = WatchEventsRequest { name, after_id, only_past: !self.watch };
        let mut events = devices.watch_events(request).await.map_err(plain)?.into_inner();
        loop {
            tokio::select! {
                event = events.message() => match event.map_err(plain)? {
                    Some(event) => print(&event, as_json),
                    None => return Ok(()),
                },
                signal = tokio::signal::ctrl_c() => return Ok(signal?),
            }
        }
    }
}

impl ListDevices {
    /// Prints them, once or whenever they change.
    pub async fn run(self, devices: &mut Devices, as_json: bool) -> anyhow::Result<()> {
        if !self.watch {
            let listed = devices.list_devices(ListDevicesRequest {}).await.map_err(plain)?;
            print_devices(&listed.into_inner().devices, as_json);
            return Ok(());
        }
        let watched = devices.watch_devices(WatchDevicesRequest {}).await;
        let mut lists = watched.map_err(plain)?.into_inner();
        loop {
            tokio::select! {
                list = lists.message() => match list.map_err(plain)? {
                    Some(list) => print_devices(&list.devices, as_json),
                    None => return Ok(()),
                },
                signal = tokio::signal::ctrl_c() => return Ok(signal?),
            }
        }
    }
}

fn print_devices(devices: &[Device], as_json: bool) {
    if as_json {
        let device = |device: &Device| json!({ "name": device.name, "mechanism": device.mechanism, "simulated": device.simulated, "mode": format::mode(device.mode()) });
        say!("{}", json!({ "devices": devices.iter().map(device).collect::<Vec<_>>() }));
        return;
    }
    for device in devices {
        let simulated = if device.simulated { ", simulated" } else { "" };
        say!("{}: {} ({}{simulated})", device.name, format::mode(device.mode()), device.mechanism);
    }
}

fn print(told: &DeviceEvent, as_json: bool) {
    let Some(event) = told.event else { return };
    let kind = format::word(event.kind().as_str_name(), "EVENT_KIND_");
    let (detail, value) = detail(told);
    if as_json {
        let time_ns = event.device_time_ns;
        say!(
            "{}",
            json!({ "name": told.name, "id": event.id, "device_time_ns": time_ns, "kind": kind, "value": value, "missed": told.missed })
        );
        return;
    }
    if told.missed > 0 {
        say!("        {} missed", told.missed);
    }
    let seconds = event.device_time_ns as f64 * 1e-9;
    say!("{:>7} {seconds:>14.3} s  {kind}{detail}", event.id);
}

/// What it was about, for people and for machines.
fn detail(told: &DeviceEvent) -> (String, Value) {
    let Some(event) = told.event else { return (String::new(), Value::Null) };
    let word = match event.kind() {
        EventKind::ContactBegin | EventKind::ContactEnd => match told.contact.as_str() {
            "" => "an object that is gone".into(),
            contact => contact.rsplit_once("objects/").map_or(contact, |(_, id)| id).to_owned(),
        },
        EventKind::Mode => format::mode(told.mode()),
        EventKind::Fault => format::word(told.fault().as_str_name(), "FAULT_"),
        EventKind::Button => return (format!(" {:#b}", event.value), json!(event.value)),
        _ => return (String::new(), Value::Null),
    };
    (format!(" {word}"), json!(word))
}
