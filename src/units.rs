//! The border between what people write and what the mathematics uses: checked quantities.
//!
//! Inside the crate a quantity is a plain SI `f64` whose name carries its unit. Where one
//! comes in (device file, configuration, gRPC, stream) it passes a [`Range`] exactly once;
//! a refusal is a [`FieldError`] that names the field, the value, and what is allowed.

use std::fmt;

use nalgebra::Vector3;

/// One field that cannot be accepted, and why.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{field} = {value}: {allowed}")]
pub struct FieldError {
    /// Path of the field as its author wrote it, such as `actuators[2].max_torque_Nm`.
    pub field: String,
    /// The value found there.
    pub value: String,
    /// What is allowed, with range and unit.
    pub allowed: String,
}

impl FieldError {
    /// A refusal of `value` in `field`.
    pub fn new(
        field: impl Into<String>,
        value: impl fmt::Display,
        allowed: impl Into<String>,
    ) -> Self {
        Self { field: field.into(), value: value.to_string(), allowed: allowed.into() }
    }

    /// The same refusal seen from the outside: `outer.field`.
    #[must_use]
    pub fn within(mut self, outer: &str) -> Self {
        self.field = format!("{outer}.{}", self.field);
        self
    }
}

/// A closed interval of a physical quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Smallest allowed value.
    pub min: f64,
    /// Largest allowed value.
    pub max: f64,
    /// Unit, for messages.
    pub unit: &'static str,
}

impl Range {
    /// `min..=max` in `unit`.
    pub const fn new(min: f64, max: f64, unit: &'static str) -> Self {
        Self { min, max, unit }
    }

    /// The value itself when it is finite and inside.
    pub fn check(&self, field: &str, value: f64) -> Result<f64, FieldError> {
        if value >= self.min && value <= self.max {
            Ok(value)
        } else {
            Err(FieldError::new(field, value, format!("must be a number in {self}")))
        }
    }

    /// Each component of a vector, as `field.x` to `field.z`.
    pub fn check_vector(&self, field: &str, vector: &Vector3<f64>) -> Result<(), FieldError> {
        for (axis, &value) in ["x", "y", "z"].iter().zip(vector) {
            self.check(&format!("{field}.{axis}"), value)?;
        }
        Ok(())
    }

    /// The value as a count, when it is inside a range that holds no negative number.
    pub fn check_whole(&self, field: &str, value: i64) -> Result<u64, FieldError> {
        self.check(field, value as f64)?;
        let refusal =
            |_| FieldError::new(field, value, format!("must be a whole number in {self}"));
        u64::try_from(value).map_err(refusal)
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} to {} {}", self.min, self.max, self.unit)
    }
}

/// Position of anything in W: a building's worth.
pub const POSITION: Range = Range::new(-100.0, 100.0, "m");
/// Radius of a body, or half of its edge.
pub const RADIUS: Range = Range::new(1e-4, 100.0, "m");
/// Room around a path that leads; 0: none.
pub const GUIDE_RADIUS: Range = Range::new(0.0, 100.0, "m");
/// Where a field ends; 0: nowhere.
pub const FIELD_RADIUS: Range = Range::new(0.0, 100.0, "m");
/// Stiffness of a surface; the wall of Cho 2005 has 1e7 N/m.
pub const STIFFNESS: Range = Range::new(0.0, 1e9, "N/m");
/// Damping of a surface or field.
pub const DAMPING: Range = Range::new(0.0, 1e6, "N s/m");
/// Coulomb friction coefficient.
pub const FRICTION: Range = Range::new(0.0, 10.0, "(coefficient)");
/// Component of the velocity of a surface.
pub const SURFACE_VELOCITY: Range = Range::new(-100.0, 100.0, "m/s");
/// Component of a force.
pub const FORCE: Range = Range::new(-1000.0, 1000.0, "N");
/// Component of a moment.
pub const MOMENT: Range = Range::new(-1000.0, 1000.0, "N m");
/// Element of a matrix of stiffness; a coupling has either sign.
pub const STIFFNESS_ELEMENT: Range = Range::new(-STIFFNESS.max, STIFFNESS.max, STIFFNESS.unit);
/// Element of a matrix of damping.
pub const DAMPING_ELEMENT: Range = Range::new(-DAMPING.max, DAMPING.max, DAMPING.unit);
/// Length of a normal or direction as written; it is brought to 1.
pub const NORMAL_LENGTH: Range = Range::new(1e-6, 1e6, "(length)");
/// Length of a quaternion as written; it is brought to 1.
pub const QUATERNION_LENGTH: Range = Range::new(0.99, 1.01, "(length)");

