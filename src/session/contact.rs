//! A controller's contacts as surfaces of the environment.
//!
//! Every number passes the ranges of `units` once; an error names the contact, the field,
//! the value and what is allowed. Normals leave here with length 1.

use nalgebra::Vector3;

use crate::environment::{Contact, MAX_CONTACTS, Material, Shape, Surface};
use crate::proto::{self, contact};
use crate::units::{DAMPING, FRICTION, FieldError, POSITION, RADIUS, Range, STIFFNESS};
use crate::wire::get3;

use super::mapping::SCENE_ID;

/// The longest blend, milliseconds.
const MAX_BLEND_MS: u32 = 1000;

/// A shorter normal has no direction worth the name.
const SHORTEST_NORMAL: f64 = 1e-6;

/// The contacts of one command, all of them or none.
pub(super) fn contacts(wanted: &[proto::Contact]) -> Result<Vec<Contact>, FieldError> {
    if wanted.len() > MAX_CONTACTS {
        let allowed = format!("must be at most {MAX_CONTACTS}");
        return Err(FieldError::new("contacts", wanted.len(), allowed));
    }
    let mut contacts: Vec<Contact> = Vec::with_capacity(wanted.len());
    for (index, wanted) in wanted.iter().enumerate() {
        let contact = contact(wanted).map_err(|error| error.within(&place(index)))?;
        if contacts.iter().any(|earlier| earlier.id == contact.id) {
            let error = FieldError::new("id", contact.id, "must be unique in the command");
            return Err(error.within(&place(index)));
        }
        contacts.push(contact);
    }
    Ok(contacts)
}

fn place(index: usize) -> String {
    format!("contacts[{index}]")
}

fn contact(wanted: &proto::Contact) -> Result<Contact, FieldError> {
    if wanted.id >= SCENE_ID {
        let allowed = format!("must be at most {}", SCENE_ID - 1);
        return Err(FieldError::new("id", wanted.id, allowed));
    }
    if wanted.blend_ms > MAX_BLEND_MS {
        let allowed = format!("must be 0 to {MAX_BLEND_MS} ms");
        return Err(FieldError::new("blend_ms", wanted.blend_ms, allowed));
    }
    Ok(Contact {
        id: wanted.id,
        revision: wanted.revision,
        surface: Surface {
            shape: shape(wanted.shape.as_ref())?,
            material: Material {
                stiffness_N_per_m: checked(
                    &STIFFNESS,
                    "stiffness_n_per_m",
                    wanted.stiffness_n_per_m,
                )?,
                damping_Ns_per_m: checked(&DAMPING, "damping_ns_per_m", wanted.damping_ns_per_m)?,
                ..Material::default().with_friction(checked(
                    &FRICTION,
                    "friction",
                    wanted.friction,
                )?)
            },
            hollow: wanted.hollow,
            blend_s: f64::from(wanted.blend_ms) * 1e-3,
        },
    })
}

fn shape(wanted: Option<&contact::Shape>) -> Result<Shape, FieldError> {
    match wanted {
        Some(contact::Shape::HalfSpace(wall)) => Ok(Shape::HalfSpace {
            point_W_m: position("half_space.point_m", &wall.point_m)?,
            normal_W: unit("half_space.normal", &wall.normal)?,
        }),
        Some(contact::Shape::Sphere(ball)) => Ok(Shape::Sphere {
            centre_W_m: position("sphere.centre_m", &ball.centre_m)?,
            radius_m: checked(&RADIUS, "sphere.radius_m", ball.radius_m)?,
        }),
        None => Err(FieldError::new("shape", "absent", "must be half_space or sphere")),
    }
}

