//! GetSettings and UpdateSettings: a field mask over what may be changed of a running device.
//!
//! Every path of the mask is checked on a copy before any of it is in force; a path that is
//! not known, or a value outside its range, refuses the whole request.

use std::sync::Arc;

use tonic::Status;

use super::desk::Desk;
use super::guard::Asker;
use super::{convert, field_status, names};
use crate::actuation::Strategy;
use crate::audit::What;
use crate::config::{Setting, Settings, SettingsError};
use crate::host::{DeviceHost, SettingsInForce};
use crate::proto;
use crate::units::FieldError;

/// All that a mask can name, leaf by leaf.
const LEAVES: [&str; 17] = [
    "strategy",
    "force_limit_n",
    "force_gain",
    "activation_ramp_ms",
    "mount.position_m",
    "mount.orientation",
    "tool.offset_m",
    "tool.radius_m",
    "tool.points_m",
    "guards.slew_n_per_s",
    "guards.stale_ramp_ms",
    "guards.passivity_reserve_j",
    "guards.passivity_power_w",
    "guards.closure_limit_rad",
    "guards.stop_capacity_nm",
    "guards.max_overruns",
    "guards.max_device_errors",
];

/// The settings in force.
pub fn get(host: &DeviceHost) -> proto::Settings {
    to_proto(host, &host.settings())
}

/// Changes what the request's mask names.
pub async fn update(
    desk: &Desk,
    asker: Asker,
    request: proto::UpdateSettingsRequest,
) -> Result<proto::Settings, Status> {
    let host = Arc::clone(&desk.host);
    let wanted = request.settings.unwrap_or_default();
    let paths = request.update_mask.unwrap_or_default().paths;
    let leaves = leaves(&paths).map_err(|error| field_status(&error))?;
    let fixed = |leaf: &&&str| leaf.starts_with("mount.") || **leaf == "tool.offset_m";
    if let Some(leaf) = leaves.iter().find(fixed).filter(|_| host.has_pointer()) {
        let allowed = "must stay: a person pulls this handle (--hand pointer), where mount and \
                       tool of the device file say; change it there";
        return Err(field_status(&FieldError::new(format!("settings.{leaf}"), "(new)", allowed)));
    }
    let editing = Arc::clone(&host);
    let edit = move || {
        let changed = editing.edit_settings(wanted.revision, |settings| {
            leaves.iter().try_for_each(|leaf| apply(settings, leaf, &wanted))
        })?;
        // Here: told even if nobody waits for the answer.
        let told = leaves.join(", ");
        tracing::info!(changed = told, revision = changed.revision, "settings");
        let detail = format!("{told}, revision {}", changed.revision);
        asker.did(What::SettingsChanged, &names::device(&editing), &detail);
        Ok(changed)
    };
    let changed = desk.settings.run(edit).await?;
    Ok(to_proto(&host, &changed))
}

/// What went wrong, as a status.
pub fn status(error: &SettingsError) -> Status {
    match error {
        SettingsError::StaleRevision { .. } => Status::aborted(error.to_string()),
        SettingsError::Invalid(_) => Status::invalid_argument(error.to_string()),
    }
}

/// The leaves that these paths name.
fn leaves(paths: &[String]) -> Result<Vec<&'static str>, FieldError> {
    if paths.is_empty() {
        let allowed = format!("must name what to change: {}", LEAVES.join(", "));
        return Err(FieldError::new("update_mask.paths", "(none)", allowed));
    }
    if paths.len() > LEAVES.len() {
        let (count, most) = (format!("{} of them", paths.len()), LEAVES.len());
        return Err(FieldError::new("update_mask.paths", count, format!("must be at most {most}")));
    }
    let mut found = Vec::new();
    for (i, path) in paths.iter().enumerate() {
        let named = LEAVES.into_iter().filter(|leaf| {
            let inner = leaf.strip_prefix(path.as_str());
            inner.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        });
        let named: Vec<_> = named.collect();
        let none = named.is_empty();
        for leaf in named {
            if !found.contains(&leaf) {
                found.push(leaf);
            }
        }
        if none {
            let field = format!("update_mask.paths[{i}]");
            let allowed = format!("must be one of {}, or what holds them", LEAVES.join(", "));
            return Err(FieldError::new(field, format!("{path:?}"), allowed));
        }
    }
    Ok(found)
}

