//! What a tick tells the rest of the world: asked, possible, felt, and why.
//!
//! Plain data of fixed size, in W at the tool point T, so that it can be copied through a
//! ring. A [`Record`] adds how long the tick took; telemetry lives on it.

use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::{DeviceError, Fault, Inputs, Limits, Mode};
use crate::actuation::{Bounds, Region, Strategy};
use crate::environment::{MAX_TOUCHES, Source};
use crate::notation::{ActuatorVector, PlaneVector};

/// Force and moment in W, at and about T.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Wrench {
    /// Newtons.
    pub force_N: Vector3<f64>,
    /// Newton metres.
    pub moment_Nm: Vector3<f64>,
}

impl Wrench {
    /// Adds a force that acts at an arm from T.
    pub fn add(&mut self, force_N: &Vector3<f64>, arm_m: &Vector3<f64>) {
        self.force_N += force_N;
        self.moment_Nm += arm_m.cross(force_N);
    }
}

/// Where the rendered wrench comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum RenderedSource {
    /// The force sensor.
    Measured,
    /// The commanded torques through the linkage.
    Modelled,
    /// Neither is known.
    #[default]
    Unknown,
}

/// What one surface did in a tick.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct ContactResult {
    /// Scene or controller.
    pub source: Source,
    /// Object slot or contact id.
    pub id: u32,
    /// How deep the tool is, metres.
    pub depth_m: f64,
    /// Normal force asked for after the force limit, newtons.
    pub normal_N: f64,
    /// Friction force asked for, newtons.
    pub friction_N: f64,
    /// Friction holds the tool where it is.
    pub sticking: bool,
}

/// Something that happened, with what it happened to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Event {
    /// A surface was entered.
    ContactBegin { source: Source, id: u32 },
    /// A surface was left.
    ContactEnd { source: Source, id: u32 },
    /// The handle is held although the hand pulls where it should be free.
    StuckBegin,
    /// It moves again.
    StuckEnd,
    /// The mode changed.
    Mode(Mode),
    /// The controller's command ran out.
    Stale,
    /// A fault latched.
    Fault(Fault),
    /// Buttons held now.
    Button(u32),
}

/// Most events that one tick can report; more are dropped, their ids are not.
pub const MAX_EVENTS: usize = 8;

/// Everything that one tick sensed and decided.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Report {
    /// Number of the tick, from 1.
    pub tick: u64,
    /// Device clock at the tick.
    pub time_ns: u64,
    /// Mode in which it ran.
    pub mode: Mode,
    /// The latched fault.
    pub fault: Option<Fault>,
    /// Tool point in W.
    pub p_WT_m: Vector3<f64>,
    /// Orientation of the tool in W.
    pub q_WT: UnitQuaternion<f64>,
    /// Velocity of the tool point in W.
    pub v_WT_m_per_s: Vector3<f64>,
    /// Angular velocity in W.
    pub omega_WT_rad_per_s: Vector3<f64>,
    /// Tool point kept on the surfaces.
    pub proxy_W_m: Vector3<f64>,
    /// What the hand applies; `None` without a sensor.
    pub hand: Option<Wrench>,
    /// What was asked, raw.
    pub requested: Wrench,
    /// What the law chose from what the actuators can do.
    pub achievable: Wrench,
    /// What was felt.
    pub rendered: Wrench,
    /// Where `rendered` comes from.
    pub rendered_source: RenderedSource,
    /// `None`: nothing asked, or the handle at rest.
    pub region: Option<Region>,
    /// Angle between what was asked and what the law chose; `None`: not defined.
    pub approximation_angle_rad: Option<f64>,
    /// Distance between `achievable` and the request clipped to limit and range.
    pub force_error_N: Option<f64>,
    /// It is known where the encoders count from, and so where the handle is.
    pub homed: bool,
    /// Held where it should be free.
    pub stuck: bool,
    /// Reasons for less.
    pub limits: Limits,
    /// The law that chose; `None` while nothing is rendered.
    pub law: Option<Strategy>,
    /// Surfaces entered.
    pub contacts: [ContactResult; MAX_TOUCHES],
    /// How many of `contacts` count.
    pub contact_count: usize,
    /// Buttons held.
    pub buttons: u32,
    /// The controller's command in force, 0 for none.
    pub command_seq: u64,
    /// First tick on which `command_seq` is in force.
    pub command_new: bool,
    /// Ticks from the State it was computed from to this one; 0: it does not say which.
    pub command_lag_ticks: u64,
    /// From the sensing it was computed from to now, nanoseconds; 0: it does not say which.
    pub command_age_ns: u64,
    /// Revision of the resident scene.
    pub scene_revision: u64,
    /// Number of the last event ever.
    pub last_event: u64,
    /// Events of this tick, the newest last; the last has number `last_event`.
    pub events: [Option<Event>; MAX_EVENTS],
    /// Shaft angles, radians.
    pub shaft_rad: ActuatorVector,
    /// Shaft rates, radians per second.
    pub shaft_rad_per_s: ActuatorVector,
    /// What each actuator could give.
    pub bounds: Bounds,
    /// What each was told: capacity or torque.
    pub commanded_Nm: ActuatorVector,
    /// Handle in B, for drawing and analysis.
    pub p_BH: PlaneVector,
}

impl Report {
    /// The surfaces entered.
    pub fn contacts(&self) -> &[ContactResult] {
        &self.contacts[..self.contact_count.min(MAX_TOUCHES)]
    }

    /// Events of this tick with their numbers.
    pub fn events(&self) -> impl Iterator<Item = (u64, Event)> {
        let count = self.events.iter().flatten().count() as u64;
        let first = (self.last_event + 1).saturating_sub(count);
        (first..).zip(self.events.iter().flatten().copied())
    }
}

/// A report with the tick's own timing, nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Record {
    /// What the tick decided.
    pub report: Report,
    /// From when the tick was due to when it began.
    pub wakeup_lateness_ns: u64,
    /// Commands obeyed and the law, device aside.
    pub execution_ns: u64,
    /// Reading and writing the device.
    pub device_io_ns: u64,
    /// The tick was not done when the next was due.
    pub overrun: bool,
    /// Ticks before this one that were never run, because their time was over.
    pub skipped_ticks: u64,
    /// Reports so far that found no room on their way to the stream.
    pub reports_dropped: u64,
    /// The device failed in this tick.
    pub device_error: Option<DeviceError>,
    /// What the tick was given.
    pub inputs: Inputs,
}
