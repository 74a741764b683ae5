//! The layout of a device file, and the check of each of its tables.
//!
//! One struct per table, with the keys as people write them; unknown keys are errors. Checks
//! turn a table into what the loop takes; a refusal carries the full key path. The linkage's
//! tables are in [`super::linkage`].

use serde::Deserialize;

use super::linkage::{InertiaLayout, MechanismLayout};
use super::{Id, Setting, Settings};
use crate::actuation::{ActuatorKind, Strategy};
use crate::control::{Actuators, Guards};
use crate::device::{ForceSensor, Imperfections};
use crate::notation::{ActuatorVector, MAX_ACTUATORS};
use crate::units::{self, FieldError};

/// A whole device file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DeviceLayout {
    pub description: Option<String>,
    pub mechanism: MechanismLayout,
    #[serde(default)]
    pub inertia: InertiaLayout,
    pub actuators: Vec<ActuatorLayout>,
    #[serde(default)]
    pub encoders: EncodersLayout,
    #[serde(default)]
    pub hand_force: HandForceLayout,
    #[serde(default)]
    pub mount: MountLayout,
    #[serde(default)]
    pub tool: ToolLayout,
    #[serde(default)]
    pub control: ControlLayout,
    #[serde(default)]
    pub simulation: SimulationLayout,
}

/// One `[[actuators]]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ActuatorLayout {
    pub name: String,
    pub kind: String,
    #[serde(default = "usual_torque")]
    pub max_torque_Nm: f64,
    #[serde(default = "usual_lag")]
    pub lag_s: f64,
    #[serde(default)]
    pub residual_torque_Nm: f64,
    #[serde(default)]
    pub hysteresis: f64,
    #[serde(default)]
    pub backlash_rad: f64,
    #[serde(default)]
    pub damping_N_m_s_per_rad: f64,
    #[serde(default)]
    pub resolution_Nm: f64,
    #[serde(default = "usual_weight")]
    pub weight: f64,
    #[serde(default = "usual_counts")]
    pub counts_per_revolution: i64,
    #[serde(default)]
    pub shaft_inertia_kg_m2: f64,
}

fn usual_torque() -> f64 {
    20.0
}

fn usual_lag() -> f64 {
    0.002
}

fn usual_weight() -> f64 {
    1.0
}

fn usual_counts() -> i64 {
    65_536
}

/// `[encoders]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct EncodersLayout {
    pub kind: String,
    pub home_m: Option<[f64; 2]>,
}

impl Default for EncodersLayout {
    fn default() -> Self {
        Self { kind: "absolute".into(), home_m: None }
    }
}

/// `[hand_force]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct HandForceLayout {
    pub kind: String,
    pub noise_rms_N: Option<f64>,
    pub bias_N: Option<f64>,
}

impl Default for HandForceLayout {
    fn default() -> Self {
        Self { kind: "none".into(), noise_rms_N: None, bias_N: None }
    }
}

/// `[mount]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct MountLayout {
    pub position_m: [f64; 3],
    pub orientation_xyzw: [f64; 4],
}

impl Default for MountLayout {
    fn default() -> Self {
        Self { position_m: [0.0; 3], orientation_xyzw: [0.0, 0.0, 0.0, 1.0] }
    }
}

/// `[tool]`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ToolLayout {
    pub offset_m: [f64; 3],
    pub radius_m: f64,
    pub points_m: Vec<[f64; 3]>,
}

/// `[control]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ControlLayout {
    pub rate_hz: f64,
    pub strategy: String,
    pub force_limit_N: f64,
    pub force_gain: f64,
    pub activation_ramp_ms: f64,
    pub slew_N_per_s: f64,
    pub stale_ramp_ms: f64,
    pub passivity_reserve_J: f64,
    pub passivity_power_W: f64,
    pub closure_limit_rad: f64,
    pub stop_capacity_Nm: f64,
    pub max_overruns: i64,
    pub max_device_errors: i64,
}

impl Default for ControlLayout {
    fn default() -> Self {
        let usual = Guards::default();
        Self {
            rate_hz: 1000.0,
            strategy: "auto".into(),
            force_limit_N: usual.force_limit_N,
            force_gain: usual.force_gain,
            activation_ramp_ms: usual.activation_ramp_ns as f64 * 1e-6,
            slew_N_per_s: usual.slew_N_per_s,
            stale_ramp_ms: usual.stale_ramp_ns as f64 * 1e-6,
            passivity_reserve_J: usual.passivity_reserve_J,
            passivity_power_W: usual.passivity_power_W,
            closure_limit_rad: usual.closure_limit_rad,
            stop_capacity_Nm: usual.stop_capacity_Nm,
            max_overruns: usual.max_overruns.into(),
            max_device_errors: usual.max_device_errors.into(),
        }
    }
}

/// `[simulation]`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct SimulationLayout {
    pub start_m: Option<[f64; 2]>,
}

/// What the actuators of a device are, each in its place.
pub(super) struct CheckedActuators {
    pub names: Vec<Id>,
    pub actuators: Actuators,
    pub residual_Nm: ActuatorVector,
    pub imperfections: Imperfections,
}

