//! `hapticd ctl settings`, `set` and `strategy`: what may be changed of a running device.

use anyhow::{Context, bail, ensure};
use clap::Args;
use prost_types::FieldMask;
use serde_json::json;

use super::ctl::plain;
use super::format::{self, parse_vector};
use crate::client::Devices;
use crate::proto::{
    GetSettingsRequest, GuardSettings, Pose, Quaternion, Settings, Strategy, ToolSettings,
    UpdateSettingsRequest, Vector3,
};

/// Change settings of the running device, all of them or none
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd ctl set force_gain=0.5
  hapticd ctl set force_limit_n=30 guards.slew_n_per_s=500
  hapticd ctl set tool.points_m='0.01,0,0;-0.01,0,0' tool.radius_m=0.004
  hapticd ctl set mount.position_m=0,0,0.2 --revision 3

Keys are those that `hapticd ctl settings` prints. Nothing is kept: the device file says how
the next start is.")]
pub struct Set {
    /// What to change
    #[arg(required = true, value_name = "KEY=VALUE")]
    changes: Vec<String>,
    /// Only if nobody has changed the settings since this revision
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    revision: u64,
}

/// Choose the law of the running device
#[derive(Debug, Args)]
#[command(after_help = "Example:
  hapticd ctl strategy predicted-velocity")]
pub struct ChooseStrategy {
    /// auto (usual), or optimal, nearest-reference, coercive, coercive-literal, sliding,
    /// predicted-velocity, path-following, least-norm, weighted, null-space, null-space-iterated
    #[arg(value_name = "NAME")]
    law: String,
}

/// Prints the settings.
pub async fn show(devices: &mut Devices, name: String, as_json: bool) -> anyhow::Result<()> {
    let settings = devices.get_settings(GetSettingsRequest { name }).await.map_err(plain)?;
    print(&settings.into_inner(), as_json);
    Ok(())
}

impl Set {
    /// Changes and prints what came of it.
    pub async fn run(
        self,
        devices: &mut Devices,
        name: String,
        as_json: bool,
    ) -> anyhow::Result<()> {
        let mut settings = Settings { name, revision: self.revision, ..Settings::default() };
        let mut paths = Vec::new();
        for change in &self.changes {
            let (key, value) = change
                .split_once('=')
                .with_context(|| format!("{change:?}: must be KEY=VALUE, as in force_gain=0.5"))?;
            put(&mut settings, key, value).with_context(|| format!("{key} = {value:?}"))?;
            paths.push(key.to_owned());
        }
        update(devices, settings, paths, as_json).await
    }
}

impl ChooseStrategy {
    /// Changes and prints what came of it.
    pub async fn run(
        self,
        devices: &mut Devices,
        name: String,
        as_json: bool,
    ) -> anyhow::Result<()> {
        let strategy = law(&self.law)?.into();
        let settings = Settings { name, strategy, ..Settings::default() };
        update(devices, settings, vec!["strategy".into()], as_json).await
    }
}

async fn update(
    devices: &mut Devices,
    settings: Settings,
    paths: Vec<String>,
    as_json: bool,
) -> anyhow::Result<()> {
    let update_mask = Some(FieldMask { paths });
    let request = UpdateSettingsRequest { settings: Some(settings), update_mask };
    let changed = devices.update_settings(request).await.map_err(plain)?;
    print(&changed.into_inner(), as_json);
    Ok(())
}

/// Puts a value as people write it into its field. Ranges are the server's business.
fn put(settings: &mut Settings, key: &str, value: &str) -> anyhow::Result<()> {
    let number = || value.parse::<f64>().ok().context("must be a number");
    let whole = || value.parse::<u32>().ok().context("must be a whole number");
    let vector = || parse_vector(value).map_err(anyhow::Error::msg);
    match key {
        "strategy" => settings.strategy = law(value)?.into(),
        "force_limit_n" => settings.force_limit_n = number()?,
        "force_gain" => settings.force_gain = number()?,
        "activation_ramp_ms" => settings.activation_ramp_ms = number()?,
        "mount.position_m" => mount(settings).position_m = Some(vector()?),
        "mount.orientation" => mount(settings).orientation = Some(quaternion(value)?),
        "tool.offset_m" => tool(settings).offset_m = Some(vector()?),
        "tool.radius_m" => tool(settings).radius_m = number()?,
        "tool.points_m" => tool(settings).points_m = points(value)?,
        "guards.slew_n_per_s" => guards(settings).slew_n_per_s = number()?,
        "guards.stale_ramp_ms" => guards(settings).stale_ramp_ms = number()?,
        "guards.passivity_reserve_j" => guards(settings).passivity_reserve_j = number()?,
        "guards.passivity_power_w" => guards(settings).passivity_power_w = number()?,
        "guards.closure_limit_rad" => guards(settings).closure_limit_rad = number()?,
        "guards.stop_capacity_nm" => guards(settings).stop_capacity_nm = number()?,
        "guards.max_overruns" => guards(settings).max_overruns = whole()?,
        "guards.max_device_errors" => guards(settings).max_device_errors = whole()?,
        _ => bail!("no such setting; `hapticd ctl settings` prints them all"),
    }
    Ok(())
}