/// Largest torque of an actuator.
pub const TORQUE_LIMIT: Range = Range::new(1e-6, 1000.0, "N m");
/// Torque of a released brake, or of a stopped one.
pub const HOLDING_TORQUE: Range = Range::new(0.0, 1000.0, "N m");
/// Width of a brake's hysteresis as a share of its largest torque.
pub const HYSTERESIS: Range = Range::new(0.0, 0.5, "of the largest torque");
/// Free play between shaft and brake, from end to end.
pub const BACKLASH: Range = Range::new(0.0, 0.5, "rad");
/// Time constant of an actuator.
pub const LAG: Range = Range::new(0.0, 1.0, "s");
/// Viscous drag of a shaft.
pub const SHAFT_DAMPING: Range = Range::new(0.0, 100.0, "N m s/rad");
/// Smallest step of a motor's torque; 0: none.
pub const RESOLUTION: Range = Range::new(0.0, 100.0, "N m");
/// What the torque of an actuator counts in the distribution of force.
pub const WEIGHT: Range = Range::new(1e-3, 1e3, "(no unit)");
/// Encoder counts of one turn of a shaft.
pub const COUNTS: Range = Range::new(16.0, 4_294_967_296.0, "counts");
/// Noise or bias of a force sensor.
pub const SENSOR_ERROR: Range = Range::new(0.0, 100.0, "N");
/// Component of the way from the handle to the tool point.
pub const TOOL_OFFSET: Range = Range::new(-1.0, 1.0, "m");
/// Radius of the tool.
pub const TOOL_RADIUS: Range = Range::new(0.0, 0.1, "m");
/// Ticks per second.
pub const RATE: Range = Range::new(100.0, 4000.0, "Hz");
/// Largest force that may be asked for.
pub const FORCE_LIMIT: Range = Range::new(0.1, 10_000.0, "N");
/// Share of the force asked that is wanted.
pub const GAIN: Range = Range::new(0.0, 1.0, "(share)");
/// Fastest change of a soft force.
pub const SLEW: Range = Range::new(1.0, 1e9, "N/s");
/// Time in which a force fades or grows.
pub const RAMP: Range = Range::new(0.0, 10_000.0, "ms");
/// Energy that a controller may feed through motors beyond what is put into it.
pub const PASSIVITY_RESERVE: Range = Range::new(0.001, 1000.0, "J");
/// What it may feed always.
pub const PASSIVITY_POWER: Range = Range::new(0.0, 1000.0, "W");
/// Disagreement of redundant encoders.
pub const CLOSURE: Range = Range::new(1e-4, std::f64::consts::PI, "rad");
/// Ticks in a row without a sample, while the brakes hold what they held.
pub const BLIND_TICKS: Range = Range::new(1.0, 100.0, "ticks");
/// Late ticks in a row.
pub const IN_A_ROW: Range = Range::new(1.0, 1_000_000.0, "ticks");

/// A port; 0 is any free one.
pub const PORT: Range = Range::new(0.0, 65_535.0, "(port, 0 = any free one)");
/// Priority of a real-time thread.
pub const PRIORITY: Range = Range::new(1.0, 99.0, "(SCHED_FIFO priority)");
/// Number of a processor.
pub const PROCESSOR: Range = Range::new(0.0, 1023.0, "(processor number)");
/// Sessions at a time.
pub const SESSIONS: Range = Range::new(1.0, 1024.0, "sessions");
/// Time-to-live of a command: shorter than the silence that ends a session, so that it alone
/// decides when a force goes.
pub const TIME_TO_LIVE: Range = Range::new(1.0, 1_000.0, "ms");
/// Length of a recording.
pub const RECORDING: Range = Range::new(1e-3, 600.0, "s");
/// What a black box keeps.
pub const BLACK_BOX: Range = Range::new(0.0, 120.0, "s (0 = no black box)");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_names_field_value_range_and_unit() {
        let error = STIFFNESS.check("material.stiffness", -1.0).unwrap_err();
        assert_eq!(
            error.to_string(),
            "material.stiffness = -1: must be a number in 0 to 1000000000 N/m"
        );
        assert_eq!(error.within("wall").field, "wall.material.stiffness");
    }

    #[test]
    fn counts_are_whole_and_inside() {
        assert_eq!(PORT.check_whole("port", 7350), Ok(7350));
        for value in [-1, 65_536, i64::MIN, i64::MAX] {
            assert_eq!(PORT.check_whole("port", value).unwrap_err().field, "port");
        }
    }

    #[test]
    fn what_is_not_a_number_is_refused() {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(POSITION.check("x", value).is_err());
        }
    }
}
