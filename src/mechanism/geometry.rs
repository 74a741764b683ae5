//! Plane geometry that linkages share: directions, wrapped angles, and two links that span a
//! distance.
//!
//! Angles in radians, counter-clockwise from x of B; lengths in metres. A *direction* is a
//! unit vector `u(a) = (cos a, sin a)`. Nothing here panics or returns NaN in an `Ok`.
//! This file knows no linkage as a whole. Derived here, as is the closed form of [`arm_rates`].

use nalgebra::{SMatrix, SVector, Vector2};
use std::f64::consts::{PI, TAU};

use super::KinematicsError;
use crate::notation::PlaneVector;

/// Below this |sine| two links count as in line ([`KinematicsError::Singular`]).
///
/// Reference forces grow as its inverse. It lies above sqrt(2 * 1e-9) = 4.5e-5, the sine
/// that the slack of 1e-9 in a cosine hides: what the slack lets through is called singular,
/// and none of it becomes a force.
pub const LEAST_MARGIN: f64 = 1e-4;

/// Longest angle that is taken from an encoder, radians: beyond it an `f64` resolves less
/// than 1e-7 rad, and differences of such angles say nothing about a posture.
pub const LONGEST_ANGLE_RAD: f64 = 1e9;

/// How far rounding may push a cosine beyond +-1 before the distance is out of reach.
const COSINE_SLACK: f64 = 1e-9;

/// `u(a)`.
pub(super) fn direction(angle_rad: f64) -> Vector2<f64> {
    let (sin, cos) = angle_rad.sin_cos();
    Vector2::new(cos, sin)
}

/// `v` turned a quarter counter-clockwise: the rate of a link's end per unit rate of angle.
pub(super) fn turned(v: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-v.y, v.x)
}

/// The z component of a x b: for directions, the sine of the angle from a to b.
pub(super) fn cross(a: Vector2<f64>, b: Vector2<f64>) -> f64 {
    a.x * b.y - a.y * b.x
}

/// Direction of a vector as an angle in (-pi, pi].
pub(super) fn bearing(v: Vector2<f64>) -> f64 {
    wrap(v.y.atan2(v.x))
}

/// The same angle in (-pi, pi].
pub(super) fn wrap(angle_rad: f64) -> f64 {
    let near = angle_rad - TAU * (angle_rad / TAU).round();
    if near <= -PI {
        PI
    } else if near > PI {
        near - TAU
    } else {
        near
    }
}

/// x and y of a pose, if they are numbers.
pub(super) fn finite_point(p_BH: &PlaneVector) -> Result<Vector2<f64>, KinematicsError> {
    let point_m = Vector2::new(p_BH.x, p_BH.y);
    if point_m.iter().all(|m| m.is_finite()) {
        Ok(point_m)
    } else {
        Err(KinematicsError::NotFinite)
    }
}

/// The first `N` angles, if all are numbers that still resolve a part of a turn.
pub(super) fn usable_angles<const N: usize>(
    angles_rad: &[f64],
) -> Result<SVector<f64, N>, KinematicsError> {
    let angle = |i: usize, _| angles_rad.get(i).copied().unwrap_or(f64::NAN);
    let angles_rad = SVector::<f64, N>::from_fn(angle);
    if angles_rad.iter().all(|a| a.abs() <= LONGEST_ANGLE_RAD) {
        Ok(angles_rad)
    } else {
        Err(KinematicsError::NotFinite)
    }
}

/// Refuses sines of angles between links that are too near zero; the least one.
pub(super) fn require_margin(sines: &[f64]) -> Result<f64, KinematicsError> {
    let margin = sines.iter().fold(1.0_f64, |least, sine| least.min(sine.abs()));
    if margin >= LEAST_MARGIN {
        Ok(margin)
    } else {
        Err(KinematicsError::Singular { margin, least: LEAST_MARGIN })
    }
}

/// Angle between the base of a triangle and the side `near_m`, opposite to `far_m`, in
/// [0, pi]: how far the first of two links leans off the line that they span.
pub(super) fn lean(near_m: f64, far_m: f64, base_m: f64) -> Result<f64, KinematicsError> {
    let doubled_cosine = base_m / near_m + (near_m - far_m) * (near_m + far_m) / (near_m * base_m);
    if (0.5 * doubled_cosine).abs() <= 1.0 + COSINE_SLACK {
        return Ok((0.5 * doubled_cosine).clamp(-1.0, 1.0).acos());
    }
    if doubled_cosine.is_nan() {
        // Equal links folded onto each other span nothing, whatever way they point.
        return Err(KinematicsError::Singular { margin: 0.0, least: LEAST_MARGIN });
    }
    let (min_m, max_m) = ((near_m - far_m).abs(), near_m + far_m);
    Err(KinematicsError::Unreachable { needed_m: base_m, min_m, max_m })
}

