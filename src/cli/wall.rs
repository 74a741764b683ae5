//! `hapticd ctl wall`: half-spaces of the resident scene.

use anyhow::bail;
use clap::{Args, Subcommand};
use serde_json::{Value, json};
use tonic::transport::Channel;

use super::ctl::plain;
use super::format::{parse_vector, vector};
use crate::proto::scene_object::Kind;
use crate::proto::scene_service_client::SceneServiceClient;
use crate::proto::{
    CreateObjectRequest, DeleteObjectRequest, GetObjectRequest, HalfSpace, ListObjectsRequest,
    Material, SceneObject, UpdateObjectRequest, Vector3,
};

/// Stiffness of a wall that does not say: hard for brakes, harmless for motors.
const DEFAULT_STIFFNESS_N_PER_M: f64 = 1000.0;

/// Walls of the resident scene; they are kept on disk
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd ctl wall add table --point 0,0.4,0 --normal=0,-1,0 --stiffness 5000
  hapticd ctl wall set table --point 0,0.35,0
  hapticd ctl wall list
  hapticd ctl wall rm table")]
pub struct WallCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Add a wall; it needs --point and --normal
    #[command(after_help = "Example:
  hapticd ctl wall add table --point 0,0.4,0 --normal=0,-1,0 --stiffness 5000")]
    Add {
        /// a-z, 0-9 and "-", beginning with a letter
        name: String,
        #[command(flatten)]
        fields: Fields,
    },
    /// Change what is given, keep the rest
    #[command(after_help = "Examples:
  hapticd ctl wall set table --stiffness 20000
  hapticd ctl wall set table --point 0,0.35,0")]
    Set {
        /// Which wall
        name: String,
        #[command(flatten)]
        fields: Fields,
    },
    /// Show one wall
    #[command(after_help = "Example:
  hapticd ctl wall get table")]
    Get {
        /// Which wall
        name: String,
    },
    /// Show all objects of the scene
    #[command(after_help = "Example:
  hapticd ctl wall list")]
    List,
    /// Remove a wall
    #[command(after_help = "Example:
  hapticd ctl wall rm table")]
    Rm {
        /// Which wall
        name: String,
    },
}

#[derive(Debug, Args)]
struct Fields {
    /// Any point of its surface, metres in W; a new wall needs it
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    point: Option<Vector3>,
    /// Direction out of the wall; a new wall needs it
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    normal: Option<Vector3>,
    /// N/m (1000 if a new wall does not say)
    #[arg(long, value_name = "N/m", allow_negative_numbers = true)]
    stiffness: Option<f64>,
    /// N s/m
    #[arg(long, value_name = "N s/m", allow_negative_numbers = true)]
    damping: Option<f64>,
    /// Coulomb coefficient
    #[arg(long, value_name = "MU", allow_negative_numbers = true)]
    friction: Option<f64>,
    /// A sheet, felt from both sides
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    hollow: Option<bool>,
}

impl Fields {
    fn apply(&self, object: &mut SceneObject) -> anyhow::Result<()> {
        let Some(Kind::HalfSpace(half_space)) = &mut object.kind else {
            bail!("{} is not a wall", object.name);
        };
        half_space.point_m = self.point.or(half_space.point_m);
        half_space.normal = self.normal.or(half_space.normal);
        let material = object.material.get_or_insert_with(Material::default);
        material.stiffness_n_per_m = self.stiffness.unwrap_or(material.stiffness_n_per_m);
        material.damping_ns_per_m = self.damping.unwrap_or(material.damping_ns_per_m);
        material.friction = self.friction.unwrap_or(material.friction);
        object.hollow = self.hollow.unwrap_or(object.hollow);
        Ok(())
    }
}

