//! The ranges of everything that a scene's object can be made of.
//!
//! A refusal names the field as `scene.proto` does, relative to the object: `box.centre_m.x`.
//! Directions come in with any sensible length, orientations with length 1 to a hundredth,
//! and both leave with length 1. Units and frames are those of [`ObjectKind`].

use nalgebra::{Matrix3, Quaternion, Vector3};

use super::{GuidePath, ObjectKind};
use crate::environment::{MAX_CORRIDOR_POINTS, Material};
use crate::units::{self, FieldError, Range};

/// What is this close to length 1 is kept bit by bit, so that what was saved reads back the
/// same.
const UNIT_LENGTH_TOLERANCE: f64 = 1e-12;

/// What an object may be, with its directions brought to length 1.
pub(super) fn check_kind(mut kind: ObjectKind) -> Result<ObjectKind, FieldError> {
    match &mut kind {
        ObjectKind::HalfSpace { point_m, normal } => {
            units::POSITION.check_vector("half_space.point_m", point_m)?;
            *normal = unit("half_space.normal", normal)?;
        }
        ObjectKind::Sphere { centre_m, radius_m } => {
            units::POSITION.check_vector("sphere.centre_m", centre_m)?;
            units::RADIUS.check("sphere.radius_m", *radius_m)?;
        }
        ObjectKind::Box { centre_m, half_extents_m, orientation } => {
            units::POSITION.check_vector("box.centre_m", centre_m)?;
            units::RADIUS.check_vector("box.half_extents_m", half_extents_m)?;
            let length = orientation.norm();
            units::QUATERNION_LENGTH.check("box.orientation", length)?;
            if !is_unit(length) {
                *orientation = Quaternion::from(orientation.coords / length);
            }
        }
        ObjectKind::Capsule { ends_m, radius_m } => {
            check_points("capsule.ends_m", ends_m)?;
            units::RADIUS.check("capsule.radius_m", *radius_m)?;
        }
        ObjectKind::Corridor { points_m, radius_m } => {
            if !(2..=MAX_CORRIDOR_POINTS).contains(&points_m.len()) {
                let found = format!("{} points", points_m.len());
                let allowed = format!("must be 2 to {MAX_CORRIDOR_POINTS}");
                return Err(FieldError::new("corridor.points_m", found, allowed));
            }
            check_points("corridor.points_m", points_m)?;
            units::GUIDE_RADIUS.check("corridor.radius_m", *radius_m)?;
        }
        ObjectKind::Guide { path, radius_m } => {
            check_path(path)?;
            units::GUIDE_RADIUS.check("guide.radius_m", *radius_m)?;
        }
        ObjectKind::Constant { force_N } => {
            units::FORCE.check_vector("constant.force_n", force_N)?;
        }
        ObjectKind::Viscous { damping_Ns_per_m } => {
            units::DAMPING.check("viscous.damping_ns_per_m", *damping_Ns_per_m)?;
        }
        ObjectKind::ForceField {
            origin_m,
            force_N,
            moment_Nm,
            stiffness_N_per_m,
            damping_Ns_per_m,
            radius_m,
        } => {
            units::POSITION.check_vector("force_field.origin_m", origin_m)?;
            units::FORCE.check_vector("force_field.wrench.force_n", force_N)?;
            units::MOMENT.check_vector("force_field.wrench.moment_nm", moment_Nm)?;
            let stiffness = "force_field.stiffness_n_per_m";
            check_elements(stiffness, stiffness_N_per_m, &units::STIFFNESS_ELEMENT)?;
            let damping = "force_field.damping_ns_per_m";
            check_elements(damping, damping_Ns_per_m, &units::DAMPING_ELEMENT)?;
            units::FIELD_RADIUS.check("force_field.radius_m", *radius_m)?;
        }
    }
    Ok(kind)
}