/// Absolute angles of two links in series from the origin to `end_m`, in (-pi, pi]: the
/// first leans `elbow` = +1 counter-clockwise, -1 clockwise off the line to `end_m`.
pub(super) fn arm_angles(
    end_m: Vector2<f64>,
    [first_m, second_m]: [f64; 2],
    elbow: f64,
) -> Result<[f64; 2], KinematicsError> {
    let lean_rad = lean(first_m, second_m, end_m.x.hypot(end_m.y))?;
    let first_rad = wrap(bearing(end_m) + elbow * lean_rad);
    Ok([first_rad, bearing(end_m - first_m * direction(first_rad))])
}

/// Rates of the two absolute link angles per unit velocity of an arm's end, rad/m: row
/// vectors d phi / d P, written as columns. `along` are the links' directions; the caller
/// has checked that they are not in line.
///
/// `v = l1 n1 phi1' + l2 n2 phi2'`; the product with u2 removes phi2', that with u1 phi1'.
pub(super) fn arm_rates(lengths_m: [f64; 2], along: [Vector2<f64>; 2]) -> [Vector2<f64>; 2] {
    let sine = cross(along[0], along[1]);
    [along[1] / (lengths_m[0] * sine), -along[0] / (lengths_m[1] * sine)]
}

/// Velocity of a link's far end relative to its near end, per unit velocity of the handle in
/// each of its freedoms.
pub(super) fn swing<const FREEDOMS: usize>(
    length_m: f64,
    along: Vector2<f64>,
    rate_per_m: SVector<f64, FREEDOMS>,
) -> SMatrix<f64, 2, FREEDOMS> {
    length_m * turned(along) * rate_per_m.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::{num::f64::ANY, prelude::*};

    #[test]
    fn wrapped_angles_lie_within_half_a_turn() {
        for (angle_rad, expected) in
            [(PI, PI), (-PI, PI), (3.0 * PI, PI), (TAU + 1.0, 1.0), (-TAU - 1.0, -1.0)]
        {
            assert!((wrap(angle_rad) - expected).abs() < 1e-14, "{angle_rad}");
        }
    }

    #[test]
    fn a_cosine_just_beyond_one_is_clamped_and_one_further_is_out_of_reach() {
        assert_eq!(lean(0.3, 0.3, 0.6 * (1.0 + 0.9e-9)), Ok(0.0));
        assert_eq!(
            lean(0.3, 0.2, 0.6),
            Err(KinematicsError::Unreachable { needed_m: 0.6, min_m: 0.3 - 0.2, max_m: 0.5 })
        );
        assert!(matches!(lean(0.3, 0.3, 0.0), Err(KinematicsError::Singular { .. })));
        assert!(matches!(lean(0.3, 0.2, 0.0), Err(KinematicsError::Unreachable { .. })));
    }

    proptest! {
        #[test]
        fn arms_end_where_they_should(
            l1 in 0.05..1.0_f64, l2 in 0.05..1.0_f64, s in 0.01..0.99, bearing_rad in -PI..PI, up: bool,
        ) {
            let r = f64::abs(l1 - l2) + s * (l1 + l2 - f64::abs(l1 - l2));
            let end_m = r * direction(bearing_rad);
            let elbow = if up { 1.0 } else { -1.0 };
            let [a, b] = arm_angles(end_m, [l1, l2], elbow)?;
            let back_m = l1 * direction(a) + l2 * direction(b);
            prop_assert!((back_m - end_m).norm() < 1e-12);
            prop_assert!(elbow * wrap(a - bearing_rad) >= 0.0);
        }

        #[test]
        fn no_input_makes_nan(x in ANY, y in ANY, l1 in 1e-3..10.0, l2 in 1e-3..10.0) {
            if let Ok(angles) = arm_angles(Vector2::new(x, y), [l1, l2], 1.0) {
                prop_assert!(angles.iter().all(|a| a.is_finite()));
            }
        }
    }
}