/// Checks the `[[actuators]]` of a linkage that has `expected` shafts.
pub(super) fn check_actuators(
    layouts: &[ActuatorLayout],
    mechanism: &str,
    expected: usize,
) -> Result<CheckedActuators, FieldError> {
    if layouts.len() != expected {
        let allowed = format!("a {mechanism} has {expected}, in the order of its shafts");
        return Err(FieldError::new("actuators", format!("{} entries", layouts.len()), allowed));
    }
    let mut names: Vec<Id> = Vec::new();
    let mut kinds = [ActuatorKind::default(); MAX_ACTUATORS];
    for (i, layout) in layouts.iter().enumerate() {
        let outer = format!("actuators[{i}]");
        let (name, kind) = layout.check().map_err(|refusal| refusal.within(&outer))?;
        if names.contains(&name) {
            return Err(FieldError::new("name", name, "must be unique").within(&outer));
        }
        names.push(name);
        kinds[i] = kind;
    }
    Ok(CheckedActuators {
        names,
        actuators: Actuators {
            kinds,
            max_torque_Nm: per_actuator(layouts, 0.0, |one| one.max_torque_Nm),
            counts_per_revolution: per_actuator(layouts, 1.0, |one| {
                one.counts_per_revolution as f64
            }),
            lag_s: per_actuator(layouts, 0.0, |one| one.lag_s),
            resolution_Nm: per_actuator(layouts, 0.0, |one| one.resolution_Nm),
            weight: per_actuator(layouts, 1.0, |one| one.weight),
            hysteresis_Nm: per_actuator(layouts, 0.0, |one| one.hysteresis * one.max_torque_Nm),
            damping_N_m_s_per_rad: per_actuator(layouts, 0.0, |one| one.damping_N_m_s_per_rad),
        },
        residual_Nm: per_actuator(layouts, 0.0, |one| one.residual_torque_Nm),
        imperfections: Imperfections {
            hysteresis: per_actuator(layouts, 0.0, |one| one.hysteresis),
            backlash_rad: per_actuator(layouts, 0.0, |one| one.backlash_rad),
        },
    })
}

impl ActuatorLayout {
    fn check(&self) -> Result<(Id, ActuatorKind), FieldError> {
        let name = Id::parse("name", &self.name)?;
        let kind = match self.kind.as_str() {
            "brake" => ActuatorKind::Brake,
            "motor" => ActuatorKind::Motor,
            other => {
                return Err(FieldError::new(
                    "kind",
                    quoted(other),
                    "must be \"brake\" or \"motor\"",
                ));
            }
        };
        units::TORQUE_LIMIT.check("max_torque_Nm", self.max_torque_Nm)?;
        units::LAG.check("lag_s", self.lag_s)?;
        units::HOLDING_TORQUE.check("residual_torque_Nm", self.residual_torque_Nm)?;
        units::HYSTERESIS.check("hysteresis", self.hysteresis)?;
        units::BACKLASH.check("backlash_rad", self.backlash_rad)?;
        units::SHAFT_DAMPING.check("damping_N_m_s_per_rad", self.damping_N_m_s_per_rad)?;
        self.check_resolution(kind)?;
        self.check_imperfections(kind)?;
        units::WEIGHT.check("weight", self.weight)?;
        units::COUNTS.check_whole("counts_per_revolution", self.counts_per_revolution)?;
        Ok((name, kind))
    }
}

impl ActuatorLayout {
    /// Only what rubs has hysteresis, and only a brake is coupled with play here.
    fn check_imperfections(&self, kind: ActuatorKind) -> Result<(), FieldError> {
        let values = [("hysteresis", self.hysteresis), ("backlash_rad", self.backlash_rad)];
        match values.into_iter().find(|(_, value)| *value != 0.0) {
            Some((key, value)) if kind == ActuatorKind::Motor => {
                Err(FieldError::new(key, value, "needs kind = \"brake\""))
            }
            _ => Ok(()),
        }
    }

    /// A brake has no steps, and a step beyond the largest torque would leave none.
    fn check_resolution(&self, kind: ActuatorKind) -> Result<(), FieldError> {
        let (field, step_Nm) = ("resolution_Nm", self.resolution_Nm);
        units::RESOLUTION.check(field, step_Nm)?;
        if step_Nm > 0.0 && kind == ActuatorKind::Brake {
            return Err(FieldError::new(field, step_Nm, "needs kind = \"motor\""));
        }
        if step_Nm > self.max_torque_Nm {
            let allowed = format!("must be at most max_torque_Nm, {} N m", self.max_torque_Nm);
            return Err(FieldError::new(field, step_Nm, allowed));
        }
        Ok(())
    }
}

