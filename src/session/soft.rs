//! A controller's wrench or force field, checked.
//!
//! Every number passes a range once; an error names the field, the value and what is
//! allowed. What is absent is zero.

use nalgebra::{Matrix3, Vector3};

use crate::control::Wrench;
use crate::environment::ForceField;
use crate::proto::{ForceFieldCommand, WrenchCommand};
use crate::units::{
    DAMPING_ELEMENT, FIELD_RADIUS, FORCE, FieldError, MOMENT, POSITION, Range, STIFFNESS_ELEMENT,
};
use crate::wire::{get_pair, get3};

/// The wrench of one command.
pub(super) fn wrench(wanted: &WrenchCommand) -> Result<Wrench, FieldError> {
    pair("wrench", &wanted.wrench)
}

/// The force field of one command, in the client's world.
pub(super) fn field(wanted: &ForceFieldCommand) -> Result<ForceField, FieldError> {
    let origin_W_m = Vector3::from(get3("origin_m", &wanted.origin_m)?);
    each("origin_m", origin_W_m.iter(), &POSITION)?;
    let at_origin = match wanted.wrench.as_slice() {
        [] => Wrench::default(),
        floats => pair("wrench", floats)?,
    };
    let radius_m = FIELD_RADIUS.check("radius_m", f64::from(wanted.radius_m))?;
    Ok(ForceField {
        origin_W_m,
        force_W_N: at_origin.force_N,
        moment_W_Nm: at_origin.moment_Nm,
        stiffness_N_per_m: matrix(
            "stiffness_n_per_m",
            &wanted.stiffness_n_per_m,
            &STIFFNESS_ELEMENT,
        )?,
        damping_Ns_per_m: matrix("damping_ns_per_m", &wanted.damping_ns_per_m, &DAMPING_ELEMENT)?,
        radius_m: if radius_m == 0.0 { f64::INFINITY } else { radius_m },
    })
}

fn pair(name: &str, floats: &[f32]) -> Result<Wrench, FieldError> {
    let (force_N, moment_Nm) = get_pair(name, floats)?;
    each(name, force_N.iter(), &FORCE)?;
    each(name, moment_Nm.iter(), &MOMENT)?;
    Ok(Wrench { force_N: force_N.into(), moment_Nm: moment_Nm.into() })
}

/// Three numbers of a diagonal, nine row by row, none for zero.
fn matrix(name: &str, floats: &[f32], range: &Range) -> Result<Matrix3<f64>, FieldError> {
    let numbers: Vec<f64> = floats.iter().map(|value| f64::from(*value)).collect();
    each(name, numbers.iter(), range)?;
    match numbers.len() {
        0 => Ok(Matrix3::zeros()),
        3 => Ok(Matrix3::from_diagonal(&Vector3::from_column_slice(&numbers))),
        9 => Ok(Matrix3::from_row_slice(&numbers)),
        length => {
            let found = format!("{length} numbers");
            Err(FieldError::new(name, found, "must have 0, 3 (the diagonal) or 9 (row by row)"))
        }
    }
}

fn each<'a>(
    name: &str,
    values: impl Iterator<Item = &'a f64>,
    range: &Range,
) -> Result<(), FieldError> {
    for value in values {
        range.check(name, *value)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn good() -> ForceFieldCommand {
        ForceFieldCommand {
            origin_m: vec![0.5, 0.0, 0.25],
            wrench: vec![1.0, 2.0, 3.0, 0.0, 0.0, 0.5],
            stiffness_n_per_m: (1u8..=9).map(f32::from).collect(),
            damping_ns_per_m: vec![1.0, 2.0, 3.0],
            radius_m: 0.0,
        }
    }

    #[test]
    fn a_field_comes_out_as_it_was_written() {
        let field = field(&good()).unwrap();
        assert_eq!(field.origin_W_m, Vector3::new(0.5, 0.0, 0.25));
        assert_eq!(field.moment_W_Nm, Vector3::new(0.0, 0.0, 0.5));
        assert_eq!(field.stiffness_N_per_m * Vector3::x(), Vector3::new(1.0, 4.0, 7.0), "by rows");
        assert_eq!(field.damping_Ns_per_m * Vector3::y(), Vector3::new(0.0, 2.0, 0.0));
        assert_eq!(field.radius_m, f64::INFINITY);
    }

    #[test]
    fn the_bounds_of_floats_are_inside() {
        let mut edge = good();
        (edge.stiffness_n_per_m, edge.damping_ns_per_m) = (vec![1e9; 9], vec![-1e6; 3]);
        (edge.wrench, edge.radius_m) = (vec![-1000.0; 6], 100.0);
        assert!(field(&edge).is_ok());
        assert!(wrench(&WrenchCommand { wrench: vec![1000.0, 0.0, 0.0] }).is_ok());
    }

    #[test]
    fn every_bad_number_is_refused_by_name() {
        type Change = fn(&mut ForceFieldCommand);
        let table: [(Change, &str); 9] = [
            (|f| f.origin_m = vec![], "origin_m = 0 numbers: must have 3"),
            (|f| f.origin_m[1] = 101.0, "origin_m = 101: must be a number in -100"),
            (|f| f.wrench = vec![0.0; 4], "wrench = 4 numbers: must have 3 or 6"),
            (|f| f.wrench[5] = 1001.0, "wrench = 1001: must be a number in -1000 to 1000 N m"),
            (|f| f.wrench[0] = f32::NAN, "wrench = NaN"),
            (|f| f.stiffness_n_per_m.truncate(8), "stiffness_n_per_m = 8 numbers: must have 0, 3"),
            (|f| f.stiffness_n_per_m[8] = f32::INFINITY, "stiffness_n_per_m = inf"),
            (|f| f.damping_ns_per_m[0] = 2e6, "damping_ns_per_m = 2000000: must be a number in"),
            (|f| f.radius_m = -1.0, "radius_m = -1: must be a number in 0 to 100 m"),
        ];
        for (change, expected) in table {
            let mut bad = good();
            change(&mut bad);
            let message = field(&bad).unwrap_err().to_string();
            assert!(message.starts_with(expected), "{message} / {expected}");
        }
        let error = wrench(&WrenchCommand { wrench: vec![] }).unwrap_err();
        assert_eq!(error.to_string(), "wrench = 0 numbers: must have 3 or 6");
    }
}
