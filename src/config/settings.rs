//! What may be changed of a running device: its law, its bounds, where it stands, its tool.
//!
//! A device file says how a device starts; a request changes it while it runs. Both pass
//! through [`Settings::set`], one value at a time, and a refusal leaves the settings as they
//! are. Settings are not kept: the next start has those of the file again.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::DeviceDefinition;
use crate::actuation::Strategy;
use crate::control::{Guards, Mount, Tool};
use crate::environment::MAX_POINTS;
use crate::units::{self, FieldError, Range};

/// All of them, checked.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Settings {
    /// The law.
    pub strategy: Strategy,
    /// Bounds on requests, and how much may go wrong.
    pub guards: Guards,
    /// Where the device's plane lies.
    pub mount: Mount,
    /// What the handle carries.
    pub tool: Tool,
}

/// One value as somebody wrote it, in the unit of its name.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, non_camel_case_types)] // each is a key of the device file, with its unit
pub enum Setting {
    Strategy(Strategy),
    ForceLimit_N(f64),
    ForceGain(f64),
    ActivationRamp_ms(f64),
    Slew_N_per_s(f64),
    StaleRamp_ms(f64),
    PassivityReserve_J(f64),
    PassivityPower_W(f64),
    ClosureLimit_rad(f64),
    StopCapacity_Nm(f64),
    MaxOverruns(i64),
    MaxDeviceErrors(i64),
    MountPosition_m([f64; 3]),
    MountOrientation_xyzw([f64; 4]),
    ToolOffset_m([f64; 3]),
    ToolRadius_m(f64),
    ToolPoints_m(Vec<[f64; 3]>),
}

/// Why settings were not changed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SettingsError {
    /// Somebody else changed them in between.
    #[error(
        "settings.revision = {expected}: the settings are at revision {actual}; read them again"
    )]
    StaleRevision {
        /// What the change was made for.
        expected: u64,
        /// What they have.
        actual: u64,
    },
    /// A value is not allowed.
    #[error(transparent)]
    Invalid(#[from] FieldError),
}

impl Settings {
    /// Those that a device starts with.
    pub fn of(device: &DeviceDefinition) -> Self {
        let DeviceDefinition { strategy, guards, mount, tool, .. } = device;
        Self { strategy: *strategy, guards: *guards, mount: *mount, tool: *tool }
    }

    /// Changes one; `field` is what its author called it.
    pub fn set(&mut self, field: &str, setting: &Setting) -> Result<(), FieldError> {
        let guards = &mut self.guards;
        match *setting {
            Setting::Strategy(strategy) => self.strategy = strategy,
            Setting::ForceLimit_N(value) => {
                guards.force_limit_N = units::FORCE_LIMIT.check(field, value)?;
            }
            Setting::ForceGain(value) => guards.force_gain = units::GAIN.check(field, value)?,
            Setting::ActivationRamp_ms(value) => guards.activation_ramp_ns = ns(field, value)?,
            Setting::Slew_N_per_s(value) => {
                guards.slew_N_per_s = units::SLEW.check(field, value)?
            }
            Setting::StaleRamp_ms(value) => guards.stale_ramp_ns = ns(field, value)?,
            Setting::PassivityReserve_J(value) => {
                guards.passivity_reserve_J = units::PASSIVITY_RESERVE.check(field, value)?;
            }
            Setting::PassivityPower_W(value) => {
                guards.passivity_power_W = units::PASSIVITY_POWER.check(field, value)?;
            }
            Setting::ClosureLimit_rad(value) => {
                guards.closure_limit_rad = units::CLOSURE.check(field, value)?;
            }
            Setting::StopCapacity_Nm(value) => {
                guards.stop_capacity_Nm = units::HOLDING_TORQUE.check(field, value)?;
            }
            Setting::MaxOverruns(value) => {
                guards.max_overruns = count(&units::IN_A_ROW, field, value)?;
            }
            Setting::MaxDeviceErrors(value) => {
                guards.max_device_errors = count(&units::BLIND_TICKS, field, value)?;
            }
            Setting::MountPosition_m(value) => {
                self.mount.p_WB_m = vector(&units::POSITION, field, value)?;
            }
            Setting::MountOrientation_xyzw([x, y, z, w]) => {
                let written = Quaternion::new(w, x, y, z);
                units::QUATERNION_LENGTH.check(field, written.norm())?;
                self.mount.q_WB = UnitQuaternion::from_quaternion(written);
            }
            Setting::ToolOffset_m(value) => {
                self.tool.offset_B_m = vector(&units::TOOL_OFFSET, field, value)?;
            }
            Setting::ToolRadius_m(value) => {
                self.tool.radius_m = units::TOOL_RADIUS.check(field, value)?;
            }
            Setting::ToolPoints_m(ref points) => self.set_points(field, points)?,
        }
        Ok(())
    }

