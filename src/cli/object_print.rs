//! How an object of a scene looks: in words on a terminal, and as JSON with the keys of
//! `scene.proto`, which a scene file has as well.

use anyhow::Context;
use serde_json::Value;

use super::format::vector;
use super::object_fields::KindName;
use crate::config::{Id, ObjectLayout, SceneObject, object_from_proto};
use crate::proto::guide::Path;
use crate::proto::scene_object::Kind;
use crate::proto::{self, Vector3};

/// One object, on lines of its own.
pub fn print(object: &proto::SceneObject, as_json: bool) -> anyhow::Result<()> {
    if as_json {
        say!("{}", object_json(object)?);
        return Ok(());
    }
    let hollow = if object.hollow { ", hollow" } else { "" };
    say!("{}: {}{hollow}", last_part(&object.name), in_words(object.kind.as_ref()));
    let material = object.material.as_ref().map(material_in_words).unwrap_or_default();
    say!("  {material}revision {}", object.revision);
    Ok(())
}

/// As the scene file has it, with its whole name and its revision.
pub fn object_json(object: &proto::SceneObject) -> anyhow::Result<Value> {
    let mut all = serde_json::to_value(ObjectLayout::from(&understood(object)?))?;
    if let Some(keys) = all.as_object_mut() {
        keys.remove("id");
    }
    all["name"] = object.name.as_str().into();
    all["revision"] = object.revision.into();
    Ok(all)
}

/// An object that the server sent, as this program knows objects.
pub fn understood(object: &proto::SceneObject) -> anyhow::Result<SceneObject> {
    let id = Id::parse("name", last_part(&object.name));
    let object_is = || format!("cannot make sense of {} as the server has it", object.name);
    id.and_then(|id| object_from_proto(id, object)).with_context(object_is)
}

fn last_part(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or_default()
}

fn in_words(kind: Option<&Kind>) -> String {
    let Some(kind) = kind else { return "of an unknown kind".into() };
    let at = |point: &Option<Vector3>| format!("at {} m", vector(point.as_ref(), 4));
    let along = |direction: &Option<Vector3>| vector(direction.as_ref(), 3);
    let word = KindName::of(kind).map_or_else(|| "guide".into(), KindName::word);
    match kind {
        Kind::HalfSpace(wall) => {
            format!("wall {}, out along {}", at(&wall.point_m), along(&wall.normal))
        }
        Kind::Sphere(ball) => format!("{word} {}, radius {} m", at(&ball.centre_m), ball.radius_m),
        Kind::Box(block) => {
            let turned = block.orientation.map_or_else(String::new, |q| {
                format!(", turned by ({:.3}, {:.3}, {:.3}, {:.3})", q.x, q.y, q.z, q.w)
            });
            let half = vector(block.half_extents_m.as_ref(), 4);
            format!("{word} {}, half extents {half} m{turned}", at(&block.centre_m))
        }
        Kind::Capsule(capsule) => {
            let ends: Vec<_> = capsule.ends_m.iter().map(|end| vector(Some(end), 4)).collect();
            format!("{word} from {} m, radius {} m", ends.join(" to "), capsule.radius_m)
        }
        Kind::Corridor(corridor) => {
            let (first, last) = (corridor.points_m.first(), corridor.points_m.last());
            let (first, last) = (vector(first, 4), vector(last, 4));
            let (points, radius_m) = (corridor.points_m.len(), corridor.radius_m);
            format!("{word} from {first} to {last} m, {points} points, radius {radius_m} m")
        }
        Kind::Guide(guide) => {
            let path = match &guide.path {
                Some(Path::Point(point)) => at(&point.point_m),
                Some(Path::Line(line)) => {
                    format!("{}, along {}", at(&line.point_m), along(&line.direction))
                }
                Some(Path::Plane(plane)) => {
                    format!("{}, across {}", at(&plane.point_m), along(&plane.normal))
                }
                None => String::new(),
            };
            format!("{word} {path}, radius {} m", guide.radius_m)
        }
        Kind::Constant(field) => {
            format!("force {} N everywhere", vector(field.force_n.as_ref(), 2))
        }
        Kind::Viscous(field) => format!("viscous, {} N s/m", field.damping_ns_per_m),
        Kind::ForceField(field) => {
            let wrench = field.wrench.unwrap_or_default();
            let force = wrench.force_n.unwrap_or_default();
            let moment = wrench.moment_nm.unwrap_or_default();
            let within = match field.radius_m {
                0.0 => "everywhere".to_owned(),
                radius_m => format!("within {radius_m} m"),
            };
            format!(
                "{word} {}: {} N, {} N m, {:?} N/m, {:?} N s/m, {within}",
                at(&field.origin_m),
                vector(Some(&force), 2),
                vector(Some(&moment), 3),
                field.stiffness_n_per_m,
                field.damping_ns_per_m
            )
        }
    }
}

fn material_in_words(material: &proto::Material) -> String {
    let kinetic = material.kinetic_friction;
    let friction = match material.static_friction {
        Some(holds) => format!("friction {holds} at rest, {kinetic} slipping"),
        None => format!("friction {kinetic}"),
    };
    let velocity = material.surface_velocity_m_per_s;
    let moving =
        velocity.map_or_else(String::new, |v| format!(", moves at {} m/s", vector(Some(&v), 3)));
    let (stiffness, damping) = (material.stiffness_n_per_m, material.damping_ns_per_m);
    format!("{stiffness} N/m, {damping} N s/m, {friction}{moving}, ")
}
