//! Devices by name or by file: what a device is, for whoever runs, simulates or describes it.
//!
//! A device is a TOML parameter file; the built-in ones are files too, embedded. `sim:NAME`
//! and NAME mean a built-in one; anything with a `/` or ending in `.toml` is a path, and its
//! stem is the device's identifier. A definition is complete and checked: the linkage closes,
//! the start is reachable and regular, every number lies in its range.

use std::path::Path;
use std::sync::Arc;

use super::device_file::{CheckedActuators, DeviceLayout, check_actuators};
use super::{ConfigError, Id, Settings, error, linkage, stiffness};
use nalgebra::Vector3;

use crate::actuation::{Bounds, Capability, ShaftMotion, Strategy};
use crate::control::{Actuators, Guards, Mount, Tool};
use crate::device::{ForceSensor, HandProgram, Imperfections, SimulationParameters};
use crate::mechanism::{Mechanism, Posture};
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector};
use crate::units::FieldError;

/// The built-in devices: name and file.
pub const BUILT_IN: [(&str, &str); 7] = [
    ("two-link", include_str!("../../devices/two-link.toml")),
    ("cho-2005", include_str!("../../devices/cho-2005.toml")),
    ("cho-2005-unoptimised", include_str!("../../devices/cho-2005-unoptimised.toml")),
    ("cho-2005-crossed", include_str!("../../devices/cho-2005-crossed.toml")),
    ("kim-2003", include_str!("../../devices/kim-2003.toml")),
    ("singh", include_str!("../../devices/singh.toml")),
    ("singh-brakes", include_str!("../../devices/singh-brakes.toml")),
];

/// Stiffness of the wall of Cho 2005, section 8.1.
const WALL_N_PER_M: f64 = 1e7;

/// A wall across x that a device's simulated hand meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DemoWall {
    /// Where the handle is when the tool touches, in B.
    pub handle_x_m: f64,
    /// Where the wall stands: the tool may be ahead of the handle.
    pub x_m: f64,
    /// As stiff as the device can hold.
    pub stiffness_N_per_m: f64,
}

/// A device, checked.
#[derive(Clone, Debug)]
pub struct DeviceDefinition {
    /// NAME of `devices/NAME`.
    pub name: Id,
    /// Its file, word by word.
    pub text: Arc<str>,
    /// For people.
    pub description: String,
    /// The linkage with its inertia.
    pub mechanism: Arc<dyn Mechanism>,
    /// Kinds, limits, encoders and lags.
    pub actuators: Actuators,
    /// Names of the actuators, in the order of the shafts.
    pub actuator_names: Vec<Id>,
    /// Torque of each actuator without any command.
    pub residual_Nm: ActuatorVector,
    /// Hysteresis and backlash of the simulated brakes.
    pub imperfections: Imperfections,
    /// See [`DeviceDefinition::least_damping_N_s_per_m`].
    least_damping_N_s_per_m: f64,
    /// Where the handle is when the device is homed, in B; `None`: the encoders are absolute.
    pub home_m: Option<[f64; 2]>,
    /// Shaft angles there.
    pub home_rad: Option<ActuatorVector>,
    /// `None`: the hand's force is unknown.
    pub force_sensor: Option<ForceSensor>,
    /// Where the device's plane lies.
    pub mount: Mount,
    /// What the handle carries.
    pub tool: Tool,
    /// Time between ticks.
    pub tick_ns: u64,
    /// The law to begin with.
    pub strategy: Strategy,
    /// Bounds on requests, and how much may go wrong.
    pub guards: Guards,
    /// Where a simulated handle begins, in B.
    pub start_m: [f64; 2],
    /// The linkage's parameters by name; a sign as -1 or 1, crossed tendons as -1.
    pub parameters: Vec<(String, f64)>,
    /// Mass felt at the handle without any linkage.
    pub handle_mass_kg: f64,
}