fn check_path(path: &mut GuidePath) -> Result<(), FieldError> {
    match path {
        GuidePath::Point { point_m } => {
            units::POSITION.check_vector("guide.point.point_m", point_m)?;
        }
        GuidePath::Line { point_m, direction } => {
            units::POSITION.check_vector("guide.line.point_m", point_m)?;
            *direction = unit("guide.line.direction", direction)?;
        }
        GuidePath::Plane { point_m, normal } => {
            units::POSITION.check_vector("guide.plane.point_m", point_m)?;
            *normal = unit("guide.plane.normal", normal)?;
        }
    }
    Ok(())
}

/// What a surface may feel like.
pub(super) fn check_material(material: &Material) -> Result<(), FieldError> {
    let Material {
        stiffness_N_per_m,
        damping_Ns_per_m,
        static_friction,
        kinetic_friction,
        surface_velocity_W_m_per_s,
    } = material;
    units::STIFFNESS.check("material.stiffness_n_per_m", *stiffness_N_per_m)?;
    units::DAMPING.check("material.damping_ns_per_m", *damping_Ns_per_m)?;
    units::FRICTION.check("material.kinetic_friction", *kinetic_friction)?;
    units::FRICTION.check("material.static_friction", *static_friction)?;
    if static_friction < kinetic_friction {
        let allowed = format!("must be at least kinetic_friction, {kinetic_friction}");
        return Err(FieldError::new("material.static_friction", static_friction, allowed));
    }
    let velocity = "material.surface_velocity_m_per_s";
    units::SURFACE_VELOCITY.check_vector(velocity, surface_velocity_W_m_per_s)
}

/// A matrix as it is written: nothing for zero, 3 numbers of a diagonal, 9 row by row.
pub(super) fn matrix(field: &str, numbers: &[f64]) -> Result<Matrix3<f64>, FieldError> {
    match numbers.len() {
        0 => Ok(Matrix3::zeros()),
        3 => Ok(Matrix3::from_diagonal(&Vector3::from_column_slice(numbers))),
        9 => Ok(Matrix3::from_row_slice(numbers)),
        length => {
            let allowed = "must have 0, 3 (the diagonal) or 9 (row by row)";
            Err(FieldError::new(field, format!("{length} numbers"), allowed))
        }
    }
}

/// The shortest way to write a matrix.
pub(super) fn numbers(matrix: &Matrix3<f64>) -> Vec<f64> {
    if *matrix == Matrix3::zeros() {
        Vec::new()
    } else if *matrix == Matrix3::from_diagonal(&matrix.diagonal()) {
        matrix.diagonal().iter().copied().collect()
    } else {
        matrix.transpose().iter().copied().collect()
    }
}

fn check_points(field: &str, points_m: &[Vector3<f64>]) -> Result<(), FieldError> {
    for (i, point_m) in points_m.iter().enumerate() {
        units::POSITION.check_vector(&format!("{field}[{i}]"), point_m)?;
    }
    Ok(())
}

fn check_elements(field: &str, matrix: &Matrix3<f64>, range: &Range) -> Result<(), FieldError> {
    matrix.iter().try_for_each(|&element| range.check(field, element).map(drop))
}

fn unit(field: &str, vector: &Vector3<f64>) -> Result<Vector3<f64>, FieldError> {
    let length = units::NORMAL_LENGTH.check(field, vector.norm())?;
    Ok(if is_unit(length) { *vector } else { vector / length })
}

fn is_unit(length: f64) -> bool {
    (length - 1.0).abs() <= UNIT_LENGTH_TOLERANCE
}

#[cfg(test)]
mod tests {
    use super::*;

    fn x(x: f64) -> Vector3<f64> {
        Vector3::new(x, 0.0, 0.0)
    }

    fn block(half_extents_m: Vector3<f64>, orientation: [f64; 4]) -> ObjectKind {
        let orientation = Quaternion::from(orientation);
        ObjectKind::Box { centre_m: x(0.0), half_extents_m, orientation }
    }

