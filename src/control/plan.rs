//! The immutable configuration of a tick, built and checked elsewhere.

use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::actuation::{ActuatorKind, Strategy};
use crate::environment::{MAX_POINTS, SceneItem};
use crate::mechanism::Mechanism;
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector};

/// Pose of the device's plane in W.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mount {
    /// Origin of B in W.
    pub p_WB_m: Vector3<f64>,
    /// Turns vectors of B into W.
    pub q_WB: UnitQuaternion<f64>,
}

impl Default for Mount {
    fn default() -> Self {
        Self { p_WB_m: Vector3::zeros(), q_WB: UnitQuaternion::identity() }
    }
}

/// What is fixed to the handle.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Tool {
    /// From H to T, along the axes of B, metres; on a device with three freedoms as the
    /// handle is at phi = 0, and turned with it.
    pub offset_B_m: Vector3<f64>,
    /// Radius of the tool, metres, at each of its contact points.
    pub radius_m: f64,
    /// From T to where the tool can be touched, along its own axes, metres.
    pub points_T_m: [Vector3<f64>; MAX_POINTS],
    /// How many of `points_T_m` count; none: it is touched at T.
    pub point_count: usize,
}

impl Tool {
    /// Where it can be touched, from T; none: at T itself.
    pub fn points_T_m(&self) -> &[Vector3<f64>] {
        &self.points_T_m[..self.point_count.min(MAX_POINTS)]
    }
}

/// What a tick has to know of the actuators and their encoders.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Actuators {
    /// Brake or motor.
    pub kinds: [ActuatorKind; MAX_ACTUATORS],
    /// Largest torque, zero beyond the device's actuators.
    pub max_torque_Nm: ActuatorVector,
    /// Encoder counts of one turn of the shaft; 1 beyond the device's actuators.
    pub counts_per_revolution: ActuatorVector,
    /// Time constant from commanded to actual torque, seconds; 0 is at once.
    pub lag_s: ActuatorVector,
    /// Smallest step of a motor's torque; 0: none.
    pub resolution_Nm: ActuatorVector,
    /// What a torque counts among torques that give the same wrench; 1 beyond the device's
    /// actuators.
    pub weight: ActuatorVector,
    /// Width by which a brake's torque stays behind its command, N m.
    pub hysteresis_Nm: ActuatorVector,
    /// Viscous drag of each shaft.
    pub damping_N_m_s_per_rad: ActuatorVector,
}

/// Bounds on what is asked and how it may change.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Guards {
    /// A larger request is clipped to this, or to what the device can give where that is less.
    pub force_limit_N: f64,
    /// Share of everything asked by scene and controller that is wanted at all, 0 to 1; acts
    /// before anything is clipped.
    pub force_gain: f64,
    /// After Enable the force grows from nothing over this time.
    pub activation_ramp_ns: u64,
    /// Fastest change of a soft force.
    pub slew_N_per_s: f64,
    /// A silent controller's force takes this long to fade.
    pub stale_ramp_ns: u64,
    /// What the force of a controller may feed to the handle through motors beyond what the hand
    /// puts into it. Infinite: nobody looks.
    pub passivity_reserve_J: f64,
    /// What it may feed always, besides.
    pub passivity_power_W: f64,
    /// Redundant encoders may disagree by this much.
    pub closure_limit_rad: f64,
    /// What each brake holds while stopped.
    pub stop_capacity_Nm: f64,
    /// Ticks in a row, not done when the next was due, that latch a fault.
    pub max_overruns: u32,
    /// Ticks in a row without a sample that makes sense that latch a fault.
    pub max_device_errors: u32,
}

impl Default for Guards {
    fn default() -> Self {
        Self {
            force_limit_N: 1000.0,
            force_gain: 1.0,
            activation_ramp_ns: 200_000_000,
            slew_N_per_s: 2_000.0,
            stale_ramp_ns: 50_000_000,
            // A spring of 240 N/m drawn to 12 N, or 3 N over 10 cm.
            passivity_reserve_J: 0.3,
            // 60 mm/s against a drag of 5 N s/m.
            passivity_power_W: 0.02,
            closure_limit_rad: 0.2,
            stop_capacity_Nm: 0.0,
            max_overruns: 100,
            max_device_errors: 10,
        }
    }
}

/// Everything that a tick takes as given. Swapped as a whole at a tick's edge.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The linkage.
    pub mechanism: Arc<dyn Mechanism>,
    /// Its actuators.
    pub actuators: Actuators,
    /// Shaft angles at the home place, of incremental encoders; `None`: they are absolute.
    pub home_rad: Option<ActuatorVector>,
    /// Where its plane lies.
    pub mount: Mount,
    /// What it carries.
    pub tool: Tool,
    /// Time between ticks.
    pub tick_ns: u64,
    /// The rule for torques.
    pub strategy: Strategy,
    /// The bounds on requests.
    pub guards: Guards,
    /// The resident scene.
    pub scene: Box<[SceneItem]>,
    /// Its revision.
    pub scene_revision: u64,
    /// Tells this plan from every other that its device has had since it was opened.
    pub generation: u64,
}

impl Plan {
    /// Time between ticks, seconds.
    pub fn tick_s(&self) -> f64 {
        self.tick_ns as f64 * 1e-9
    }

    /// A vector of the plane in W.
    pub fn plane_to_W(&self, planar: &PlaneVector) -> Vector3<f64> {
        self.mount.q_WB * Vector3::new(planar.x, planar.y, 0.0)
    }

    /// The part of a vector of W that lies in the plane, and the part across it that the
    /// device has no freedom for.
    pub fn W_to_plane(&self, vector_W: &Vector3<f64>) -> (PlaneVector, f64) {
        let v_B = self.mount.q_WB.inverse() * vector_W;
        (PlaneVector::new(v_B.x, v_B.y, 0.0), v_B.z)
    }
}