impl DeviceDefinition {
    /// The device that `name_or_path` names.
    pub fn load(name_or_path: &str) -> Result<Self, ConfigError> {
        let name = name_or_path.strip_prefix("sim:").unwrap_or(name_or_path);
        if let Some((name, text)) = BUILT_IN.iter().find(|(built_in, _)| *built_in == name) {
            return Self::from_toml(name, text, &format!("{name}.toml (built in)"));
        }
        let is_path = name.contains('/') || name.ends_with(".toml");
        if !is_path || name != name_or_path {
            let built_in = BUILT_IN.map(|(name, _)| name).join(", ");
            return Err(ConfigError::UnknownDevice { name: name_or_path.to_owned(), built_in });
        }
        let path = Path::new(name);
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        Self::from_toml(&stem, &error::read(path)?, name)
    }

    /// The device in the text of a file; `file` is for messages only.
    pub fn from_toml(name: &str, text: &str, file: &str) -> Result<Self, ConfigError> {
        let layout: DeviceLayout = error::parse(text, file)?;
        Self::build(name, text, &layout).map_err(ConfigError::field(file))
    }

    fn build(name: &str, text: &str, layout: &DeviceLayout) -> Result<Self, FieldError> {
        let name = Id::parse("file name without .toml", name)?;
        let (mechanism, parameters) =
            linkage::build(&layout.mechanism, &layout.inertia, &layout.actuators)?;
        let CheckedActuators { names, actuators, residual_Nm, imperfections } =
            check_actuators(&layout.actuators, mechanism.name(), mechanism.actuators())?;
        let mut settings = Settings::default();
        let tick_ns = layout.control.check(&mut settings)?;
        layout.mount.check(&mut settings)?;
        layout.tool.check(&mut settings)?;
        let Settings { strategy, guards, mount, tool } = settings;
        let home_m = layout.encoders.check()?;
        let home_rad = home_m
            .map(|home_m| posture_of(mechanism.as_ref(), "encoders.home_m", home_m))
            .transpose()?
            .map(|posture| posture.shaft_rad);
        Ok(Self {
            name,
            text: text.into(),
            description: layout.description.clone().unwrap_or_default(),
            start_m: check_start(mechanism.as_ref(), layout.simulation.start_m)?,
            home_m,
            home_rad,
            least_damping_N_s_per_m: stiffness::least_damping_N_s_per_m(
                mechanism.as_ref(),
                &actuators,
                &tool,
            ),
            actuators,
            actuator_names: names,
            residual_Nm,
            imperfections,
            mechanism,
            force_sensor: layout.hand_force.check()?,
            mount,
            tool,
            tick_ns,
            strategy,
            guards,
            parameters,
            handle_mass_kg: layout.inertia.handle_mass_kg,
        })
    }

    /// What its actuators can do in a posture while their shafts move like this.
    pub fn capability(
        &self,
        posture: &Posture,
        motion: &[ShaftMotion; MAX_ACTUATORS],
    ) -> Capability {
        let Actuators { kinds, max_torque_Nm, .. } = &self.actuators;
        Capability {
            reference: posture.reference,
            freedoms: self.mechanism.freedoms(),
            actuators: self.mechanism.actuators(),
            kinds: *kinds,
            bounds: Bounds::given(kinds, max_torque_Nm, motion),
            moment_length_m: self.mechanism.reach_m().1,
        }
    }

    /// The smallest damping that the handle feels in any direction anywhere in the reach, N s/m:
    /// what the viscous drag of the shafts is worth there.
    pub fn least_damping_N_s_per_m(&self) -> f64 {
        self.least_damping_N_s_per_m
    }

    /// Largest stiffness that the device can render as a wall without feeding it, N/m; infinite
    /// for devices of brakes alone, which cannot feed anything.
    pub fn largest_stiffness_N_per_m(&self) -> f64 {
        let tick_s = self.tick_ns as f64 * 1e-9;
        stiffness::largest_N_per_m(&self.actuators, tick_s, self.least_damping_N_s_per_m)
    }