    fn field(change: impl FnOnce(&mut [f64; 9], &mut [f64; 9], &mut f64)) -> ObjectKind {
        let (mut stiffness, mut damping, mut radius_m) = ([1.0; 9], [1.0; 9], 0.0);
        change(&mut stiffness, &mut damping, &mut radius_m);
        ObjectKind::ForceField {
            origin_m: x(0.0),
            force_N: x(0.0),
            moment_Nm: x(0.0),
            stiffness_N_per_m: Matrix3::from_row_slice(&stiffness),
            damping_Ns_per_m: Matrix3::from_row_slice(&damping),
            radius_m,
        }
    }

    #[test]
    fn directions_come_out_with_length_one_and_then_stay_as_they_are() {
        let normal = Vector3::new(-3.0, 4.0, 0.1);
        let once = check_kind(ObjectKind::HalfSpace { point_m: x(0.3), normal }).unwrap();
        let ObjectKind::HalfSpace { normal: unit, .. } = once else { panic!() };
        assert!((unit.norm() - 1.0).abs() < 1e-15 && unit.cross(&normal).norm() < 1e-15);
        assert_eq!(check_kind(once.clone()).unwrap(), once);
        let turned = check_kind(block(x(1.0).add_scalar(0.1), [0.5, 0.5, 0.5, 0.505])).unwrap();
        let ObjectKind::Box { orientation, .. } = &turned else { panic!() };
        assert!((orientation.norm() - 1.0).abs() < 1e-15);
        assert!((orientation.w / orientation.i - 1.01).abs() < 1e-12, "the same turn");
        assert_eq!(check_kind(turned.clone()).unwrap(), turned);
    }

    #[test]
    fn each_field_of_each_kind_is_refused_by_its_name() {
        use ObjectKind::{Capsule, Constant, Corridor, Guide, HalfSpace, Sphere, Viscous};
        let (nan, inf) = (f64::NAN, f64::INFINITY);
        let upright = [0.0, 0.0, 0.0, 1.0];
        let flat = Vector3::new(0.1, 0.0, 0.1);
        let capsule = |to, radius_m| Capsule { ends_m: [x(0.0), x(to)], radius_m };
        let along =
            |points_m: &[Vector3<f64>]| Corridor { points_m: points_m.into(), radius_m: 0. };
        let guide = |path| Guide { path, radius_m: 0.0 };
        let line = |direction| guide(GuidePath::Line { point_m: x(0.0), direction });
        let plane = |normal| guide(GuidePath::Plane { point_m: x(0.0), normal });
        let refusals = [
            (HalfSpace { point_m: x(0.3), normal: x(0.0) }, "half_space.normal = 0: must be"),
            (HalfSpace { point_m: x(0.3), normal: x(nan) }, "half_space.normal = NaN"),
            (HalfSpace { point_m: x(0.3), normal: x(1e200) }, "half_space.normal = inf"),
            (HalfSpace { point_m: x(-inf), normal: x(1.0) }, "half_space.point_m.x = -inf"),
            (Sphere { centre_m: x(101.0), radius_m: 0.1 }, "sphere.centre_m.x = 101"),
            (Sphere { centre_m: x(0.0), radius_m: 0.0 }, "sphere.radius_m = 0: must be a number"),
            (Sphere { centre_m: x(0.0), radius_m: inf }, "sphere.radius_m = inf"),
            (block(flat, upright), "box.half_extents_m.y = 0: must be a number in 0.0001 to 100 m"),
            (block(flat.add_scalar(nan), upright), "box.half_extents_m.x = NaN"),
            (
                block(flat.add_scalar(0.1), [0.0; 4]),
                "box.orientation = 0: must be a number in 0.99",
            ),
            (block(flat.add_scalar(0.1), [nan; 4]), "box.orientation = NaN"),
            (block(flat.add_scalar(0.1), [inf; 4]), "box.orientation = inf"),
            (capsule(nan, 0.1), "capsule.ends_m[1].x = NaN"),
            (capsule(0.1, 0.0), "capsule.radius_m = 0"),
            (along(&[]), "corridor.points_m = 0 points: must be 2 to 64"),
            (along(&[x(0.0)]), "corridor.points_m = 1 points: must be 2 to 64"),
            (along(&[x(0.0); 65]), "corridor.points_m = 65 points"),
            (along(&[x(0.0), x(inf)]), "corridor.points_m[1].x = inf"),
            (Corridor { points_m: [x(0.0); 2].into(), radius_m: -0.1 }, "corridor.radius_m = -0.1"),
            (guide(GuidePath::Point { point_m: x(nan) }), "guide.point.point_m.x = NaN"),
            (line(x(0.0)), "guide.line.direction = 0: must be a number in 0.000001"),
            (line(x(nan)), "guide.line.direction = NaN"),
            (plane(x(0.0)), "guide.plane.normal = 0"),
            (
                Guide { path: GuidePath::Point { point_m: x(0.0) }, radius_m: inf },
                "guide.radius_m = inf: must be a number in 0 to 100 m",
            ),
            (Constant { force_N: x(nan) }, "constant.force_n.x = NaN"),
            (Viscous { damping_Ns_per_m: -1.0 }, "viscous.damping_ns_per_m = -1"),
            (field(|k, _, _| k[5] = nan), "force_field.stiffness_n_per_m = NaN"),
            (field(|_, b, _| b[3] = -2e6), "force_field.damping_ns_per_m = -2000000: must be"),
            (field(|_, _, r| *r = inf), "force_field.radius_m = inf"),
        ];
        for (kind, expected) in refusals {
            let refused = check_kind(kind).unwrap_err().to_string();
            assert!(refused.starts_with(expected), "{refused} / {expected}");
        }
        for fine in [capsule(0.0, 0.1), along(&[x(0.0); 64]), along(&[x(0.0); 2])] {
            assert!(check_kind(fine.clone()).is_ok(), "{fine:?}");
        }
    }