impl WallCommand {
    /// Does it and prints the wall as the server has it then.
    pub async fn run(
        self,
        scenes: &mut SceneServiceClient<Channel>,
        device: &str,
        as_json: bool,
    ) -> anyhow::Result<()> {
        let scene = format!("{device}/scene");
        let full = |name: &str| format!("{scene}/objects/{name}");
        match self.action {
            Action::Add { name, fields } => {
                let stiffness_n_per_m = DEFAULT_STIFFNESS_N_PER_M;
                let mut object = SceneObject {
                    kind: Some(Kind::HalfSpace(HalfSpace::default())),
                    material: Some(Material { stiffness_n_per_m, ..Material::default() }),
                    ..SceneObject::default()
                };
                fields.apply(&mut object)?;
                let request = CreateObjectRequest {
                    parent: scene,
                    object_id: name,
                    object: Some(object),
                    scene_revision: 0,
                };
                let added = scenes.create_object(request).await.map_err(plain)?;
                print(&added.into_inner(), as_json);
            }
            Action::Set { name, fields } => {
                let (mut object, scene_revision) = find(scenes, scene, &name).await?;
                fields.apply(&mut object)?;
                // What was read is what is changed: somebody else's edit in between is not lost.
                let request = UpdateObjectRequest { object: Some(object), scene_revision };
                let updated = scenes.update_object(request).await.map_err(plain)?;
                print(&updated.into_inner(), as_json);
            }
            Action::Get { name } => {
                let request = GetObjectRequest { name: full(&name) };
                print(&scenes.get_object(request).await.map_err(plain)?.into_inner(), as_json);
            }
            Action::List => {
                let (objects, revision) = list(scenes, scene).await?;
                if as_json {
                    let objects: Vec<_> = objects.iter().map(object_json).collect();
                    say!("{}", json!({ "scene_revision": revision, "objects": objects }));
                } else {
                    objects.iter().for_each(|object| print(object, false));
                    let plural = if objects.len() == 1 { "" } else { "s" };
                    say!("{} object{plural}, revision {revision}", objects.len());
                }
            }
            Action::Rm { name } => {
                let (object, scene_revision) = find(scenes, scene, &name).await?;
                if !matches!(object.kind, Some(Kind::HalfSpace(_))) {
                    bail!("{} is not a wall; nothing was removed", object.name);
                }
                // What was looked at is what is removed.
                let request = DeleteObjectRequest { name: object.name, scene_revision };
                let revision =
                    scenes.delete_object(request).await.map_err(plain)?.into_inner().scene_revision;
                if as_json {
                    say!("{}", json!({ "scene_revision": revision }));
                } else {
                    say!("{name} removed, revision {revision}");
                }
            }
        }
        Ok(())
    }
}

/// The object of this name, and the revision of the scene that it was found in.
async fn find(
    scenes: &mut SceneServiceClient<Channel>,
    scene: String,
    name: &str,
) -> anyhow::Result<(SceneObject, u64)> {
    let full = format!("{scene}/objects/{name}");
    let (objects, revision) = list(scenes, scene).await?;
    let found = objects.into_iter().find(|object| object.name == full);
    let Some(object) = found else { bail!("there is no object {name:?}") };
    Ok((object, revision))
}

async fn list(
    scenes: &mut SceneServiceClient<Channel>,
    parent: String,
) -> anyhow::Result<(Vec<SceneObject>, u64)> {
    let listed = scenes.list_objects(ListObjectsRequest { parent }).await.map_err(plain)?;
    let listed = listed.into_inner();
    Ok((listed.objects, listed.scene_revision))
}

fn print(object: &SceneObject, as_json: bool) {
    if as_json {
        say!("{}", object_json(object));
        return;
    }
    let material = object.material.unwrap_or_default();
    let id = object.name.rsplit('/').next().unwrap_or_default();
    let shape = match &object.kind {
        Some(Kind::HalfSpace(wall)) => {
            format!(
                "wall at {} m, out along {}",
                vector(wall.point_m.as_ref(), 4),
                vector(wall.normal.as_ref(), 3)
            )
        }
        Some(Kind::Sphere(sphere)) => {
            format!(
                "sphere at {} m, radius {} m",
                vector(sphere.centre_m.as_ref(), 4),
                sphere.radius_m
            )
        }
        Some(Kind::Constant(field)) => {
            format!("force {} N everywhere", vector(field.force_n.as_ref(), 2))
        }
        Some(Kind::Viscous(field)) => format!("viscous, {} N s/m", field.damping_ns_per_m),
        None => "nothing".into(),
    };
    let hollow = if object.hollow { ", hollow" } else { "" };
    say!("{id}: {shape}{hollow}");
    if object.material.is_some() {
        say!(
            "  {} N/m, {} N s/m, friction {}, revision {}",
            material.stiffness_n_per_m,
            material.damping_ns_per_m,
            material.friction,
            object.revision
        );
    }
}

fn object_json(object: &SceneObject) -> Value {
    let array = |v: &Option<Vector3>| v.map_or(Value::Null, |v| json!([v.x, v.y, v.z]));
    let mut all =
        json!({ "name": object.name, "hollow": object.hollow, "revision": object.revision });
    let (key, value) = match &object.kind {
        Some(Kind::HalfSpace(w)) => {
            ("half_space", json!({ "point_m": array(&w.point_m), "normal": array(&w.normal) }))
        }
        Some(Kind::Sphere(s)) => {
            ("sphere", json!({ "centre_m": array(&s.centre_m), "radius_m": s.radius_m }))
        }
        Some(Kind::Constant(f)) => ("constant", json!({ "force_n": array(&f.force_n) })),
        Some(Kind::Viscous(f)) => ("viscous", json!({ "damping_ns_per_m": f.damping_ns_per_m })),
        None => ("kind", Value::Null),
    };
    all[key] = value;
    if let Some(material) = object.material {
        all["material"] = json!({
            "stiffness_n_per_m": material.stiffness_n_per_m,
            "damping_ns_per_m": material.damping_ns_per_m,
            "friction": material.friction,
        });
    }
    all
}