    /// The wall of the experiment for this device: where `hand` looks for it, and as stiff as
    /// the actuators can hold.
    pub fn demo_wall(&self, hand: HandProgram) -> DemoWall {
        let Tool { offset_B_m, radius_m, .. } = self.tool;
        let ahead_m = |point: &Vector3<f64>| offset_B_m.x + point.x;
        let furthest_m = self.tool.points_T_m().iter().map(ahead_m).reduce(f64::max);
        let handle_x_m = hand.wall_m(self.mechanism.reach_m());
        DemoWall {
            handle_x_m,
            x_m: handle_x_m + furthest_m.unwrap_or(offset_B_m.x) + radius_m,
            stiffness_N_per_m: self.largest_stiffness_N_per_m().min(WALL_N_PER_M),
        }
    }

    /// The device as its simulation takes it, with `hand` shrunk to the linkage's reach.
    pub fn simulation(&self, hand: HandProgram) -> SimulationParameters {
        SimulationParameters {
            mechanism: Arc::clone(&self.mechanism),
            kinds: self.actuators.kinds,
            max_torque_Nm: self.actuators.max_torque_Nm,
            counts_per_revolution: self.actuators.counts_per_revolution,
            lag_s: self.actuators.lag_s,
            residual_Nm: self.residual_Nm,
            imperfections: self.imperfections,
            damping_N_m_s_per_rad: self.actuators.damping_N_m_s_per_rad,
            resolution_Nm: self.actuators.resolution_Nm,
            force_sensor: self.force_sensor,
            hand: hand.fitted(self.mechanism.reach_m()),
            start_m: self.start_m,
            incremental: self.home_m.is_some(),
        }
    }
}

/// The start as written, or halfway between the nearest and the furthest reach along x.
fn check_start(
    mechanism: &dyn Mechanism,
    written_m: Option<[f64; 2]>,
) -> Result<[f64; 2], FieldError> {
    let (nearest_m, furthest_m) = mechanism.reach_m();
    let start_m = written_m.unwrap_or([0.5 * (nearest_m + furthest_m), 0.0]);
    posture_of(mechanism, "simulation.start_m", start_m)?;
    Ok(start_m)
}

