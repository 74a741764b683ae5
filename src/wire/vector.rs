//! Vectors on the wire: packed floats in W, three for a vector, three or six for a pair.
//!
//! A wrench or twist is a pair (force, moment / linear, angular); where the second part is
//! zero it is left out. An *absent* vector means unknown and is up to the caller: it has no
//! floats at all, a zero has three. Outgoing numbers are always finite: what f32 cannot hold
//! becomes its largest value, what is not a number becomes zero. Incoming ones are checked.

use crate::units::FieldError;

/// A number as the wire carries it, finite whatever it was.
pub fn number(value: f64) -> f32 {
    if value.is_nan() {
        return 0.0;
    }
    value.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32
}

/// Replaces `floats` by a vector.
pub fn put3(floats: &mut Vec<f32>, vector: [f64; 3]) {
    floats.clear();
    floats.extend(vector.map(number));
}

/// Replaces `floats` by a pair of vectors, the second only where it is not zero.
pub fn put_pair(floats: &mut Vec<f32>, first: [f64; 3], second: [f64; 3]) {
    put3(floats, first);
    let second = second.map(number);
    if second != [0.0; 3] {
        floats.extend(second);
    }
}

/// The vector in `floats`; an error names `field`.
pub fn get3(field: &str, floats: &[f32]) -> Result<[f64; 3], FieldError> {
    let Ok(vector) = <[f32; 3]>::try_from(floats) else {
        return Err(FieldError::new(field, format!("{} numbers", floats.len()), "must have 3"));
    };
    finite(field, vector)
}

/// The pair of vectors in three or six `floats`; an error names `field`.
pub fn get_pair(field: &str, floats: &[f32]) -> Result<([f64; 3], [f64; 3]), FieldError> {
    match floats.len() {
        3 => Ok((get3(field, floats)?, [0.0; 3])),
        6 => Ok((get3(field, &floats[..3])?, get3(field, &floats[3..])?)),
        length => Err(FieldError::new(field, format!("{length} numbers"), "must have 3 or 6")),
    }
}

fn finite(field: &str, vector: [f32; 3]) -> Result<[f64; 3], FieldError> {
    match vector.into_iter().find(|value| !value.is_finite()) {
        Some(value) => Err(FieldError::new(field, value, "must be finite numbers")),
        None => Ok(vector.map(f64::from)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_pair_has_three_numbers_where_the_rest_is_zero_and_else_six() {
        let mut floats = vec![9.0; 9];
        put_pair(&mut floats, [1.0, 2.0, 3.0], [0.0, -0.0, 0.0]);
        assert_eq!(floats, [1.0, 2.0, 3.0]);
        assert_eq!(get_pair("requested", &floats), Ok(([1.0, 2.0, 3.0], [0.0; 3])));
        put_pair(&mut floats, [0.0; 3], [0.0, 0.0, 0.5]);
        assert_eq!(floats, [0.0, 0.0, 0.0, 0.0, 0.0, 0.5]);
        assert_eq!(get_pair("requested", &floats), Ok(([0.0; 3], [0.0, 0.0, 0.5])));
    }

    #[test]
    fn a_wrong_length_names_its_field() {
        for length in [0, 1, 2, 4, 6] {
            let error = get3("point_m", &vec![0.0; length]).unwrap_err();
            assert_eq!(error.to_string(), format!("point_m = {length} numbers: must have 3"));
        }
        for length in [0, 1, 2, 4, 5, 7] {
            assert!(get_pair("twist", &vec![0.0; length]).is_err(), "{length}");
        }
    }

    #[test]
    fn what_is_not_finite_is_refused_coming_in() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for place in 0..6 {
                let mut floats = [1.0; 6];
                floats[place] = bad;
                let error = get_pair("measured_cf", &floats).unwrap_err();
                assert_eq!(error.field, "measured_cf");
            }
        }
    }

    proptest! {
        #[test]
        fn whatever_goes_out_is_finite_and_the_nearest_float(bits in any::<u64>()) {
            let value = f64::from_bits(bits);
            let sent = number(value);
            prop_assert!(sent.is_finite());
            if value.abs() <= f64::from(f32::MAX) {
                prop_assert_eq!(sent, value as f32);
            }
        }
    }
}
