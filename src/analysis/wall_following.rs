//! The wall-following experiment of Cho 2005, section 8, as one function: configuration in,
//! figures of one slide out.
//!
//! The loop is sample, tick, write, once a millisecond of virtual time, and everything is
//! measured on the plant itself, behind encoders and force sensor. Frames are those of B.
//!
//! | figure | how |
//! |---|---|
//! | stuck | time of the slide below 1 mm/s |
//! | penetration | deepest since the hand first came near the wall |
//! | hand force | what the hand pulls along the wall while it slides |
//! | rms jerk | of the velocity, second differences over 1 ms after two moving means of 20 ms |
//! | force step | largest change within 1 ms of what the actuators put on the handle |
//! | switches | changes, per second, of which brake gives the most normal force |
//!
//! The same experiment gives the same figures, bit for bit.

use super::smoothness::{STUCK_M_PER_S, largest_step, root_mean, squared_jerks};
use crate::actuation::Strategy;
use crate::config::{ConfigError, DeviceDefinition, Scene, build_plan};
use crate::control::{ControlState, Mode, Setpoint, TickInput, tick};
use crate::device::{Device, HandProgram, SimulatedDevice, SlideProgram, Truth};
use crate::environment::{Element, Material, SceneItem, Shape, Surface};
use crate::mechanism::{KinematicsError, Mechanism};
use crate::notation::{ActuatorVector, PlaneVector};
use nalgebra::Vector3;

/// Most ticks of one run: the hand gives up long before.
const MAX_TICKS: u64 = 30_000;

/// One run.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// Name of a built-in device.
    pub device: String,
    /// The law.
    pub strategy: Strategy,
    /// What the hand does.
    pub hand: SlideProgram,
    /// Stiffness of the wall.
    pub stiffness_N_per_m: f64,
    /// Where the wall is along x; its normal is -x.
    pub wall_x_m: f64,
    /// Brake lag of plant and plan; `None`: the device's.
    pub lag_s: Option<f64>,
    /// Encoder counts per turn; `None`: the device's.
    pub counts: Option<f64>,
    /// The hand force is measured.
    pub sensor: bool,
    /// Noise of the sensor.
    pub seed: u64,
}

impl Default for Experiment {
    fn default() -> Self {
        Self {
            device: "cho-2005".to_owned(),
            strategy: Strategy::Sliding,
            hand: SlideProgram::default(),
            stiffness_N_per_m: 1e7,
            wall_x_m: 0.3,
            lag_s: None,
            counts: None,
            sensor: true,
            seed: 1,
        }
    }
}

/// What came of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Figures {
    /// Length of the slide.
    pub slide_s: f64,
    /// Time stuck in it.
    pub stuck_s: f64,
    /// Deepest penetration, from first contact.
    pub penetration_mm: f64,
    /// Deepest penetration while sliding.
    pub sliding_mm: f64,
    /// Mean force of the hand along the wall.
    pub hand_mean_N: f64,
    /// Largest.
    pub hand_max_N: f64,
    /// Root mean square of the jerk.
    pub jerk_rms_m_per_s3: f64,
    /// Largest change of the force at the handle in one tick.
    pub step_max_N: f64,
    /// Changes of the leading brake.
    pub switches_per_s: f64,
    /// Where the slide ended.
    pub end_y_m: f64,
}