fn apply(settings: &mut Settings, leaf: &str, wanted: &proto::Settings) -> Result<(), FieldError> {
    let field = format!("settings.{leaf}");
    let none = proto::ToolSettings::default();
    let tool = wanted.tool.as_ref().unwrap_or(&none);
    let guards = || required("settings.guards", wanted.guards.as_ref());
    let mount = || required("settings.mount", wanted.mount.as_ref());
    let setting = match leaf {
        "strategy" => Setting::Strategy(strategy(&field, wanted.strategy)?),
        "force_limit_n" => Setting::ForceLimit_N(wanted.force_limit_n),
        "force_gain" => Setting::ForceGain(wanted.force_gain),
        "activation_ramp_ms" => Setting::ActivationRamp_ms(wanted.activation_ramp_ms),
        "mount.position_m" => {
            Setting::MountPosition_m(array(&field, mount()?.position_m.as_ref())?)
        }
        "mount.orientation" => {
            let q = required(&field, mount()?.orientation.as_ref())?;
            Setting::MountOrientation_xyzw([q.x, q.y, q.z, q.w])
        }
        "tool.offset_m" => Setting::ToolOffset_m(array(&field, tool.offset_m.as_ref())?),
        "tool.radius_m" => Setting::ToolRadius_m(tool.radius_m),
        "tool.points_m" => {
            Setting::ToolPoints_m(tool.points_m.iter().map(|p| [p.x, p.y, p.z]).collect())
        }
        "guards.slew_n_per_s" => Setting::Slew_N_per_s(guards()?.slew_n_per_s),
        "guards.stale_ramp_ms" => Setting::StaleRamp_ms(guards()?.stale_ramp_ms),
        "guards.passivity_reserve_j" => Setting::PassivityReserve_J(guards()?.passivity_reserve_j),
        "guards.passivity_power_w" => Setting::PassivityPower_W(guards()?.passivity_power_w),
        "guards.closure_limit_rad" => Setting::ClosureLimit_rad(guards()?.closure_limit_rad),
        "guards.stop_capacity_nm" => Setting::StopCapacity_Nm(guards()?.stop_capacity_nm),
        "guards.max_overruns" => Setting::MaxOverruns(guards()?.max_overruns.into()),
        // The last of `LEAVES`.
        _ => Setting::MaxDeviceErrors(guards()?.max_device_errors.into()),
    };
    settings.set(&field, &setting)
}

fn required<'a, T>(field: &str, value: Option<&'a T>) -> Result<&'a T, FieldError> {
    value.ok_or_else(|| FieldError::new(field, "(none)", "is required: the mask names it"))
}

fn array(field: &str, v: Option<&proto::Vector3>) -> Result<[f64; 3], FieldError> {
    required(field, v).map(|v| [v.x, v.y, v.z])
}

fn strategy(field: &str, number: i32) -> Result<Strategy, FieldError> {
    let named = |strategy: &Strategy| proto::Strategy::from(*strategy) as i32 == number;
    Strategy::ALL.into_iter().find(named).ok_or_else(|| {
        let names = Strategy::ALL.map(|s| proto::Strategy::from(s).as_str_name()).join(", ");
        FieldError::new(field, number, format!("must be one of {names}"))
    })
}

fn to_proto(host: &DeviceHost, in_force: &SettingsInForce) -> proto::Settings {
    let Settings { strategy, guards, mount, tool } = &in_force.settings;
    let ms = |ns: u64| ns as f64 * 1e-6;
    proto::Settings {
        name: names::device(host),
        revision: in_force.revision,
        strategy: proto::Strategy::from(*strategy).into(),
        force_limit_n: guards.force_limit_N,
        force_gain: guards.force_gain,
        activation_ramp_ms: ms(guards.activation_ramp_ns),
        mount: convert::pose(&mount.p_WB_m, &mount.q_WB),
        tool: Some(proto::ToolSettings {
            offset_m: convert::vector(&tool.offset_B_m),
            radius_m: tool.radius_m,
            points_m: tool.points_T_m().iter().filter_map(convert::vector).collect(),
        }),
        guards: Some(proto::GuardSettings {
            slew_n_per_s: guards.slew_N_per_s,
            stale_ramp_ms: ms(guards.stale_ramp_ns),
            passivity_reserve_j: guards.passivity_reserve_J,
            passivity_power_w: guards.passivity_power_W,
            closure_limit_rad: guards.closure_limit_rad,
            stop_capacity_nm: guards.stop_capacity_Nm,
            max_overruns: guards.max_overruns,
            max_device_errors: guards.max_device_errors,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_means_its_leaves_and_nothing_that_only_begins_like_it() {
        let named = |path: &str| leaves(&[path.to_owned()]);
        assert_eq!(named("tool").unwrap(), ["tool.offset_m", "tool.radius_m", "tool.points_m"]);
        assert_eq!(named("guards").unwrap().len(), 8);
        for leaf in LEAVES {
            assert_eq!(named(leaf).unwrap(), [leaf]);
        }
        for wrong in ["", "*", "name", "revision", "force", "tool.", "tool.radius", "guards.slew"] {
            let refusal = named(wrong).unwrap_err();
            assert_eq!(refusal.field, "update_mask.paths[0]", "{wrong}");
        }
        assert!(leaves(&[]).unwrap_err().allowed.contains("force_gain"));
    }
}
