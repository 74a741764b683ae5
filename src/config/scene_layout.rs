//! The TOML of a scene file: a layout for each kind of object, and the way in and out.
//!
//! Keys are those of `scene.proto`. Numbers are written so that they read back bit by bit.
//! The last line says that the text is whole; without it [`SceneTextError::CutShort`].

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::error::{self, ConfigError};
use super::{Id, ObjectKind, Scene, SceneObject};
use crate::environment::Material;
use crate::units::{self, FieldError};

const FIRST_LINE: &str = "# A scene of hapticd. Edit it only while the server is stopped.\n";

/// Closes every whole file.
pub(super) const LAST_LINE: &str = "# end of scene";

/// Why a text is no scene.
#[derive(Debug)]
pub(super) enum SceneTextError {
    /// The last line is missing.
    CutShort,
    /// The layout or a value is wrong.
    Malformed(ConfigError),
}

/// The layout of the file.
#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Layout {
    revision: i64,
    #[serde(default, rename = "object", skip_serializing_if = "Vec::is_empty")]
    objects: Vec<ObjectLayout>,
}

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct ObjectLayout {
    id: String,
    slot: i64,
    revision: i64,
    #[serde(default)]
    hollow: bool,
    half_space: Option<HalfSpaceLayout>,
    sphere: Option<SphereLayout>,
    constant: Option<ConstantLayout>,
    viscous: Option<ViscousLayout>,
    material: Option<MaterialLayout>,
}

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct HalfSpaceLayout {
    point_m: [f64; 3],
    normal: [f64; 3],
}

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct SphereLayout {
    centre_m: [f64; 3],
    radius_m: f64,
}

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct ConstantLayout {
    force_n: [f64; 3],
}

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct ViscousLayout {
    damping_ns_per_m: f64,
}

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct MaterialLayout {
    stiffness_n_per_m: f64,
    damping_ns_per_m: f64,
    friction: f64,
}

/// The scene in the text of a file; `file` is for messages only.
pub(super) fn read_scene(text: &str, file: &str) -> Result<Scene, SceneTextError> {
    if text.lines().next_back().map(str::trim_end) != Some(LAST_LINE) {
        return Err(SceneTextError::CutShort);
    }
    let layout: Layout = error::parse(text, file).map_err(SceneTextError::Malformed)?;
    let scene = read_objects(layout.objects).and_then(|objects| {
        let revision = REVISION.check_whole("revision", layout.revision)?;
        Scene::restore(revision, objects)
    });
    scene.map_err(ConfigError::field(file)).map_err(SceneTextError::Malformed)
}

/// Revisions that survive both TOML's integers and a range's floating-point ends.
const REVISION: units::Range = units::Range::new(1.0, 9_007_199_254_740_991.0, "(revision)");
const SLOT: units::Range = units::Range::new(0.0, 255.0, "(slot)");

fn read_objects(layouts: Vec<ObjectLayout>) -> Result<Vec<(u16, SceneObject)>, FieldError> {
    let read = |(i, layout)| {
        let outer = format!("object[{i}]");
        read_object(layout).map_err(|refusal| refusal.within(&outer))
    };
    layouts.into_iter().enumerate().map(read).collect()
}

fn read_object(layout: ObjectLayout) -> Result<(u16, SceneObject), FieldError> {
    let id = Id::parse("id", &layout.id)?;
    let slot = SLOT.check_whole("slot", layout.slot)? as u16;
    let revision = REVISION.check_whole("revision", layout.revision)?;
    let kinds = [
        layout.half_space.map(|shape| ObjectKind::HalfSpace {
            point_m: Vector3::from(shape.point_m),
            normal: Vector3::from(shape.normal),
        }),
        layout.sphere.map(|shape| ObjectKind::Sphere {
            centre_m: Vector3::from(shape.centre_m),
            radius_m: shape.radius_m,
        }),
        layout.constant.map(|field| ObjectKind::Constant { force_N: Vector3::from(field.force_n) }),
        layout
            .viscous
            .map(|field| ObjectKind::Viscous { damping_Ns_per_m: field.damping_ns_per_m }),
    ];
    let mut kinds = kinds.into_iter().flatten();
    let (Some(kind), None) = (kinds.next(), kinds.next()) else {
        let allowed = "must have exactly one of half_space, sphere, constant, viscous";
        return Err(FieldError::new("kind", layout.id, allowed));
    };
    let material = layout.material.map(|material| Material {
        stiffness_N_per_m: material.stiffness_n_per_m,
        damping_Ns_per_m: material.damping_ns_per_m,
        ..Material::default().with_friction(material.friction)
    });
    let object = SceneObject::new(id, kind, material, layout.hollow)?;
    Ok((slot, object.at_revision(revision)))
}

/// The text of a scene. Only a revision beyond TOML's integers has none.
pub(super) fn write_scene(
    scene: &Scene,
) -> Result<String, Box<dyn std::error::Error + Send + Sync>> {
    let objects = scene.placed().into_iter().map(|(slot, object)| write_object(slot, object));
    let objects = objects.collect::<Result<_, _>>()?;
    let layout = Layout { revision: scene.revision().try_into()?, objects };
    Ok(format!("{FIRST_LINE}{}{LAST_LINE}\n", toml::to_string(&layout)?))
}

fn write_object(
    slot: u16,
    object: &SceneObject,
) -> Result<ObjectLayout, std::num::TryFromIntError> {
    let mut layout = ObjectLayout {
        id: object.id().to_string(),
        slot: slot.into(),
        revision: object.revision().try_into()?,
        hollow: object.hollow(),
        half_space: None,
        sphere: None,
        constant: None,
        viscous: None,
        material: object.material().map(|material| MaterialLayout {
            stiffness_n_per_m: material.stiffness_N_per_m,
            damping_ns_per_m: material.damping_Ns_per_m,
            friction: material.static_friction,
        }),
    };
    match *object.kind() {
        ObjectKind::HalfSpace { point_m, normal } => {
            let (point_m, normal) = (point_m.into(), normal.into());
            layout.half_space = Some(HalfSpaceLayout { point_m, normal });
        }
        ObjectKind::Sphere { centre_m, radius_m } => {
            layout.sphere = Some(SphereLayout { centre_m: centre_m.into(), radius_m });
        }
        ObjectKind::Constant { force_N } => {
            layout.constant = Some(ConstantLayout { force_n: force_N.into() });
        }
        ObjectKind::Viscous { damping_Ns_per_m } => {
            layout.viscous = Some(ViscousLayout { damping_ns_per_m: damping_Ns_per_m });
        }
    }
    Ok(layout)
}
