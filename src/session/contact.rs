//! A controller's contacts as surfaces of the environment.
//!
//! Every number passes the ranges of `units` once; an error names the contact, the field,
//! the value and what is allowed. Where a contact lies is read by [`super::shape`]. Everything
//! is still in the client's world.

use nalgebra::Vector3;

use crate::environment::{Contact, MAX_CONTACTS, Material, Shape, Surface};
use crate::proto;
use crate::units::{DAMPING, FRICTION, FieldError, Range, STIFFNESS, SURFACE_VELOCITY};
use crate::wire::get3;

use super::mapping::SCENE_ID;
use super::shape::shape;

/// The longest blend, milliseconds.
const MAX_BLEND_MS: u32 = 1000;

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
    let shape = shape(wanted.shape.as_ref())?;
    if wanted.hollow && matches!(shape, Shape::Guide { .. }) {
        return Err(FieldError::new("hollow", "true", "a guide cannot be hollow"));
    }
    Ok(Contact {
        id: wanted.id,
        revision: wanted.revision,
        surface: Surface {
            shape,
            material: material(wanted)?,
            hollow: wanted.hollow,
            blend_s: f64::from(wanted.blend_ms) * 1e-3,
        },
    })
}

fn material(wanted: &proto::Contact) -> Result<Material, FieldError> {
    let kinetic_friction = checked(&FRICTION, "kinetic_friction", wanted.kinetic_friction)?;
    let static_friction = match wanted.static_friction {
        Some(written) => checked(&FRICTION, "static_friction", written)?,
        None => kinetic_friction,
    };
    if static_friction < kinetic_friction {
        let allowed = format!("must be at least kinetic_friction, {}", wanted.kinetic_friction);
        return Err(FieldError::new("static_friction", static_friction as f32, allowed));
    }
    Ok(Material {
        stiffness_N_per_m: checked(&STIFFNESS, "stiffness_n_per_m", wanted.stiffness_n_per_m)?,
        damping_Ns_per_m: checked(&DAMPING, "damping_ns_per_m", wanted.damping_ns_per_m)?,
        kinetic_friction,
        static_friction,
        surface_velocity_W_m_per_s: match wanted.surface_velocity_m_per_s.as_slice() {
            [] => Vector3::zeros(),
            floats => within(&SURFACE_VELOCITY, "surface_velocity_m_per_s", floats)?,
        },
    })
}

/// Three numbers, each inside a range.
pub(super) fn within(
    range: &Range,
    field: &str,
    floats: &[f32],
) -> Result<Vector3<f64>, FieldError> {
    get3(field, floats)?;
    let mut vector = Vector3::zeros();
    for (part, value) in vector.iter_mut().zip(floats) {
        *part = checked(range, field, *value)?;
    }
    Ok(vector)
}

