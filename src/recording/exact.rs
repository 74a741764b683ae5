//! Plans, setpoints and states as entries that keep every bit.
//!
//! A plan's linkage comes from the device's file, which is in the entry and is checked again
//! as any file is; everything else in a plan is stored as it was in force, so that a setting
//! that no file knows is replayed too. What a file could say to break the loop is refused
//! here: whatever a device file or a request could not have said of actuators, bounds, mount,
//! tool and tick. Numbers of the scene are not, because a tick takes any.

use prost::Message;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

use crate::actuation::Strategy;
use crate::config::{DeviceDefinition, Scene, Setting, Settings};
use crate::control::{Actuators, ControlState, Guards, Mount, Plan, Setpoint, Tool};
use crate::environment::{Element, MAX_CORRIDOR_POINTS, SceneItem};
use crate::notation::MAX_ACTUATORS;
use crate::proto::record_entry::Entry;
use crate::proto::{RecordEntry, RecordPlan, RecordSetpoint, RecordSnapshot};
use crate::units::{self, FieldError};

/// A plan but for its linkage and its number.
#[derive(Deserialize, Serialize)]
struct Exact {
    actuators: Actuators,
    mount: Mount,
    tool: Tool,
    tick_ns: u64,
    strategy: Strategy,
    guards: Guards,
    scene: Box<[SceneItem]>,
    scene_revision: u64,
}

/// An entry with its length before it.
pub(super) fn framed(entry: Entry) -> Vec<u8> {
    RecordEntry { entry: Some(entry) }.encode_length_delimited_to_vec()
}

/// What serde makes of it. Nothing here has a part that cannot be written; were there one, it
/// would be missing from the recording, and a replay would say so.
fn stored(value: &impl Serialize) -> Vec<u8> {
    postcard::to_stdvec(value).unwrap_or_default()
}

fn restored<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Result<T, String> {
    match postcard::take_from_bytes(bytes) {
        Ok((value, [])) => Ok(value),
        Ok((_, rest)) => Err(format!("{} bytes too many", rest.len())),
        Err(error) => Err(error.to_string()),
    }
}

/// The entry of a plan, made from this device and this scene.
pub fn plan_entry(plan: &Plan, device: &DeviceDefinition, scene: &Scene) -> Vec<u8> {
    // Every field by name: one that is added has to be thought of here.
    let Plan {
        mechanism: _,
        home_rad: _, // as the linkage, from the device
        actuators,
        mount,
        tool,
        tick_ns,
        strategy,
        guards,
        scene: items,
        scene_revision,
        generation,
    } = plan.clone();
    let exact =
        Exact { actuators, mount, tool, tick_ns, strategy, guards, scene: items, scene_revision };
    framed(Entry::Plan(RecordPlan {
        generation,
        device_name: device.name.to_string(),
        device_toml: device.text.to_string(),
        scene_toml: scene.to_toml().unwrap_or_default(),
        exact: stored(&exact),
    }))
}

/// The plan of an entry with the device that it is for; what is wrong with it is told.
pub(super) fn plan_of(entry: &RecordPlan) -> Result<(Plan, DeviceDefinition), String> {
    let device =
        DeviceDefinition::from_toml(&entry.device_name, &entry.device_toml, "recorded device")
            .map_err(|error| error.to_string())?;
    let Exact { actuators, mount, tool, tick_ns, strategy, guards, scene, scene_revision } =
        restored(&entry.exact)?;
    let told = |refusal: FieldError| refusal.to_string();
    units::RATE.check("ticks per second", 1e9 / tick_ns as f64).map_err(told)?;
    check_actuators(&actuators, device.mechanism.actuators()).map_err(told)?;
    check_settings(&Settings { strategy, guards, mount, tool }).map_err(told)?;
    let corridors = scene.iter().filter_map(|item| match &item.element {
        Element::Corridor(corridor) => Some(corridor.points_W_m().len()),
        _ => None,
    });
    if let Some(points) = corridors.into_iter().find(|n| !(2..=MAX_CORRIDOR_POINTS).contains(n)) {
        return Err(format!("corridor of {points} points: must be 2 to {MAX_CORRIDOR_POINTS}"));
    }
    let plan = Plan {
        mechanism: Arc::clone(&device.mechanism),
        home_rad: device.home_rad,
        actuators,
        mount,
        tool,
        tick_ns,
        strategy,
        guards,
        scene,
        scene_revision,
        generation: entry.generation,
    };
    Ok((plan, device))
}

/// In the ranges of a device file, which has `count` of them; nothing beyond.
fn check_actuators(actuators: &Actuators, count: usize) -> Result<(), FieldError> {
    let Actuators {
        kinds: _,
        max_torque_Nm,
        counts_per_revolution,
        lag_s,
        resolution_Nm,
        weight,
        hysteresis_Nm,
        damping_N_m_s_per_rad,
    } = actuators;
    for i in 0..count {
        let field = |name: &str| format!("actuators[{i}].{name}");
        units::TORQUE_LIMIT.check(&field("max_torque_Nm"), max_torque_Nm[i])?;
        units::COUNTS.check(&field("counts_per_revolution"), counts_per_revolution[i])?;
        units::LAG.check(&field("lag_s"), lag_s[i])?;
        units::RESOLUTION.check(&field("resolution_Nm"), resolution_Nm[i])?;
        units::WEIGHT.check(&field("weight"), weight[i])?;
        let share = hysteresis_Nm[i] / max_torque_Nm[i];
        units::HYSTERESIS.check(&field("hysteresis"), share)?;
        let drag = damping_N_m_s_per_rad[i];
        units::SHAFT_DAMPING.check(&field("damping_N_m_s_per_rad"), drag)?;
    }
    for i in count..MAX_ACTUATORS {
        let beyond = [
            max_torque_Nm[i],
            counts_per_revolution[i],
            lag_s[i],
            resolution_Nm[i],
            weight[i],
            hysteresis_Nm[i],
            damping_N_m_s_per_rad[i],
        ];
        if beyond != [0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0] {
            let field = format!("actuators[{i}]");
            let allowed = format!("the device has {count} actuators");
            return Err(FieldError::new(field, format!("{beyond:?}"), allowed));
        }
    }
    Ok(())
}

