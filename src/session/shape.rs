//! Where a controller's contact lies: its shape as one of the environment's.
//!
//! Every number passes the ranges of `units` once; an error names the field, as
//! `box.half_extents_m`, the value and what is allowed. Directions and orientations leave here
//! with length 1. Everything is in the client's world; [`super::workspace`] maps it.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::contact::{checked, within};
use crate::environment::{Guide, Shape};
use crate::proto::{GuideContact, contact, guide_contact::Path};
use crate::units::{FieldError, GUIDE_RADIUS, POSITION, QUATERNION_LENGTH, RADIUS};
use crate::wire::get3;

/// A shorter normal has no direction worth the name.
const SHORTEST_NORMAL: f64 = 1e-6;

/// The shape of one contact.
pub(super) fn shape(wanted: Option<&contact::Shape>) -> Result<Shape, FieldError> {
    match wanted {
        Some(contact::Shape::HalfSpace(wall)) => Ok(Shape::HalfSpace {
            point_W_m: within(&POSITION, "half_space.point_m", &wall.point_m)?,
            normal_W: unit("half_space.normal", &wall.normal)?,
        }),
        Some(contact::Shape::Sphere(ball)) => Ok(Shape::Sphere {
            centre_W_m: within(&POSITION, "sphere.centre_m", &ball.centre_m)?,
            radius_m: checked(&RADIUS, "sphere.radius_m", ball.radius_m)?,
        }),
        Some(contact::Shape::Box(block)) => Ok(Shape::Box {
            centre_W_m: within(&POSITION, "box.centre_m", &block.centre_m)?,
            half_extents_m: within(&RADIUS, "box.half_extents_m", &block.half_extents_m)?,
            q_WS: orientation("box.orientation", &block.orientation)?,
        }),
        Some(contact::Shape::Capsule(capsule)) => Ok(Shape::Capsule {
            ends_W_m: ends("capsule.ends_m", &capsule.ends_m)?,
            radius_m: checked(&RADIUS, "capsule.radius_m", capsule.radius_m)?,
        }),
        Some(contact::Shape::Guide(guide)) => Ok(Shape::Guide {
            path: path(guide)?,
            radius_m: checked(&GUIDE_RADIUS, "guide.radius_m", guide.radius_m)?,
        }),
        None => {
            let allowed = "must be half_space, sphere, box, capsule or guide";
            Err(FieldError::new("shape", "absent", allowed))
        }
    }
}

fn path(guide: &GuideContact) -> Result<Guide, FieldError> {
    match &guide.path {
        Some(Path::Point(point)) => Ok(Guide::Point {
            point_W_m: within(&POSITION, "guide.point.point_m", &point.point_m)?,
        }),
        Some(Path::Line(line)) => Ok(Guide::Line {
            point_W_m: within(&POSITION, "guide.line.point_m", &line.point_m)?,
            direction_W: unit("guide.line.direction", &line.direction)?,
        }),
        Some(Path::Plane(plane)) => Ok(Guide::Plane {
            point_W_m: within(&POSITION, "guide.plane.point_m", &plane.point_m)?,
            normal_W: unit("guide.plane.normal", &plane.normal)?,
        }),
        None => Err(FieldError::new("guide.path", "absent", "must be point, line or plane")),
    }
}

fn ends(field: &str, floats: &[f32]) -> Result<[Vector3<f64>; 2], FieldError> {
    if floats.len() != 6 {
        let found = format!("{} numbers", floats.len());
        return Err(FieldError::new(field, found, "must have 6, 3 for each end"));
    }
    let (a, b) = floats.split_at(3);
    Ok([within(&POSITION, field, a)?, within(&POSITION, field, b)?])
}

/// x y z w of length 1, to a hundredth; none: not turned.
fn orientation(field: &str, floats: &[f32]) -> Result<UnitQuaternion<f64>, FieldError> {
    let (x, y, z, w) = match *floats {
        [] => return Ok(UnitQuaternion::identity()),
        [x, y, z, w] => (x, y, z, w),
        _ => {
            let found = format!("{} numbers", floats.len());
            return Err(FieldError::new(field, found, "must have 4 (x y z w), or none"));
        }
    };
    let written = Quaternion::new(w, x, y, z).cast::<f64>();
    QUATERNION_LENGTH.check(field, written.norm())?;
    Ok(UnitQuaternion::new_normalize(written))
}