/// A float inside a range. The float nearest to a bound may lie just beyond it: it means
/// the bound.
pub(super) fn checked(range: &Range, field: &str, value: f32) -> Result<f64, FieldError> {
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
    use crate::proto::contact::Shape as Wanted;
    use crate::proto::{GuideContact, GuidePointContact, HalfSpaceContact, SphereContact};
    use proptest::prelude::*;

    fn wall(id: u32) -> proto::Contact {
        proto::Contact {
            id,
            revision: 3,
            stiffness_n_per_m: 1000.0,
            damping_ns_per_m: 2.0,
            kinetic_friction: 0.5,
            static_friction: Some(0.75),
            surface_velocity_m_per_s: vec![0.25, 0.0, -0.5],
            hollow: true,
            blend_ms: 250,
            shape: Some(Wanted::HalfSpace(HalfSpaceContact {
                point_m: vec![0.25, 0.0, 0.0],
                normal: vec![-2.0, 0.0, 0.0],
            })),
        }
    }

    fn refused(wanted: &[proto::Contact]) -> String {
        contacts(wanted).unwrap_err().to_string()
    }

    #[test]
    fn contacts_become_surfaces() {
        let ball = SphereContact { centre_m: vec![0.0, 0.5, 0.0], radius_m: 0.125 };
        let ball = proto::Contact {
            shape: Some(Wanted::Sphere(ball)),
            static_friction: None,
            surface_velocity_m_per_s: vec![],
            ..wall(9)
        };
        let contacts = contacts(&[wall(1), ball]).unwrap();
        assert_eq!((contacts[0].id, contacts[0].revision), (1, 3));
        let material = Material {
            stiffness_N_per_m: 1000.0,
            damping_Ns_per_m: 2.0,
            static_friction: 0.75,
            kinetic_friction: 0.5,
            surface_velocity_W_m_per_s: Vector3::new(0.25, 0.0, -0.5),
        };
        let shape =
            Shape::HalfSpace { point_W_m: Vector3::new(0.25, 0.0, 0.0), normal_W: -Vector3::x() };
        let expected = Surface { shape, material, hollow: true, blend_s: 0.25 };
        assert_eq!(contacts[0].surface, expected);
        let at_rest = Material {
            surface_velocity_W_m_per_s: Vector3::zeros(),
            ..material.with_friction(0.5)
        };
        assert_eq!(contacts[1].surface.material, at_rest);
    }

    #[test]
    fn one_bad_contact_refuses_all_of_them_by_name() {
        type Change = fn(&mut proto::Contact);
        let changes: [(Change, &str); 15] = [
            (|c| c.shape = None, "shape = absent: must be half_space, sphere, box, capsule"),
            (|c| c.id = SCENE_ID, "id = 2147483648: must be at most 2147483647"),
            (|c| c.blend_ms = 1001, "blend_ms = 1001: must be 0 to 1000 ms"),
            (|c| c.kinetic_friction = -0.1, "kinetic_friction = -0.1: must be a number in 0 to 10"),
            (|c| c.kinetic_friction = f32::NAN, "kinetic_friction = NaN: must be a number in 0"),
            (|c| c.static_friction = Some(f32::NAN), "static_friction = NaN: must be a number"),
            (|c| c.static_friction = Some(11.0), "static_friction = 11: must be a number"),
            (
                |c| c.static_friction = Some(0.4),
                "static_friction = 0.4: must be at least kinetic_friction, 0.5",
            ),
            (
                |c| c.surface_velocity_m_per_s = vec![0.0; 2],
                "surface_velocity_m_per_s = 2 numbers: must have 3",
            ),
            (
                |c| c.surface_velocity_m_per_s[2] = 101.0,
                "surface_velocity_m_per_s = 101: must be a number in -100 to 100 m/s",
            ),
            (
                |c| c.surface_velocity_m_per_s[1] = f32::NAN,
                "surface_velocity_m_per_s = NaN: must be finite",
            ),
            (|c| c.stiffness_n_per_m = 2e9, "stiffness_n_per_m = 2000000000: must be a number"),
            (|c| c.damping_ns_per_m = f32::INFINITY, "damping_ns_per_m = inf: must be a number"),
            (|c| c.shape = Some(lead()), "hollow = true: a guide cannot be hollow"),
            (
                |c| c.shape = Some(Wanted::Sphere(SphereContact::default())),
                "sphere.centre_m = 0 numbers: must have 3",
            ),
        ];
        for (change, expected) in changes {
            let mut bad = wall(2);
            change(&mut bad);
            let message = refused(&[wall(1), bad]);
            let expected = format!("contacts[1].{expected}");
            assert!(message.starts_with(&expected), "{message} / {expected}");
        }
        let guide = proto::Contact { shape: Some(lead()), hollow: false, ..wall(1) };
        assert!(contacts(&[guide]).is_ok());
    }

    fn lead() -> Wanted {
        let path = proto::guide_contact::Path::Point(GuidePointContact { point_m: vec![0.0; 3] });
        Wanted::Guide(GuideContact { radius_m: 0.0, path: Some(path) })
    }

    #[test]
    fn the_ends_of_every_range_are_inside_though_floats_round_them() {
        let mut stiff = wall(SCENE_ID - 1);
        (stiff.stiffness_n_per_m, stiff.kinetic_friction, stiff.blend_ms) = (1e9, 10.0, 1000);
        stiff.static_friction = Some(10.0);
        stiff.surface_velocity_m_per_s = vec![-100.0, 100.0, 0.0];
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
            bits in prop::collection::vec(any::<u32>(), 7),
            tame in prop::collection::vec(-0.5f32..12.0, 7),
            wild in any::<u8>(),
        ) {
            let float = |i: usize| {
                if wild >> i & 1 == 1 { f32::from_bits(bits[i]) } else { tame[i] }
            };
            let contact = proto::Contact {
                stiffness_n_per_m: float(0),
                damping_ns_per_m: float(1),
                kinetic_friction: float(2),
                static_friction: Some(float(3)),
                surface_velocity_m_per_s: (4..7).map(float).collect(),
                ..wall(1)
            };
            if let Ok(contacts) = contacts(&[contact]) {
                let material = contacts[0].surface.material;
                prop_assert!((0.0..=1e9).contains(&material.stiffness_N_per_m));
                prop_assert!((0.0..=1e6).contains(&material.damping_Ns_per_m));
                prop_assert!((0.0..=10.0).contains(&material.kinetic_friction));
                prop_assert!(material.static_friction >= material.kinetic_friction);
                prop_assert!(material.static_friction <= 10.0);
                prop_assert!(material.surface_velocity_W_m_per_s.amax() <= 100.0);
            }
        }
    }
}