/// In the ranges in which somebody may set them; only looked at, so that every bit stays.
fn check_settings(settings: &Settings) -> Result<(), FieldError> {
    let Settings { strategy: _, guards, mount, tool } = *settings;
    let ms = |ns: u64| ns as f64 / 1e6;
    if tool.point_count > tool.points_T_m.len() {
        let allowed = format!("must be at most {}", tool.points_T_m.len());
        return Err(FieldError::new("tool.point_count", tool.point_count, allowed));
    }
    let points_m = tool.points_T_m.map(Into::into).to_vec();
    let mut scratch = *settings;
    for (field, setting) in [
        ("force_limit_N", Setting::ForceLimit_N(guards.force_limit_N)),
        ("force_gain", Setting::ForceGain(guards.force_gain)),
        ("activation_ramp_ms", Setting::ActivationRamp_ms(ms(guards.activation_ramp_ns))),
        ("slew_N_per_s", Setting::Slew_N_per_s(guards.slew_N_per_s)),
        ("stale_ramp_ms", Setting::StaleRamp_ms(ms(guards.stale_ramp_ns))),
        ("passivity_reserve_J", Setting::PassivityReserve_J(guards.passivity_reserve_J)),
        ("passivity_power_W", Setting::PassivityPower_W(guards.passivity_power_W)),
        ("closure_limit_rad", Setting::ClosureLimit_rad(guards.closure_limit_rad)),
        ("stop_capacity_Nm", Setting::StopCapacity_Nm(guards.stop_capacity_Nm)),
        ("max_overruns", Setting::MaxOverruns(guards.max_overruns.into())),
        ("max_device_errors", Setting::MaxDeviceErrors(guards.max_device_errors.into())),
        ("mount.position_m", Setting::MountPosition_m(mount.p_WB_m.into())),
        ("mount.orientation", Setting::MountOrientation_xyzw(mount.q_WB.coords.into())),
        ("tool.offset_m", Setting::ToolOffset_m(tool.offset_B_m.into())),
        ("tool.radius_m", Setting::ToolRadius_m(tool.radius_m)),
        ("tool.points_m", Setting::ToolPoints_m(points_m)),
    ] {
        scratch.set(field, &setting)?;
    }
    Ok(())
}

/// The entry of a setpoint.
pub(super) fn setpoint_entry(setpoint: &Setpoint) -> Vec<u8> {
    framed(Entry::Setpoint(RecordSetpoint {
        number: setpoint.number,
        epoch: setpoint.epoch,
        seq: setpoint.seq,
        state_tick: setpoint.state_tick,
        received_ns: setpoint.received_ns,
        ttl_ns: setpoint.ttl_ns,
        released: setpoint.released,
        clutched: setpoint.clutched,
        contacts: setpoint.contacts().count() as u32,
        exact: stored(setpoint),
    }))
}

pub(super) fn setpoint_of(entry: &RecordSetpoint) -> Result<Setpoint, String> {
    restored(&entry.exact)
}

/// The entry of a state.
pub fn snapshot_entry(state: &ControlState) -> Vec<u8> {
    framed(Entry::Snapshot(RecordSnapshot { after_tick: state.ticks(), exact: stored(state) }))
}

pub(super) fn snapshot_of(entry: &RecordSnapshot) -> Result<ControlState, String> {
    let state: ControlState = restored(&entry.exact)?;
    if !state.is_sound() || state.ticks() != entry.after_tick {
        return Err("not a state that a tick leaves behind".to_owned());
    }
    Ok(state)
}

#[cfg(test)]
mod tests {
    use prost::Message as _;

    use super::*;
    use crate::config::build_plan;
    use crate::control::Mode;
    use crate::recording::LAYOUT;

    /// A hash that is the same for ever (Fowler, Noll and Vo's 1a of 64 bits).
    fn fnv(bytes: &[u8]) -> u64 {
        let begin = 0xcbf2_9ce4_8422_2325;
        bytes
            .iter()
            .fold(begin, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3))
    }

    /// What is stored has no names in it: read by another version it would be something else.
    #[test]
    fn what_is_stored_changes_only_with_the_layout() {
        let device = DeviceDefinition::load("cho-2005").unwrap();
        let scene = Scene::default();
        let entry = plan_entry(&build_plan(&device, &scene), &device, &scene);
        let stored = RecordEntry::decode_length_delimited(entry.as_slice()).unwrap();
        let Some(Entry::Plan(plan)) = stored.entry else { panic!("{stored:?}") };
        let state = snapshot_entry(&ControlState::new(Mode::Disabled));
        let found = (LAYOUT, plan.exact.len(), state.len(), fnv(&state));
        assert_eq!(
            found,
            (3, 695, 6307, 0x4a12_43b9_35bb_74dc),
            "raise LAYOUT, and write here what there is now"
        );
    }
}