fn position(field: &str, floats: &[f32]) -> Result<Vector3<f64>, FieldError> {
    let vector = get3(field, floats)?;
    for value in vector {
        POSITION.check(field, value)?;
    }
    Ok(vector.into())
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

/// A float inside a range. The float nearest to a bound may lie just beyond it: it means
/// the bound.
fn checked(range: &Range, field: &str, value: f32) -> Result<f64, FieldError> {
    let meant = if value == range.min as f32 {
        range.min
    } else if value == range.max as f32 {
        range.max
    } else {
        f64::from(value)
    };
    range.check(field, meant).map_err(|mut error| {
        error.value = value.to_string(); // as it was written, not as a double
        error
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proto::{HalfSpaceContact, SphereContact};
    use proptest::prelude::*;

    fn wall(id: u32) -> proto::Contact {
        proto::Contact {
            id,
            revision: 3,
            shape: Some(contact::Shape::HalfSpace(HalfSpaceContact {
                point_m: vec![0.25, 0.0, 0.0],
                normal: vec![-2.0, 0.0, 0.0],
            })),
            stiffness_n_per_m: 1000.0,
            damping_ns_per_m: 2.0,
            friction: 0.5,
            hollow: true,
            blend_ms: 250,
        }
    }

    fn ball(radius_m: f32) -> proto::Contact {
        let shape = SphereContact { centre_m: vec![0.0, 0.5, 0.0], radius_m };
        proto::Contact { shape: Some(contact::Shape::Sphere(shape)), ..wall(9) }
    }

    fn refused(wanted: &[proto::Contact]) -> String {
        contacts(wanted).unwrap_err().to_string()
    }

    #[test]
    fn contacts_become_surfaces_with_unit_normals() {
        let contacts = contacts(&[wall(1), ball(0.125)]).unwrap();
        assert_eq!((contacts[0].id, contacts[0].revision), (1, 3));
        let expected = Surface {
            shape: Shape::HalfSpace {
                point_W_m: Vector3::new(0.25, 0.0, 0.0),
                normal_W: -Vector3::x(),
            },
            material: Material {
                stiffness_N_per_m: 1000.0,
                damping_Ns_per_m: 2.0,
                ..Material::default().with_friction(0.5)
            },
            hollow: true,
            blend_s: 0.25,
        };
        assert_eq!(contacts[0].surface, expected);
        let shape = Shape::Sphere { centre_W_m: Vector3::new(0.0, 0.5, 0.0), radius_m: 0.125 };
        assert_eq!(contacts[1].surface.shape, shape);
    }

    #[test]
    fn one_bad_contact_refuses_all_of_them_by_name() {
        type Change = fn(&mut proto::Contact);
        let changes: [(Change, &str); 11] = [
            (|c| c.shape = None, "shape = absent: must be half_space or sphere"),
            (|c| c.id = SCENE_ID, "id = 2147483648: must be at most 2147483647"),
            (|c| c.blend_ms = 1001, "blend_ms = 1001: must be 0 to 1000 ms"),
            (|c| c.friction = -0.1, "friction = -0.1: must be a number in 0 to 10"),
            (|c| c.friction = f32::NAN, "friction = NaN: must be a number in 0 to 10"),
            (|c| c.stiffness_n_per_m = 2e9, "stiffness_n_per_m = 2000000000: must be a number"),
            (|c| c.damping_ns_per_m = f32::INFINITY, "damping_ns_per_m = inf: must be a number"),
            (|c| *c = ball(0.0), "sphere.radius_m = 0: must be a number in 0.0001 to 100 m"),
            (|c| point(c, vec![0.0; 2]), "half_space.point_m = 2 numbers: must have 3"),
            (|c| point(c, vec![101.0; 3]), "half_space.point_m = 101: must be a number in -100"),
            (|c| normal(c, vec![1e-7, 0.0, 0.0]), "half_space.normal = length 0.000000"),
        ];
        for (change, expected) in changes {
            let mut bad = wall(2);
            change(&mut bad);
            let message = refused(&[wall(1), bad]);
            let expected = format!("contacts[1].{expected}");
            assert!(message.starts_with(&expected), "{message} / {expected}");
        }
    }

    fn point(contact: &mut proto::Contact, point_m: Vec<f32>) {
        if let Some(contact::Shape::HalfSpace(wall)) = &mut contact.shape {
            wall.point_m = point_m;
        }
    }

    fn normal(contact: &mut proto::Contact, normal: Vec<f32>) {
        if let Some(contact::Shape::HalfSpace(wall)) = &mut contact.shape {
            wall.normal = normal;
        }
    }

    #[test]
    fn the_ends_of_every_range_are_inside_though_floats_round_them() {
        for radius_m in [1e-4, 100.0] {
            assert!(contacts(&[ball(radius_m)]).is_ok());
        }
        let mut stiff = wall(SCENE_ID - 1);
        (stiff.stiffness_n_per_m, stiff.friction, stiff.blend_ms) = (1e9, 10.0, 1000);
        normal(&mut stiff, vec![0.0, 0.0, f32::MAX]);
        assert!(contacts(&[stiff]).is_ok());
    }

    #[test]
    fn eight_contacts_are_the_most_and_their_ids_differ() {
        assert!(contacts(&(0..8).map(wall).collect::<Vec<_>>()).is_ok());
        let nine = (0..9).map(wall).collect::<Vec<_>>();
        assert_eq!(refused(&nine), "contacts = 9: must be at most 8");
        let twins = [wall(1), wall(2), wall(1)];
        assert_eq!(refused(&twins), "contacts[2].id = 1: must be unique in the command");
    }

    proptest! {
        #[test]
        fn whatever_is_accepted_is_finite_and_in_range(
            bits in prop::collection::vec(any::<u32>(), 10),
            tame in prop::collection::vec(-0.5f32..12.0, 10),
            wild in any::<u16>(),
        ) {
            let float = |i: usize| {
                if wild >> i & 1 == 1 { f32::from_bits(bits[i]) } else { tame[i] }
            };
            let mut contact = wall(1);
            point(&mut contact, (0..3).map(float).collect());
            normal(&mut contact, (3..6).map(float).collect());
            contact.stiffness_n_per_m = float(6);
            contact.damping_ns_per_m = float(7);
            contact.friction = float(8);
            if let Ok(contacts) = contacts(&[contact, ball(float(9))]) {
                for contact in contacts {
                    let Material { stiffness_N_per_m, damping_Ns_per_m, static_friction, .. } =
                        contact.surface.material;
                    prop_assert!((0.0..=1e9).contains(&stiffness_N_per_m));
                    prop_assert!((0.0..=1e6).contains(&damping_Ns_per_m));
                    prop_assert!((0.0..=10.0).contains(&static_friction));
                    match contact.surface.shape {
                        Shape::HalfSpace { point_W_m, normal_W } => {
                            prop_assert!(point_W_m.amax() <= 100.0);
                            prop_assert!((normal_W.norm() - 1.0).abs() < 1e-12);
                        }
                        Shape::Sphere { radius_m, .. } => {
                            prop_assert!((1e-4..=100.0).contains(&radius_m));
                        }
                        other => panic!("a shape that no message has: {other:?}"),
                    }
                }
            }
        }
    }
}