impl EncodersLayout {
    /// The home place that incremental encoders need; `None`: they are absolute.
    pub fn check(&self) -> Result<Option<[f64; 2]>, FieldError> {
        let home_m = "encoders.home_m";
        match (self.kind.as_str(), self.home_m) {
            ("absolute", None) => Ok(None),
            ("absolute", Some([x, y])) => {
                let needs = "needs kind = \"incremental\"";
                Err(FieldError::new(home_m, format!("[{x}, {y}] m"), needs))
            }
            ("incremental", Some(home_m)) => Ok(Some(home_m)),
            ("incremental", None) => {
                let needed = "is required: where the handle is when the device is homed";
                Err(FieldError::new(home_m, "(none)", needed))
            }
            (other, _) => {
                let allowed = "must be \"absolute\" or \"incremental\"";
                Err(FieldError::new("encoders.kind", quoted(other), allowed))
            }
        }
    }
}

impl HandForceLayout {
    /// The sensor, or `None`: then the force of the hand is unknown.
    pub fn check(&self) -> Result<Option<ForceSensor>, FieldError> {
        match self.kind.as_str() {
            "sensor" => {
                let noise_rms_N = self.noise_rms_N.unwrap_or(0.05);
                let bias_N = self.bias_N.unwrap_or(0.1);
                units::SENSOR_ERROR.check("hand_force.noise_rms_N", noise_rms_N)?;
                units::SENSOR_ERROR.check("hand_force.bias_N", bias_N)?;
                Ok(Some(ForceSensor { noise_rms_N, bias_N }))
            }
            "none" => {
                for (key, value) in [("noise_rms_N", self.noise_rms_N), ("bias_N", self.bias_N)] {
                    if let Some(value) = value {
                        let field = format!("hand_force.{key}");
                        return Err(FieldError::new(field, value, "needs kind = \"sensor\""));
                    }
                }
                Ok(None)
            }
            other => {
                let allowed = "must be \"sensor\" or \"none\"";
                Err(FieldError::new("hand_force.kind", quoted(other), allowed))
            }
        }
    }
}

impl MountLayout {
    /// Puts the pose of the device's plane into the settings.
    pub fn check(&self, settings: &mut Settings) -> Result<(), FieldError> {
        settings.set("mount.position_m", &Setting::MountPosition_m(self.position_m))?;
        let orientation = Setting::MountOrientation_xyzw(self.orientation_xyzw);
        settings.set("mount.orientation_xyzw", &orientation)
    }
}

impl ToolLayout {
    /// Puts what is fixed to the handle into the settings.
    pub fn check(&self, settings: &mut Settings) -> Result<(), FieldError> {
        settings.set("tool.offset_m", &Setting::ToolOffset_m(self.offset_m))?;
        settings.set("tool.radius_m", &Setting::ToolRadius_m(self.radius_m))?;
        settings.set("tool.points_m", &Setting::ToolPoints_m(self.points_m.clone()))
    }
}

impl ControlLayout {
    /// Puts law and guards into the settings; the tick period.
    pub fn check(&self, settings: &mut Settings) -> Result<u64, FieldError> {
        for (key, setting) in [
            ("strategy", Setting::Strategy(self.strategy()?)),
            ("force_limit_N", Setting::ForceLimit_N(self.force_limit_N)),
            ("force_gain", Setting::ForceGain(self.force_gain)),
            ("activation_ramp_ms", Setting::ActivationRamp_ms(self.activation_ramp_ms)),
            ("slew_N_per_s", Setting::Slew_N_per_s(self.slew_N_per_s)),
            ("stale_ramp_ms", Setting::StaleRamp_ms(self.stale_ramp_ms)),
            ("passivity_reserve_J", Setting::PassivityReserve_J(self.passivity_reserve_J)),
            ("passivity_power_W", Setting::PassivityPower_W(self.passivity_power_W)),
            ("closure_limit_rad", Setting::ClosureLimit_rad(self.closure_limit_rad)),
            ("stop_capacity_Nm", Setting::StopCapacity_Nm(self.stop_capacity_Nm)),
            ("max_overruns", Setting::MaxOverruns(self.max_overruns)),
            ("max_device_errors", Setting::MaxDeviceErrors(self.max_device_errors)),
        ] {
            settings.set(&format!("control.{key}"), &setting)?;
        }
        let rate_hz = units::RATE.check("control.rate_hz", self.rate_hz)?;
        Ok((1e9 / rate_hz).round() as u64)
    }

    fn strategy(&self) -> Result<Strategy, FieldError> {
        self.strategy.parse().map_err(|_| {
            let names = Strategy::ALL.map(|strategy| quoted(strategy.name())).join(", ");
            let allowed = format!("must be one of {names}");
            FieldError::new("control.strategy", quoted(&self.strategy), allowed)
        })
    }
}

/// One number per actuator, `beyond` after the last.
pub(super) fn per_actuator(
    layouts: &[ActuatorLayout],
    beyond: f64,
    number: impl Fn(&ActuatorLayout) -> f64,
) -> ActuatorVector {
    ActuatorVector::from_fn(|i, _| layouts.get(i).map_or(beyond, &number))
}

/// Text as a refusal shows it.
pub(super) fn quoted(text: &str) -> String {
    format!("{text:?}")
}