/// Why an experiment did not begin.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// There is no such device.
    #[error(transparent)]
    Device(#[from] ConfigError),
    /// Its handle cannot begin where it should.
    #[error("the handle cannot begin there: {0}")]
    Start(#[from] KinematicsError),
}

/// Runs one slide, from first touch to its end. Refuses a device that does not exist or cannot
/// begin where it should.
pub fn run(experiment: &Experiment) -> Result<Figures, ExperimentError> {
    let mut definition = DeviceDefinition::load(&experiment.device)?;
    if let Some(lag_s) = experiment.lag_s {
        definition.actuators.lag_s = ActuatorVector::repeat(lag_s);
    }
    if let Some(counts) = experiment.counts {
        definition.actuators.counts_per_revolution = ActuatorVector::repeat(counts);
    }
    definition.strategy = experiment.strategy;
    if !experiment.sensor {
        definition.force_sensor = None;
    }
    let simulation = definition.simulation(HandProgram::PressAndSlide(experiment.hand));
    let mut device = SimulatedDevice::new(simulation, experiment.seed)?;
    let mut plan = build_plan(&definition, &Scene::default());
    plan.scene = [SceneItem { slot: 0, revision: 1, element: wall(experiment) }].into();
    let mut state = ControlState::new(Mode::Enabled);
    let mut slide = Slide::default();
    for number in 1..=MAX_TICKS {
        let now_ns = number * plan.tick_ns;
        let sample = device.read(now_ns);
        let truth = device.truth();
        if slide.over(&truth) {
            break;
        }
        slide.see(&truth, definition.mechanism.as_ref(), experiment.wall_x_m);
        let input = TickInput {
            sample,
            setpoint: &Setpoint::NONE,
            plan: &plan,
            now_ns,
            overruns_in_row: 0,
        };
        let decision = tick(&mut state, &input);
        // A simulated device takes every command.
        let _ = device.write(&decision.commands);
    }
    Ok(slide.figures(plan.tick_s()))
}

fn wall(experiment: &Experiment) -> Element {
    Element::Surface(Surface {
        shape: Shape::HalfSpace {
            point_W_m: Vector3::new(experiment.wall_x_m, 0.0, 0.0),
            normal_W: -Vector3::x(),
        },
        material: Material {
            stiffness_N_per_m: experiment.stiffness_N_per_m,
            ..Material::default()
        },
        hollow: false,
        blend_s: 0.0,
    })
}

/// A slide while it is watched.
#[derive(Debug, Default)]
struct Slide {
    deepest_m: Option<f64>,
    sliding_m: Option<f64>,
    velocity: Vec<PlaneVector>,
    pull_N: Vec<f64>,
    force_N: Vec<PlaneVector>,
    leading: Option<usize>,
    switches: u32,
    end_y_m: f64,
}

impl Slide {
    fn over(&self, truth: &Truth) -> bool {
        truth.hand.buttons == 0 && !self.pull_N.is_empty()
    }

    fn see(&mut self, truth: &Truth, mechanism: &dyn Mechanism, wall_x_m: f64) {
        let depth_m = truth.p_BH.x - wall_x_m;
        self.deepest_m = Some(self.deepest_m.map_or(depth_m, |deepest_m| deepest_m.max(depth_m)));
        if truth.hand.buttons == 0 {
            return;
        }
        self.sliding_m = Some(self.sliding_m.map_or(depth_m, |deepest_m| deepest_m.max(depth_m)));
        self.velocity.push(truth.v_BH);
        self.pull_N.push(truth.hand.F_hand_BH_N.y.abs());
        self.end_y_m = truth.p_BH.y;
        let Ok(posture) = mechanism.posture_at(&truth.p_BH) else { return };
        self.force_N.push(posture.reference * truth.torque_Nm);
        let normal_N = posture.reference.row(0).transpose().component_mul(&truth.torque_Nm).abs();
        let leading = (normal_N.max() > 0.1).then(|| normal_N.imax());
        self.switches += u32::from(leading != self.leading);
        self.leading = leading;
    }

    fn figures(&self, tick_s: f64) -> Figures {
        let slide_s = self.pull_N.len() as f64 * tick_s;
        let stuck = self.velocity.iter().filter(|v| v.y.abs() < STUCK_M_PER_S).count();
        Figures {
            slide_s,
            stuck_s: stuck as f64 * tick_s,
            penetration_mm: 1e3 * self.deepest_m.unwrap_or(0.0),
            sliding_mm: 1e3 * self.sliding_m.unwrap_or(0.0),
            hand_mean_N: self.pull_N.iter().fold(0.0, |sum, N| sum + N)
                / self.pull_N.len().max(1) as f64,
            hand_max_N: self.pull_N.iter().copied().fold(0.0, f64::max),
            jerk_rms_m_per_s3: root_mean(&squared_jerks(&self.velocity, tick_s)),
            step_max_N: largest_step(&self.force_N),
            switches_per_s: f64::from(self.switches) / slide_s.max(tick_s),
            end_y_m: self.end_y_m,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures(strategy: Strategy, sensor: bool, lag_s: f64, counts: f64) -> Figures {
        let (lag_s, counts) = (Some(lag_s), Some(counts));
        run(&Experiment { strategy, sensor, lag_s, counts, ..Experiment::default() }).unwrap()
    }

    const LAGS_S: [f64; 4] = [0.0, 2e-3, 0.01, 0.03];

    /// A perfect law's hand is stuck for 0.26 s, pulls 6.57 N in the mean and 15.5 N at most
    /// (the bound below under this hand, as another simulation of the experiment has it).
    fn near_the_bound(found: &Figures) {
        assert!((found.end_y_m + 0.15).abs() < 1e-3 && found.slide_s < 5.4, "{found:?}");
        assert!((0.15..0.35).contains(&found.stuck_s), "{found:?}");
        assert!((6.57..6.57 * 1.08).contains(&found.hand_mean_N), "{found:?}");
        assert!((15.0..18.5).contains(&found.hand_max_N), "{found:?}");
    }

    #[test]
    fn with_a_sensor_sliding_is_smooth_and_stays_at_the_wall_at_every_lag() {
        for lag_s in LAGS_S {
            let found = figures(Strategy::Auto, true, lag_s, 65_536.0);
            near_the_bound(&found);
            assert!((0.08..0.3).contains(&found.penetration_mm), "{found:?}");
            assert!((5.0..40.0).contains(&found.jerk_rms_m_per_s3), "{found:?}");
            assert!((0.5..10.0).contains(&found.step_max_N), "{found:?}");
            assert!((0.3..3.0).contains(&found.switches_per_s), "{found:?}");
        }
    }

    #[test]
    fn without_one_it_goes_a_little_deeper() {
        for lag_s in LAGS_S {
            let found = figures(Strategy::Auto, false, lag_s, 65_536.0);
            near_the_bound(&found);
            assert!((0.08..0.6).contains(&found.penetration_mm), "{found:?}");
            assert!((5.0..40.0).contains(&found.jerk_rms_m_per_s3), "{found:?}");
            assert!((0.3..4.0).contains(&found.switches_per_s), "{found:?}");
        }
    }

    #[test]
    fn coarse_encoders_make_it_rougher() {
        for (sensor, most_mm) in [(true, 0.4), (false, 1.6)] {
            let found = figures(Strategy::Auto, sensor, 2e-3, 4_096.0);
            near_the_bound(&found);
            assert!((0.1..most_mm).contains(&found.penetration_mm), "{found:?}");
            assert!((20.0..100.0).contains(&found.jerk_rms_m_per_s3), "{found:?}");
        }
    }

    /// The figures that the law is there to improve, by the name that still selects them.
    #[test]
    fn predicted_velocity_is_as_rough_as_it_was() {
        let found = figures(Strategy::PredictedVelocity, true, 0.0, 65_536.0);
        assert!((150.0..300.0).contains(&found.jerk_rms_m_per_s3), "{found:?}");
        assert!((50.0..120.0).contains(&found.step_max_N), "{found:?}");
        assert!((200.0..500.0).contains(&found.switches_per_s), "{found:?}");
        let late = figures(Strategy::PredictedVelocity, true, 0.03, 65_536.0);
        assert!((1.0..8.0).contains(&late.penetration_mm), "{late:?}");
    }

    /// The least drag of any passive way to hold the wall, per newton of press: the vertices of
    /// the linear programme `min -t.F, n.F = 1` over the brakes' reactions are single brakes.
    fn least_drag(mechanism: &dyn Mechanism, y_m: f64) -> f64 {
        let posture = mechanism.posture_at(&PlaneVector::new(0.3, y_m, 0.0)).unwrap();
        let of = |i: usize| {
            let (x, y) = (posture.reference[(0, i)], posture.reference[(1, i)]);
            // n = -x, sliding along -y: the reaction resists where it points to +y.
            -y / x
        };
        (0..4).map(of).filter(|drag| *drag > 0.0).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn the_passive_bound_is_a_sawtooth_of_5_and_at_most_15_newtons() {
        let device = DeviceDefinition::load("cho-2005").unwrap();
        let drag_N: Vec<f64> = (0..=5_000)
            .map(|k| 10.0 * least_drag(device.mechanism.as_ref(), 0.35 - 1e-4 * f64::from(k)))
            .collect();
        let mean_N = drag_N.iter().sum::<f64>() / drag_N.len() as f64;
        let most_N = drag_N.iter().copied().fold(0.0, f64::max);
        assert!((mean_N - 5.31).abs() < 0.02, "{mean_N}");
        assert!((most_N - 15.47).abs() < 0.05, "{most_N}");
        let jumps = drag_N.windows(2).filter(|pair| pair[1] < pair[0] - 5.0).count();
        assert_eq!(jumps, 2);
        assert!(drag_N.windows(2).all(|pair| pair[1] < pair[0] + 0.5), "all jumps are drops");
    }

    /// For whoever tunes: every figure of every case, `cargo test table -- --ignored --nocapture`.
    #[test]
    #[ignore = "prints a table, judges nothing"]
    fn table() {
        for strategy in [Strategy::PredictedVelocity, Strategy::Auto] {
            for sensor in [true, false] {
                let coarse = [(2e-3, 4_096.0)];
                for (lag_s, counts) in LAGS_S.map(|lag_s| (lag_s, 65_536.0)).iter().chain(&coarse) {
                    let f = figures(strategy, sensor, *lag_s, *counts);
                    println!(
                        "{strategy}, sensor {sensor}, {lag_s} s, {counts}: stuck {:.2} s, {:.2} mm, \
                         {:.2} and {:.1} N, jerk {:.0}, step {:.1} N, {:.1} switches/s",
                        f.stuck_s,
                        f.penetration_mm,
                        f.hand_mean_N,
                        f.hand_max_N,
                        f.jerk_rms_m_per_s3,
                        f.step_max_N,
                        f.switches_per_s
                    );
                }
            }
        }
    }
}