fn mount(settings: &mut Settings) -> &mut Pose {
    settings.mount.get_or_insert_default()
}

fn tool(settings: &mut Settings) -> &mut ToolSettings {
    settings.tool.get_or_insert_default()
}

fn guards(settings: &mut Settings) -> &mut GuardSettings {
    settings.guards.get_or_insert_default()
}

fn law(name: &str) -> anyhow::Result<Strategy> {
    let law: crate::actuation::Strategy = name.parse()?;
    Ok(law.into())
}

fn quaternion(text: &str) -> anyhow::Result<Quaternion> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let Ok(&[x, y, z, w]) = numbers.as_deref() else {
        bail!("must be four numbers x,y,z,w, as in 0,0,0,1");
    };
    Ok(Quaternion { x, y, z, w })
}

fn points(text: &str) -> anyhow::Result<Vec<Vector3>> {
    let written = text.split(';').filter(|point| !point.trim().is_empty());
    let points: Result<Vec<_>, _> = written.map(parse_vector).collect();
    let points = points.map_err(anyhow::Error::msg)?;
    ensure!(points.len() <= 64, "{} points are too many", points.len());
    Ok(points)
}

/// Every setting by its key, as it is written.
fn lines(settings: &Settings) -> Vec<(&'static str, String)> {
    let list = |v: &Vector3| format!("{},{},{}", v.x, v.y, v.z);
    let vector = |v: Option<&Vector3>| v.map(list).unwrap_or_default();
    let (tool, guards) =
        (settings.tool.clone().unwrap_or_default(), settings.guards.unwrap_or_default());
    let mount = settings.mount.unwrap_or_default();
    let q = mount.orientation.unwrap_or_default();
    vec![
        ("strategy", format::law(settings.strategy())),
        ("force_limit_n", settings.force_limit_n.to_string()),
        ("force_gain", settings.force_gain.to_string()),
        ("activation_ramp_ms", settings.activation_ramp_ms.to_string()),
        ("mount.position_m", vector(mount.position_m.as_ref())),
        ("mount.orientation", format!("{},{},{},{}", q.x, q.y, q.z, q.w)),
        ("tool.offset_m", vector(tool.offset_m.as_ref())),
        ("tool.radius_m", tool.radius_m.to_string()),
        ("tool.points_m", tool.points_m.iter().map(list).collect::<Vec<_>>().join(";")),
        ("guards.slew_n_per_s", guards.slew_n_per_s.to_string()),
        ("guards.stale_ramp_ms", guards.stale_ramp_ms.to_string()),
        ("guards.passivity_reserve_j", guards.passivity_reserve_j.to_string()),
        ("guards.passivity_power_w", guards.passivity_power_w.to_string()),
        ("guards.closure_limit_rad", guards.closure_limit_rad.to_string()),
        ("guards.stop_capacity_nm", guards.stop_capacity_nm.to_string()),
        ("guards.max_overruns", guards.max_overruns.to_string()),
        ("guards.max_device_errors", guards.max_device_errors.to_string()),
    ]
}

fn print(settings: &Settings, as_json: bool) {
    if as_json {
        let mut object = json!({ "name": settings.name, "revision": settings.revision });
        for (key, value) in lines(settings) {
            let number = value.parse::<f64>().ok();
            object[key] = number.map_or_else(|| json!(value), |number| json!(number));
        }
        say!("{object}");
        return;
    }
    say!("{}: settings, revision {}", settings.name, settings.revision);
    for (key, value) in lines(settings) {
        say!("  {key} = {value}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_printed_can_be_set() {
        let settings = Settings {
            strategy: Strategy::Sliding.into(),
            force_gain: 0.25,
            mount: Some(Pose {
                position_m: Some(Vector3 { x: 1.0, y: -2.0, z: 0.5 }),
                orientation: Some(Quaternion { x: 0.0, y: 0.0, z: 0.6, w: 0.8 }),
            }),
            tool: Some(ToolSettings {
                offset_m: Some(Vector3::default()),
                radius_m: 0.01,
                points_m: vec![Vector3 { x: 0.1, y: 0.0, z: 0.0 }; 2],
            }),
            guards: Some(GuardSettings { max_overruns: 7, ..GuardSettings::default() }),
            ..Settings::default()
        };
        let mut again = Settings::default();
        for (key, value) in lines(&settings) {
            put(&mut again, key, &value).unwrap();
        }
        assert_eq!(again, settings);
    }

    #[test]
    fn what_makes_no_sense_is_refused_before_it_is_sent() {
        for (key, value) in [
            ("colour", "1"),
            ("force_gain", "half"),
            ("guards.max_overruns", "-1"),
            ("guards.max_overruns", "1.5"),
            ("strategy", "magic"),
            ("mount.orientation", "0,0,1"),
            ("tool.points_m", "1,2;3"),
        ] {
            assert!(put(&mut Settings::default(), key, value).is_err(), "{key} = {value}");
        }
    }
}