/// The posture at a place that somebody wrote.
fn posture_of(
    mechanism: &dyn Mechanism,
    field: &str,
    [x, y]: [f64; 2],
) -> Result<Posture, FieldError> {
    mechanism.posture_at(&PlaneVector::new(x, y, 0.0)).map_err(|error| {
        let allowed = format!("must be a place that the handle reaches: {error}");
        FieldError::new(field, format!("[{x}, {y}] m"), allowed)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuation::ActuatorKind;
    use crate::device::SimulatedDevice;

    const CHO: &str = BUILT_IN[1].1;

    fn refusal(text: &str) -> String {
        DeviceDefinition::from_toml("mine", text, "mine.toml").unwrap_err().to_string()
    }

    /// The file of `cho-2005` with one line changed.
    fn changed(from: &str, to: &str) -> String {
        assert!(CHO.contains(from), "{from}");
        CHO.replacen(from, to, 1)
    }

    #[test]
    fn every_built_in_device_is_what_its_name_says() {
        for (name, _) in BUILT_IN {
            let device = DeviceDefinition::load(name).unwrap();
            assert_eq!(device.name.as_str(), name);
            assert!(!device.description.is_empty());
            assert_eq!(device.actuator_names.len(), device.mechanism.actuators());
            assert_eq!((device.tick_ns, device.handle_mass_kg), (1_000_000, 0.5));
            let force_limit_N = device.guards.force_limit_N;
            assert_eq!(device.guards, Guards { force_limit_N, ..Guards::default() });
            let sensor = device.force_sensor.unwrap();
            assert_eq!((sensor.noise_rms_N, sensor.bias_N), (0.05, 0.1));
            let motors = ["kim-2003", "singh"].contains(&name);
            assert_eq!(device.guards.force_limit_N, if motors { 60.0 } else { 1000.0 });
            for i in 0..device.mechanism.actuators() {
                assert_eq!(device.actuators.counts_per_revolution[i], 65_536.0);
                assert_eq!(device.residual_Nm[i], 0.0);
                if motors {
                    assert_eq!(device.actuators.kinds[i], ActuatorKind::Motor);
                    assert!(
                        device.actuators.damping_N_m_s_per_rad[i] > 0.0
                            && device.actuators.resolution_Nm[i] > 0.0
                    );
                } else {
                    assert_eq!(device.actuators.kinds[i], ActuatorKind::Brake);
                    assert_eq!(device.actuators.max_torque_Nm[i], 20.0);
                    assert_eq!(device.actuators.lag_s[i], 2e-3);
                }
            }
            let same = DeviceDefinition::load(&format!("sim:{name}")).unwrap();
            assert_eq!(same.parameters, device.parameters);
        }
    }

    #[test]
    fn built_in_devices_have_the_published_dimensions() {
        let of = |name: &str| DeviceDefinition::load(name).unwrap().parameters;
        let numbers = |name: &str| of(name).into_iter().map(|(_, value)| value).collect::<Vec<_>>();
        assert_eq!(
            numbers("cho-2005"),
            [0.3, 0.2, 0.124, 0.291, 0.3, 0.781, 0.1, -1.0, 1.0, 1.0, 1.0]
        );
        assert_eq!(numbers("cho-2005-unoptimised")[..7], [0.3, 0.3, 0.3, 0.3, 0.3, 0.1, 0.1]);
        let crossed = of("cho-2005-crossed");
        assert!(crossed.contains(&("tendons".to_owned(), -1.0)));
        assert_eq!(of("two-link").len(), 3);
    }

    #[test]
    fn every_built_in_device_is_regular_along_the_whole_wall() {
        for (name, _) in BUILT_IN {
            let device = DeviceDefinition::load(name).unwrap();
            let scale = device.demo_wall(HandProgram::default()).handle_x_m / 0.3;
            for i in 0..=100 {
                let y_m = scale * (-0.15 + 0.005 * f64::from(i));
                let place = PlaneVector::new(0.3 * scale, y_m, 0.0);
                let posture = device.mechanism.posture_at(&place);
                assert!(posture.is_ok(), "{name} at y = {y_m}: {posture:?}");
            }
        }
    }

    #[test]
    fn every_built_in_device_can_be_simulated_with_every_hand() {
        for (name, _) in BUILT_IN {
            let device = DeviceDefinition::load(name).unwrap();
            for hand in HandProgram::all() {
                let simulated = SimulatedDevice::new(device.simulation(hand), 1);
                assert!(simulated.is_ok(), "{name}, {hand}: {:?}", simulated.err());
            }
        }
    }

    #[test]
    fn a_device_file_of_ones_own_is_named_by_its_stem() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("my-arm.toml");
        std::fs::write(&path, changed("rate_hz = 1000", "rate_hz = 4000")).unwrap();
        let device = DeviceDefinition::load(path.to_str().unwrap()).unwrap();
        assert_eq!((device.name.as_str(), device.tick_ns), ("my-arm", 250_000));
        let bad = directory.path().join("My_Arm.toml");
        std::fs::write(&bad, CHO).unwrap();
        let said = DeviceDefinition::load(bad.to_str().unwrap()).unwrap_err().to_string();
        assert!(said.contains("\"My_Arm\"") && said.contains("a-z"), "{said}");
        let missing = DeviceDefinition::load("./nowhere.toml").unwrap_err();
        assert!(matches!(missing, ConfigError::Read { .. }));
    }

    #[test]
    fn an_unknown_device_lists_the_built_in_ones() {
        for name in ["cho-2006", "sim:cho-2006", "sim:./mine.toml", ""] {
            let said = DeviceDefinition::load(name).unwrap_err().to_string();
            assert!(BUILT_IN.iter().all(|(built_in, _)| said.contains(built_in)), "{said}");
        }
    }

    #[test]
    fn the_smallest_file_is_complete() {
        let text = "[mechanism]\nkind = \"two-link\"\nl1_m = 0.2\nl2_m = 0.1\n\
                    [[actuators]]\nname = \"a\"\nkind = \"motor\"\n\
                    [[actuators]]\nname = \"b\"\nkind = \"brake\"\n";
        let device = DeviceDefinition::from_toml("tiny", text, "tiny.toml").unwrap();
        assert_eq!(device.actuators.kinds[..2], [ActuatorKind::Motor, ActuatorKind::Brake]);
        assert!(device.force_sensor.is_none());
        assert_eq!(device.mount, Mount::default());
        assert!(
            device.mechanism.posture_at(&PlaneVector::new(device.start_m[0], 0.0, 0.0)).is_ok()
        );
    }

    #[test]
    fn each_bad_value_is_refused_by_its_key_path() {
        let torque = "max_torque_Nm = 20.0";
        for (from, to, named) in [
            ("k3 = 0.781", "k3 = -0.781", "mechanism.k3 = -0.781"),
            ("k3 = 0.781", "k3 = nan", "mechanism.k3 = NaN"),
            ("k3 = 0.781", "", "mechanism.k3 = (missing)"),
            ("k3 = 0.781", "k3 = 0.781\nl1_m = 0.3", "mechanism.l1_m = (set)"),
            ("k3 = 0.781", "k3 = 0.781\nk5 = 1", "mechanism.k5 = 1: unknown field"),
            ("0.124", "1.124", "mechanism.l_m[2] = 1.124"),
            ("0.124", "inf", "mechanism.l_m[2] = inf"),
            ("lever = -1", "lever = 0", "mechanism.lever = 0"),
            ("tendons = \"straight\"", "tendons = \"loose\"", "mechanism.tendons = \"loose\""),
            ("kind = \"five-bar\"", "kind = \"six-bar\"", "mechanism.kind = \"six-bar\""),
            ("handle_mass_kg = 0.5", "handle_mass_kg = 0", "inertia.handle_mass_kg = 0"),
            (torque, "max_torque_Nm = -20.0", "actuators[0].max_torque_Nm = -20"),
            (torque, "max_torque_Nm = 20.0\ngear = 1", "actuators[0].gear: unknown field"),
            (torque, "max_torque_Nm = \"much\"", "actuators[0].max_torque_Nm: invalid type"),
            ("lag_s = 0.002", "lag_s = 2", "actuators[0].lag_s = 2"),
            (
                "residual_torque_Nm = 0.0",
                "residual_torque_Nm = -1",
                "actuators[0].residual_torque_Nm = -1",
            ),
            ("hysteresis = 0.0", "hysteresis = 2", "actuators[0].hysteresis = 2"),
            ("backlash_rad = 0.0", "backlash_rad = -1", "actuators[0].backlash_rad = -1"),
            (
                "counts_per_revolution = 65536",
                "counts_per_revolution = 0",
                "actuators[0].counts_per_revolution = 0",
            ),
            (
                "shaft_inertia_kg_m2 = 0.0",
                "shaft_inertia_kg_m2 = -1",
                "actuators[0].shaft_inertia_kg_m2 = -1",
            ),
            ("name = \"brake-2\"", "name = \"brake-1\"", "actuators[1].name = brake-1"),
            ("kind = \"brake\"", "kind = \"clutch\"", "actuators[0].kind = \"clutch\""),
            ("noise_rms_N = 0.05", "noise_rms_N = -0.05", "hand_force.noise_rms_N = -0.05"),
            ("kind = \"sensor\"", "kind = \"none\"", "hand_force.noise_rms_N = 0.05"),
            ("position_m = [0.0,", "position_m = [nan,", "mount.position_m[0] = NaN"),
            ("[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 0.0, 2.0]", "mount.orientation_xyzw = 2"),
            ("radius_m = 0.0", "radius_m = -0.1", "tool.radius_m = -0.1"),
            ("points_m = []", "points_m = [[0, 0, 0], [0, 2, 0]]", "tool.points_m[1][1] = 2"),
            ("points_m = []", "points_m = [[nan, 0, 0]]", "tool.points_m[0][0] = NaN"),
            ("points_m = []", "points_m = [[0, 0]]", "tool.points_m: invalid length"),
            (
                "points_m = []",
                "points_m = [[0,0,0],[0,0,0],[0,0,0],[0,0,0],[0,0,0],[0,0,0],[0,0,0],[0,0,0],[0,0,0]]",
                "tool.points_m = 9 points: must be at most 8",
            ),
            (
                "rate_hz = 1000",
                "rate_hz = 99",
                "control.rate_hz = 99: must be a number in 100 to 4000 Hz",
            ),
            ("strategy = \"auto\"", "strategy = \"magic\"", "control.strategy = \"magic\""),
            ("max_overruns = 100", "max_overruns = 0", "control.max_overruns = 0"),
            ("stale_ramp_ms = 50", "stale_ramp_ms = inf", "control.stale_ramp_ms = inf"),
            (
                "passivity_reserve_J = 0.3",
                "passivity_reserve_J = 0",
                "control.passivity_reserve_J = 0: must be a number in 0.001 to 1000 J",
            ),
            (
                "passivity_power_W = 0.02",
                "passivity_power_W = nan",
                "control.passivity_power_W = NaN: must be a number in 0 to 1000 W",
            ),
            ("kind = \"absolute\"", "kind = \"relative\"", "encoders.kind = \"relative\""),
            (
                "kind = \"absolute\"",
                "kind = \"incremental\"",
                "encoders.home_m = (none): is required",
            ),
            (
                "kind = \"absolute\"",
                "kind = \"absolute\"\nhome_m = [0.3, 0.1]",
                "needs kind = \"incremental\"",
            ),
            (
                "kind = \"absolute\"",
                "kind = \"incremental\"\nhome_m = [9.0, 0.1]",
                "encoders.home_m = [9, 0.1] m: must be a place",
            ),
            ("start_m = [", "start_m = [9.0, 9.0] # [", "simulation.start_m = [9, 9] m"),
            ("start_m = [", "start_m = [nan, 0.1] # [", "simulation.start_m = [NaN, 0.1] m"),
        ] {
            let said = refusal(&changed(from, to));
            assert!(said.starts_with("mine.toml:") && said.contains(named), "{named}: {said}");
        }
    }

    #[test]
    fn the_number_of_actuators_must_fit_the_linkage() {
        let more = format!("{CHO}\n[[actuators]]\nname = \"fifth\"\nkind = \"brake\"\n");
        assert!(refusal(&more).contains("actuators = 5 entries: a five-bar has 4"));
        let seven = format!("{more}{0}{0}", "[[actuators]]\nname = \"x\"\nkind = \"brake\"\n");
        assert!(refusal(&seven).contains("actuators = 7 entries"));
    }

    #[test]
    fn links_have_mass_where_the_file_says_so() {
        let link = "{ mass_kg = 0.1, centre_m = 0.1, inertia_kg_m2 = 0.001 }";
        let links = |n| changed("links = []", &format!("links = [{}]", vec![link; n].join(", ")));
        let device = DeviceDefinition::from_toml("mine", &links(4), "mine.toml").unwrap();
        assert!(device.mechanism.inertia_varies());
        assert!(refusal(&links(3)).contains("inertia.links = 3 entries: must be none or 4"));
    }

    #[test]
    fn a_tool_has_the_points_that_its_file_says() {
        assert!(DeviceDefinition::load("cho-2005").unwrap().tool.points_T_m().is_empty());
        let text = changed("points_m = []", "points_m = [[0.03, 0.02, 0], [-0.03, 0.02, 0.01]]");
        let device = DeviceDefinition::from_toml("mine", &text, "mine.toml").unwrap();
        let points = [Vector3::new(0.03, 0.02, 0.0), Vector3::new(-0.03, 0.02, 0.01)];
        assert_eq!(device.tool.points_T_m(), points);
    }

    #[test]
    fn motor_devices_hold_one_to_three_kN_per_m_and_brakes_any_stiffness() {
        for (name, _) in BUILT_IN {
            let device = DeviceDefinition::load(name).unwrap();
            let largest_N_per_m = device.largest_stiffness_N_per_m();
            let wall = device.demo_wall(HandProgram::default());
            if ["kim-2003", "singh"].contains(&name) {
                assert!((1e3..3e3).contains(&largest_N_per_m), "{name}: {largest_N_per_m}");
                assert_eq!(wall.stiffness_N_per_m, largest_N_per_m);
                // No tick of 1 ms and a lag of 0.5 ms make more of so much damping.
                let of_damping = device.least_damping_N_s_per_m() / 1e-3;
                assert!((largest_N_per_m / of_damping - 1.0).abs() < 1e-12);
            } else {
                assert_eq!((largest_N_per_m, wall.stiffness_N_per_m), (f64::INFINITY, 1e7));
            }
        }
    }

    #[test]
    fn the_wall_of_the_demo_is_where_the_hand_gets_to_with_its_tool() {
        let wall =
            |name: &str| DeviceDefinition::load(name).unwrap().demo_wall(HandProgram::default());
        assert_eq!((wall("cho-2005").x_m, wall("two-link").x_m), (0.3, 0.3));
        let kim = wall("kim-2003");
        assert!((kim.x_m - kim.handle_x_m - 0.015).abs() < 1e-12);
        assert!((0.03..0.07).contains(&kim.handle_x_m), "{kim:?}");
    }

    #[test]
    fn drag_and_steps_of_an_actuator_have_their_ranges() {
        let with = |line: &str| {
            let (_, singh) = BUILT_IN.into_iter().find(|(name, _)| *name == "singh").unwrap();
            let text = singh.replacen("resolution_Nm = 0.001", line, 1);
            DeviceDefinition::from_toml("mine", &text, "mine.toml")
        };
        assert_eq!(with("resolution_Nm = 0.5").unwrap().actuators.resolution_Nm[0], 0.5);
        for (line, said) in [
            ("resolution_Nm = -1", "actuators[0].resolution_Nm = -1: must be a number in 0 to"),
            ("resolution_Nm = 2.5", "resolution_Nm = 2.5: must be at most max_torque_Nm, 2 N m"),
            ("resolution_Nm = 0.1\nshaft_inertia_kg_m2 = nan", "shaft_inertia_kg_m2 = NaN"),
        ] {
            let refused = with(line).unwrap_err().to_string();
            assert!(refused.contains(said), "{refused}");
        }
        let brake = changed("lag_s = 0.002", "lag_s = 0.002\nresolution_Nm = 0.1");
        assert!(refusal(&brake).contains("resolution_Nm = 0.1: needs kind = \"motor\""));
        let drag = changed("damping_N_m_s_per_rad = 0.0", "damping_N_m_s_per_rad = -1");
        assert!(
            refusal(&drag).contains("damping_N_m_s_per_rad = -1: must be a number in 0 to 100")
        );
        let plate = changed("links = []", "links = []\nhandle_inertia_kg_m2 = 0.001");
        assert!(refusal(&plate).contains("handle_inertia_kg_m2 = 0.001: a five-bar does not turn"));
    }

    #[test]
    fn every_key_of_the_cho_2005_file_has_a_comment() {
        let lines: Vec<_> = CHO.lines().collect();
        for (above, line) in lines.iter().zip(&lines[1..]) {
            let key = line.contains('=') && !line.starts_with('#');
            assert!(!key || above.starts_with('#') || line.contains('#'), "{line}");
        }
    }
}
