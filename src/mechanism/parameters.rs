//! What may be wrong with the parameters of a linkage, and the checks that say so.
//!
//! Built outside the tick, so errors may own text. A field is named as in the parameter
//! structs (`l_m[2]`, `links[0].mass_kg`), counted from zero. Reading files is not done here.
#![expect(
    clippy::disallowed_types,
    clippy::disallowed_macros,
    reason = "errors of construction own text, and none is made in a tick"
)]

use crate::units::{FieldError, Range};

/// A parameter that no linkage can be built with.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ParameterError {
    /// Not a number, or outside its range.
    #[error("{field} = {value}: allowed is {least} to {most} {unit}")]
    OutOfRange { field: String, value: f64, least: f64, most: f64, unit: &'static str },
    /// A choice between two sides.
    #[error("{field} = {value}: allowed is -1 or +1")]
    NotASign { field: &'static str, value: i32 },
    /// One link of a loop is at least as long as the others together, so that the loop closes
    /// nowhere, or only stretched out in a line.
    #[error("{field} = {value} m cannot close: less than {most:.4} m, the other links together")]
    CannotClose { field: String, value: f64, most: f64 },
    /// With it nothing is left that could be reached at every bearing and turn.
    #[error("{field} = {value} leaves no place that is reached at every bearing and turn")]
    NoWorkspace { field: String, value: f64 },
}

/// A refusal of the linkage, under the key that its author wrote in a device file.
impl From<ParameterError> for FieldError {
    fn from(error: ParameterError) -> Self {
        match error {
            ParameterError::OutOfRange { field, value, least, most, unit } => {
                let range = Range::new(least, most, unit);
                Self::new(key_of(&field), value, format!("must be a number in {range}"))
            }
            ParameterError::NotASign { field, value } => {
                Self::new(key_of(field), value, "must be -1 or 1")
            }
            ParameterError::CannotClose { field, value, most } => {
                let allowed = format!(
                    "must be less than {most} m, the other links together, or the loop cannot close"
                );
                Self::new(key_of(&field), value, allowed)
            }
            ParameterError::NoWorkspace { field, value } => {
                let allowed = "must leave places that are reached at every bearing and turn";
                Self::new(key_of(&field), value, allowed)
            }
        }
    }
}

/// Where a parameter of a linkage stands in a device file.
fn key_of(parameter: &str) -> String {
    match parameter.strip_prefix("shaft_inertia_kg_m2") {
        Some(index) => format!("actuators{index}.shaft_inertia_kg_m2"),
        None if parameter.starts_with("links") || parameter.starts_with("handle_") => {
            format!("inertia.{parameter}")
        }
        None => format!("mechanism.{parameter}"),
    }
}

/// A link shorter than this is a manufacturing tolerance; a longer one is not hand-held.
pub(super) const LENGTH_M: Range = Range::new(1e-3, 10.0, "m");

/// Link angle per shaft angle; the smallest is a step-up of a thousand.
pub(super) const RATIO: Range = Range::new(1e-3, 100.0, "rad/rad");

/// Refuses a number outside `allowed`, NaN included.
pub(super) fn require_range(
    field: impl Into<String>,
    value: f64,
    &Range { min: least, max: most, unit }: &Range,
) -> Result<(), ParameterError> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    Err(ParameterError::OutOfRange { field: field.into(), value, least, most, unit })
}

/// A sign as the factor that it is in the equations.
pub(super) fn require_sign(field: &'static str, value: i32) -> Result<f64, ParameterError> {
    match value {
        1 => Ok(1.0),
        -1 => Ok(-1.0),
        _ => Err(ParameterError::NotASign { field, value }),
    }
}

/// Refuses a loop of links that closes in no regular posture: indices are those of `l_m`.
pub(super) fn require_closable(l_m: &[f64], loop_of: &[usize]) -> Result<(), ParameterError> {
    for &i in loop_of {
        let most = loop_of.iter().filter(|&&j| j != i).map(|&j| l_m[j]).sum();
        if l_m[i] >= most {
            let (field, value) = (format!("l_m[{i}]"), l_m[i]);
            return Err(ParameterError::CannotClose { field, value, most });
        }
    }
    Ok(())
}