fn unit(field: &str, floats: &[f32]) -> Result<Vector3<f64>, FieldError> {
    let vector = Vector3::from(get3(field, floats)?);
    let length = vector.norm();
    if length < SHORTEST_NORMAL {
        let allowed = format!("must have a length of at least {SHORTEST_NORMAL}");
        return Err(FieldError::new(field, format!("length {length}"), allowed));
    }
    Ok(vector / length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proto::{
        BoxContact, CapsuleContact, GuideLineContact, GuidePlaneContact, GuidePointContact,
        HalfSpaceContact, SphereContact,
    };
    use contact::Shape as Wanted;
    use proptest::prelude::*;

    fn block(half_extents_m: &[f32], orientation: &[f32]) -> Wanted {
        Wanted::Box(BoxContact {
            centre_m: vec![0.5, 0.0, 0.0],
            half_extents_m: half_extents_m.to_vec(),
            orientation: orientation.to_vec(),
        })
    }

    fn ball(radius_m: f32) -> Wanted {
        Wanted::Sphere(SphereContact { centre_m: vec![0.0, 0.5, 0.0], radius_m })
    }

    fn wall(point_m: &[f32], normal: &[f32]) -> Wanted {
        let (point_m, normal) = (point_m.to_vec(), normal.to_vec());
        Wanted::HalfSpace(HalfSpaceContact { point_m, normal })
    }

    fn capsule(ends_m: &[f32], radius_m: f32) -> Wanted {
        Wanted::Capsule(CapsuleContact { ends_m: ends_m.to_vec(), radius_m })
    }

    fn guide(path: Option<Path>) -> Wanted {
        Wanted::Guide(GuideContact { radius_m: 0.25, path })
    }

    fn line(direction: &[f32]) -> Wanted {
        let (point_m, direction) = (vec![0.5; 3], direction.to_vec());
        guide(Some(Path::Line(GuideLineContact { point_m, direction })))
    }

    fn plane(normal: &[f32]) -> Wanted {
        let (point_m, normal) = (vec![0.5; 3], normal.to_vec());
        guide(Some(Path::Plane(GuidePlaneContact { point_m, normal })))
    }

    fn point(point_m: &[f32]) -> Wanted {
        guide(Some(Path::Point(GuidePointContact { point_m: point_m.to_vec() })))
    }

    #[test]
    fn every_shape_comes_out_as_it_was_written() {
        let half = Vector3::new(0.5, 0.25, 0.001f32.into());
        let read = |wanted: Wanted| shape(Some(&wanted)).unwrap();
        let (point_W_m, centre_W_m) = (Vector3::repeat(0.5), Vector3::new(0.5, 0.0, 0.0));
        // Half a turn about z, and none.
        for (written, q_WS) in [
            (
                &[0.0, 0.0, 1.0, 0.0][..],
                UnitQuaternion::from_euler_angles(0.0, 0.0, std::f64::consts::PI),
            ),
            (&[], UnitQuaternion::identity()),
        ] {
            let Shape::Box { centre_W_m: centre, q_WS: q, half_extents_m } =
                read(block(&[0.5, 0.25, 0.001], written))
            else {
                panic!("a box")
            };
            assert_eq!((centre, half_extents_m), (centre_W_m, half));
            assert!(q.angle_to(&q_WS) < 1e-15);
        }
        let ends_W_m = [Vector3::new(0.0, 0.5, 1.0), Vector3::new(1.0, 0.5, 0.0)];
        assert_eq!(
            read(capsule(&[0.0, 0.5, 1.0, 1.0, 0.5, 0.0], 0.5)),
            Shape::Capsule { ends_W_m, radius_m: 0.5 }
        );
        let lead = |path| Shape::Guide { path, radius_m: 0.25 };
        assert_eq!(read(point(&[0.5; 3])), lead(Guide::Point { point_W_m }));
        let direction_W = Vector3::y();
        assert_eq!(read(line(&[0.0, 4.0, 0.0])), lead(Guide::Line { point_W_m, direction_W }));
        let normal_W = -Vector3::x();
        assert_eq!(read(plane(&[-2.0, 0.0, 0.0])), lead(Guide::Plane { point_W_m, normal_W }));
        assert_eq!(
            read(wall(&[0.5; 3], &[-2.0, 0., 0.])),
            Shape::HalfSpace { point_W_m, normal_W }
        );
    }

    #[test]
    fn every_bad_field_of_a_shape_is_refused_by_its_name() {
        let (nan, inf) = (f32::NAN, f32::INFINITY);
        for (wanted, expected) in [
            (wall(&[0.0; 2], &[1.0; 3]), "half_space.point_m = 2 numbers: must have 3"),
            (wall(&[101.0; 3], &[1.0; 3]), "half_space.point_m = 101: must be a number in -100"),
            (wall(&[0.0; 3], &[1e-7, 0.0, 0.0]), "half_space.normal = length 0.000000"),
            (ball(0.0), "sphere.radius_m = 0: must be a number in 0.0001 to 100 m"),
            (block(&[0.5, 0.0, 0.5], &[]), "box.half_extents_m = 0: must be a number in 0.0001"),
            (block(&[0.5; 2], &[]), "box.half_extents_m = 2 numbers: must have 3"),
            (block(&[0.5, nan, 0.5], &[]), "box.half_extents_m = NaN: must be finite"),
            (block(&[0.5; 3], &[0.0; 4]), "box.orientation = 0: must be a number in 0.99 to 1.01"),
            (block(&[0.5; 3], &[1.0; 3]), "box.orientation = 3 numbers: must have 4 (x y z w)"),
            (block(&[0.5; 3], &[nan; 4]), "box.orientation = NaN"),
            (block(&[0.5; 3], &[inf, 0.0, 0.0, 0.0]), "box.orientation = inf"),
            (capsule(&[0.0; 3], 0.5), "capsule.ends_m = 3 numbers: must have 6, 3 for each end"),
            (capsule(&[0.0, 0.0, 0.0, 0.0, inf, 0.0], 0.5), "capsule.ends_m = inf: must be finite"),
            (capsule(&[0.0; 6], -0.5), "capsule.radius_m = -0.5: must be a number"),
            (guide(None), "guide.path = absent: must be point, line or plane"),
            (point(&[nan; 3]), "guide.point.point_m = NaN: must be finite"),
            (line(&[0.0; 3]), "guide.line.direction = length 0: must have a length of at least"),
            (plane(&[]), "guide.plane.normal = 0 numbers: must have 3"),
            (
                Wanted::Guide(GuideContact { radius_m: -0.1, ..GuideContact::default() }),
                "guide.path = absent",
            ),
        ] {
            let message = shape(Some(&wanted)).unwrap_err().to_string();
            assert!(message.starts_with(expected), "{message} / {expected}");
        }
        let Wanted::Guide(lead) = point(&[0.0; 3]) else { panic!() };
        let beyond = Wanted::Guide(GuideContact { radius_m: 101.0, ..lead });
        let message = shape(Some(&beyond)).unwrap_err().to_string();
        assert!(message.starts_with("guide.radius_m = 101: must be a number in 0 to 100 m"));
    }

    #[test]
    fn the_ends_of_every_range_are_inside_though_floats_round_them() {
        for radius_m in [1e-4, 100.0] {
            assert!(shape(Some(&ball(radius_m))).is_ok());
            assert!(shape(Some(&block(&[radius_m; 3], &[]))).is_ok());
        }
        assert!(shape(Some(&wall(&[100.0; 3], &[0.0, 0.0, f32::MAX]))).is_ok());
        assert!(shape(Some(&capsule(&[-100.0; 6], 100.0))).is_ok(), "of no length, but a ball");
    }

    proptest! {
        #[test]
        fn whatever_is_accepted_has_finite_places_and_unit_directions(
            bits in prop::collection::vec(any::<u32>(), 10),
            tame in prop::collection::vec(-0.6f32..0.6, 10),
            wild in any::<u16>(),
            kind in 0..6,
        ) {
            let numbers: Vec<f32> = (0..10)
                .map(|i| if wild >> i & 1 == 1 { f32::from_bits(bits[i]) } else { tame[i] })
                .collect();
            let wanted = match kind {
                0 => wall(&numbers[..3], &numbers[3..6]),
                1 => ball(numbers[0]),
                2 => block(&numbers[..3], &numbers[3..7]),
                3 => capsule(&numbers[..6], numbers[6]),
                4 => line(&numbers[..3]),
                _ => plane(&numbers[..3]),
            };
            if let Ok(shape) = shape(Some(&wanted)) {
                for p in [Vector3::zeros(), Vector3::new(0.1, 0.2, 0.3)] {
                    let nearest = shape.nearest(&p);
                    prop_assert!(nearest.distance_m.is_finite(), "{shape:?}");
                    prop_assert!((nearest.normal_W.norm() - 1.0).abs() < 1e-9, "{shape:?}");
                }
            }
        }
    }
}