    fn set_points(&mut self, field: &str, points: &[[f64; 3]]) -> Result<(), FieldError> {
        if points.len() > MAX_POINTS {
            let found = format!("{} points", points.len());
            return Err(FieldError::new(field, found, format!("must be at most {MAX_POINTS}")));
        }
        let mut points_T_m = [Vector3::zeros(); MAX_POINTS];
        for (i, (place, point)) in points_T_m.iter_mut().zip(points).enumerate() {
            *place = vector(&units::TOOL_OFFSET, &format!("{field}[{i}]"), *point)?;
        }
        (self.tool.points_T_m, self.tool.point_count) = (points_T_m, points.len());
        Ok(())
    }
}

/// A time in milliseconds.
fn ns(field: &str, value_ms: f64) -> Result<u64, FieldError> {
    Ok((units::RAMP.check(field, value_ms)? * 1e6).round() as u64)
}

fn count(range: &Range, field: &str, value: i64) -> Result<u32, FieldError> {
    Ok(u32::try_from(range.check_whole(field, value)?).unwrap_or(u32::MAX))
}

fn vector(range: &Range, field: &str, value: [f64; 3]) -> Result<Vector3<f64>, FieldError> {
    for (i, &part) in value.iter().enumerate() {
        range.check(&format!("{field}[{i}]"), part)?;
    }
    Ok(Vector3::from(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn usual() -> Settings {
        Settings::of(&DeviceDefinition::load("cho-2005").unwrap())
    }

    #[test]
    fn what_is_outside_its_range_is_refused_by_name_and_changes_nothing() {
        let far = [0.0, 1.5, 0.0];
        for (setting, said) in [
            (Setting::ForceLimit_N(0.0), "x = 0: must be a number in 0.1 to 10000 N"),
            (Setting::ForceGain(1.01), "x = 1.01: must be a number in 0 to 1 (share)"),
            (Setting::ForceGain(f64::NAN), "x = NaN"),
            (Setting::ActivationRamp_ms(-1.0), "x = -1: must be a number in 0 to 10000 ms"),
            (Setting::Slew_N_per_s(0.5), "x = 0.5"),
            (Setting::StaleRamp_ms(f64::INFINITY), "x = inf"),
            (Setting::PassivityReserve_J(0.0), "x = 0: must be a number in 0.001 to 1000 J"),
            (Setting::PassivityReserve_J(f64::INFINITY), "x = inf"),
            (Setting::PassivityPower_W(-0.01), "x = -0.01: must be a number in 0 to 1000 W"),
            (Setting::ClosureLimit_rad(4.0), "x = 4"),
            (Setting::StopCapacity_Nm(-0.1), "N m"),
            (Setting::MaxOverruns(0), "1 to 1000000 ticks"),
            (Setting::MaxDeviceErrors(101), "1 to 100 ticks"),
            (Setting::MountPosition_m([0.0, 0.0, 101.0]), "x[2] = 101"),
            (Setting::MountOrientation_xyzw([0.0; 4]), "x = 0: must be a number in 0.99"),
            (Setting::MountOrientation_xyzw([f64::NAN; 4]), "x = NaN"),
            (Setting::ToolOffset_m(far), "x[1] = 1.5: must be a number in -1 to 1 m"),
            (Setting::ToolRadius_m(0.2), "x = 0.2"),
            (Setting::ToolPoints_m(vec![[0.0; 3], far]), "x[1][1] = 1.5"),
            (Setting::ToolPoints_m(vec![[0.0; 3]; 9]), "x = 9 points: must be at most 8"),
        ] {
            let mut settings = usual();
            let refusal = settings.set("x", &setting).unwrap_err().to_string();
            assert!(refusal.contains(said), "{setting:?}: {refusal}");
            assert_eq!(settings, usual(), "{setting:?}");
        }
    }

    #[test]
    fn what_is_inside_is_set_and_touches_nothing_else() {
        let mut settings = usual();
        let points = vec![[0.01, 0.0, 0.0], [-0.01, 0.0, 0.0]];
        settings.set("x", &Setting::ActivationRamp_ms(1.5)).unwrap();
        settings.set("x", &Setting::ToolPoints_m(points)).unwrap();
        let mut expected = usual();
        expected.guards.activation_ramp_ns = 1_500_000;
        expected.tool.point_count = 2;
        expected.tool.points_T_m[0].x = 0.01;
        expected.tool.points_T_m[1].x = -0.01;
        assert_eq!(settings, expected);
        settings.set("x", &Setting::ToolPoints_m(Vec::new())).unwrap();
        assert_eq!(settings.tool, usual().tool, "points that are gone leave nothing behind");
    }
}