    #[test]
    fn each_field_of_a_material_is_refused_by_its_name() {
        type Change = fn(&mut Material);
        let refusals: [(Change, &str); 8] = [
            (|m| m.stiffness_N_per_m = -1.0, "material.stiffness_n_per_m = -1"),
            (|m| m.stiffness_N_per_m = f64::NAN, "material.stiffness_n_per_m = NaN"),
            (|m| m.damping_Ns_per_m = f64::INFINITY, "material.damping_ns_per_m = inf"),
            (|m| m.kinetic_friction = 11.0, "material.kinetic_friction = 11"),
            (|m| m.kinetic_friction = f64::NAN, "material.kinetic_friction = NaN"),
            (|m| m.static_friction = f64::NAN, "material.static_friction = NaN"),
            (
                |m| m.kinetic_friction = 0.6,
                "material.static_friction = 0.5: must be at least kinetic_friction, 0.6",
            ),
            (
                |m| m.surface_velocity_W_m_per_s.z = 101.0,
                "material.surface_velocity_m_per_s.z = 101: must be a number in -100 to 100 m/s",
            ),
        ];
        for (change, expected) in refusals {
            let mut material = Material { stiffness_N_per_m: 1e3, ..Material::default() };
            material = material.with_friction(0.5);
            assert_eq!(check_material(&material), Ok(()));
            change(&mut material);
            let refused = check_material(&material).unwrap_err().to_string();
            assert!(refused.starts_with(expected), "{refused} / {expected}");
        }
    }

    #[test]
    fn a_matrix_is_written_as_short_as_it_can_be_and_reads_back() {
        let full: Vec<f64> = (1..=9).map(f64::from).collect();
        for written in [vec![], vec![1.0, -2.0, 0.0], full] {
            let read = matrix("stiffness", &written).unwrap();
            assert_eq!(numbers(&read), written);
        }
        assert_eq!(matrix("k", &[1.0; 9]).unwrap(), Matrix3::repeat(1.0));
        assert_eq!(matrix("k", &[0.0, 1.0, 0., 0., 0., 0., 0., 0., 0.]).unwrap()[(0, 1)], 1.0);
        for length in [1, 2, 4, 8, 10] {
            let refused = matrix("k", &vec![0.0; length]).unwrap_err().to_string();
            assert!(refused.starts_with(&format!("k = {length} numbers: must have 0, 3")));
        }
    }
}
