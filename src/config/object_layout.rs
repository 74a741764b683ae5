//! One object of a scene as TOML and JSON write it: a table for each kind, with the keys of
//! `scene.proto`.
//!
//! Vectors are arrays of three numbers, an orientation is x y z w. A key that may be absent in
//! the contract may be absent here. `friction`, which older scenes have, means both
//! coefficients. Values are checked by [`SceneObject::new`]; unknown keys are errors.

use nalgebra::{Quaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::object_check::{matrix, numbers};
use super::object_message::KINDS;
use super::{GuidePath, Id, ObjectKind, SceneObject};
use crate::environment::Material;
use crate::units::FieldError;

/// An `[[object]]`: exactly one of its kinds is there.
#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectLayout {
    /// Its identifier.
    pub id: String,
    /// Where the loop keeps its state; only in the server's own file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) slot: Option<i64>,
    /// As [`SceneObject::revision`]; only in the server's own file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) revision: Option<i64>,
    #[serde(default)]
    hollow: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    half_space: Option<HalfSpaceLayout>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sphere: Option<SphereLayout>,
    #[serde(skip_serializing_if = "Option::is_none")]
    r#box: Option<BoxLayout>,
    #[serde(skip_serializing_if = "Option::is_none")]
    capsule: Option<CapsuleLayout>,
    #[serde(skip_serializing_if = "Option::is_none")]
    corridor: Option<CorridorLayout>,
    #[serde(skip_serializing_if = "Option::is_none")]
    guide: Option<GuideLayout>,
    #[serde(skip_serializing_if = "Option::is_none")]
    constant: Option<ConstantLayout>,
    #[serde(skip_serializing_if = "Option::is_none")]
    viscous: Option<ViscousLayout>,
    #[serde(skip_serializing_if = "Option::is_none")]
    force_field: Option<ForceFieldLayout>,
    #[serde(skip_serializing_if = "Option::is_none")]
    material: Option<MaterialLayout>,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct HalfSpaceLayout {
    point_m: [f64; 3],
    normal: [f64; 3],
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct SphereLayout {
    centre_m: [f64; 3],
    radius_m: f64,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct BoxLayout {
    centre_m: [f64; 3],
    half_extents_m: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    orientation: Option<[f64; 4]>,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct CapsuleLayout {
    ends_m: [[f64; 3]; 2],
    radius_m: f64,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct CorridorLayout {
    points_m: Vec<[f64; 3]>,
    #[serde(default)]
    radius_m: f64,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct GuideLayout {
    #[serde(default)]
    radius_m: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    point: Option<GuidePointLayout>,
    #[serde(skip_serializing_if = "Option::is_none")]
    line: Option<GuideLineLayout>,
    #[serde(skip_serializing_if = "Option::is_none")]
    plane: Option<HalfSpaceLayout>,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct GuidePointLayout {
    point_m: [f64; 3],
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct GuideLineLayout {
    point_m: [f64; 3],
    direction: [f64; 3],
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct ConstantLayout {
    force_n: [f64; 3],
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct ViscousLayout {
    damping_ns_per_m: f64,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct ForceFieldLayout {
    origin_m: [f64; 3],
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    stiffness_n_per_m: Vec<f64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    damping_ns_per_m: Vec<f64>,
    #[serde(default)]
    radius_m: f64,
    #[serde(default)]
    wrench: WrenchLayout,
}

#[derive(Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
struct WrenchLayout {
    force_n: [f64; 3],
    moment_nm: [f64; 3],
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct MaterialLayout {
    stiffness_n_per_m: f64,
    #[serde(default)]
    damping_ns_per_m: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    friction: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    kinetic_friction: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    static_friction: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    surface_velocity_m_per_s: Option<[f64; 3]>,
}

impl ObjectLayout {
    /// The object that is written here, checked; its slot and revision are not looked at.
    pub(super) fn check(self) -> Result<SceneObject, FieldError> {
        let id = Id::parse("id", &self.id)?;
        let kinds = [
            self.half_space.map(|wall| {
                let HalfSpaceLayout { point_m, normal } = wall;
                Ok(ObjectKind::HalfSpace { point_m: point_m.into(), normal: normal.into() })
            }),
            self.sphere.map(|SphereLayout { centre_m, radius_m }| {
                Ok(ObjectKind::Sphere { centre_m: centre_m.into(), radius_m })
            }),
            self.r#box.map(|block| Ok(block.kind())),
            self.capsule.map(|CapsuleLayout { ends_m, radius_m }| {
                Ok(ObjectKind::Capsule { ends_m: ends_m.map(Vector3::from), radius_m })
            }),
            self.corridor.map(|CorridorLayout { points_m, radius_m }| {
                let points_m = points_m.into_iter().map(Vector3::from).collect();
                Ok(ObjectKind::Corridor { points_m, radius_m })
            }),
            self.guide.map(GuideLayout::kind),
            self.constant.map(|field| Ok(ObjectKind::Constant { force_N: field.force_n.into() })),
            self.viscous.map(|ViscousLayout { damping_ns_per_m }| {
                Ok(ObjectKind::Viscous { damping_Ns_per_m: damping_ns_per_m })
            }),
            self.force_field.map(ForceFieldLayout::kind),
        ];
        let mut kinds = kinds.into_iter().flatten();
        let (Some(kind), None) = (kinds.next(), kinds.next()) else {
            let allowed = format!("must have exactly one of {KINDS}");
            return Err(FieldError::new("kind", self.id, allowed));
        };
        let material = self.material.map(MaterialLayout::material).transpose()?;
        SceneObject::new(id, kind?, material, self.hollow)
    }

    fn empty(object: &SceneObject) -> Self {
        Self {
            id: object.id().to_string(),
            slot: None,
            revision: None,
            hollow: object.hollow(),
            half_space: None,
            sphere: None,
            r#box: None,
            capsule: None,
            corridor: None,
            guide: None,
            constant: None,
            viscous: None,
            force_field: None,
            material: object.material().map(MaterialLayout::from),
        }
    }
}

/// Without slot and revision, as people write it.
impl From<&SceneObject> for ObjectLayout {
    fn from(object: &SceneObject) -> Self {
        let mut layout = Self::empty(object);
        match object.kind() {
            ObjectKind::HalfSpace { point_m, normal } => {
                layout.half_space = Some(HalfSpaceLayout::new(point_m, normal));
            }
            ObjectKind::Sphere { centre_m, radius_m } => {
                let (centre_m, radius_m) = ((*centre_m).into(), *radius_m);
                layout.sphere = Some(SphereLayout { centre_m, radius_m });
            }
            ObjectKind::Box { centre_m, half_extents_m, orientation } => {
                let turned = *orientation != Quaternion::identity();
                layout.r#box = Some(BoxLayout {
                    centre_m: (*centre_m).into(),
                    half_extents_m: (*half_extents_m).into(),
                    orientation: turned.then(|| orientation.coords.into()),
                });
            }
            ObjectKind::Capsule { ends_m, radius_m } => {
                let (ends_m, radius_m) = (ends_m.map(Into::into), *radius_m);
                layout.capsule = Some(CapsuleLayout { ends_m, radius_m });
            }
            ObjectKind::Corridor { points_m, radius_m } => {
                let points_m = points_m.iter().map(|point_m| (*point_m).into()).collect();
                layout.corridor = Some(CorridorLayout { points_m, radius_m: *radius_m });
            }
            ObjectKind::Guide { path, radius_m } => {
                layout.guide = Some(GuideLayout::new(path, *radius_m));
            }
            ObjectKind::Constant { force_N } => {
                layout.constant = Some(ConstantLayout { force_n: (*force_N).into() });
            }
            ObjectKind::Viscous { damping_Ns_per_m } => {
                layout.viscous = Some(ViscousLayout { damping_ns_per_m: *damping_Ns_per_m });
            }
            ObjectKind::ForceField {
                origin_m,
                force_N,
                moment_Nm,
                stiffness_N_per_m,
                damping_Ns_per_m,
                radius_m,
            } => {
                let (force_n, moment_nm) = ((*force_N).into(), (*moment_Nm).into());
                layout.force_field = Some(ForceFieldLayout {
                    origin_m: (*origin_m).into(),
                    stiffness_n_per_m: numbers(stiffness_N_per_m),
                    damping_ns_per_m: numbers(damping_Ns_per_m),
                    radius_m: *radius_m,
                    wrench: WrenchLayout { force_n, moment_nm },
                });
            }
        }
        layout
    }
}

impl HalfSpaceLayout {
    fn new(point_m: &Vector3<f64>, normal: &Vector3<f64>) -> Self {
        Self { point_m: (*point_m).into(), normal: (*normal).into() }
    }
}

impl BoxLayout {
    fn kind(self) -> ObjectKind {
        let orientation = self.orientation.map_or(Quaternion::identity(), Quaternion::from);
        ObjectKind::Box {
            centre_m: self.centre_m.into(),
            half_extents_m: self.half_extents_m.into(),
            orientation,
        }
    }
}

impl GuideLayout {
    fn new(path: &GuidePath, radius_m: f64) -> Self {
        let mut layout = Self { radius_m, point: None, line: None, plane: None };
        match path {
            GuidePath::Point { point_m } => {
                layout.point = Some(GuidePointLayout { point_m: (*point_m).into() });
            }
            GuidePath::Line { point_m, direction } => {
                let (point_m, direction) = ((*point_m).into(), (*direction).into());
                layout.line = Some(GuideLineLayout { point_m, direction });
            }
            GuidePath::Plane { point_m, normal } => {
                layout.plane = Some(HalfSpaceLayout::new(point_m, normal));
            }
        }
        layout
    }

    fn kind(self) -> Result<ObjectKind, FieldError> {
        let path = match (self.point, self.line, self.plane) {
            (Some(GuidePointLayout { point_m }), None, None) => {
                GuidePath::Point { point_m: point_m.into() }
            }
            (None, Some(GuideLineLayout { point_m, direction }), None) => {
                GuidePath::Line { point_m: point_m.into(), direction: direction.into() }
            }
            (None, None, Some(HalfSpaceLayout { point_m, normal })) => {
                GuidePath::Plane { point_m: point_m.into(), normal: normal.into() }
            }
            (point, line, plane) => {
                let given = [point.is_some(), line.is_some(), plane.is_some()];
                let given = given.into_iter().filter(|given| *given).count();
                let allowed = "must be exactly one of point, line, plane";
                return Err(FieldError::new("guide.path", format!("{given} of them"), allowed));
            }
        };
        Ok(ObjectKind::Guide { path, radius_m: self.radius_m })
    }
}

impl ForceFieldLayout {
    fn kind(self) -> Result<ObjectKind, FieldError> {
        let stiffness = "force_field.stiffness_n_per_m";
        Ok(ObjectKind::ForceField {
            origin_m: self.origin_m.into(),
            force_N: self.wrench.force_n.into(),
            moment_Nm: self.wrench.moment_nm.into(),
            stiffness_N_per_m: matrix(stiffness, &self.stiffness_n_per_m)?,
            damping_Ns_per_m: matrix("force_field.damping_ns_per_m", &self.damping_ns_per_m)?,
            radius_m: self.radius_m,
        })
    }
}

impl MaterialLayout {
    fn material(self) -> Result<Material, FieldError> {
        if let Some(friction) = self.friction
            && self.kinetic_friction.or(self.static_friction).is_some()
        {
            let allowed = "means kinetic_friction and static_friction: write it, or these";
            return Err(FieldError::new("material.friction", friction, allowed));
        }
        let kinetic_friction = self.kinetic_friction.or(self.friction).unwrap_or(0.0);
        let material = Material {
            stiffness_N_per_m: self.stiffness_n_per_m,
            damping_Ns_per_m: self.damping_ns_per_m,
            kinetic_friction,
            static_friction: self.static_friction.unwrap_or(kinetic_friction),
            surface_velocity_W_m_per_s: self.surface_velocity_m_per_s.unwrap_or_default().into(),
        };
        Ok(material)
    }
}

impl From<&Material> for MaterialLayout {
    fn from(material: &Material) -> Self {
        let Material { static_friction, kinetic_friction, .. } = *material;
        let velocity = material.surface_velocity_W_m_per_s;
        Self {
            stiffness_n_per_m: material.stiffness_N_per_m,
            damping_ns_per_m: material.damping_Ns_per_m,
            friction: None,
            kinetic_friction: Some(kinetic_friction),
            static_friction: (static_friction != kinetic_friction).then_some(static_friction),
            surface_velocity_m_per_s: (velocity != Vector3::zeros()).then(|| velocity.into()),
        }
    }
}
