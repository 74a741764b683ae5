//! `hapticd ctl object`: whatever the resident scene can hold.

use crate::client::Authorized;
use anyhow::bail;
use clap::{Args, Subcommand};
use serde_json::json;

use super::ctl::plain;
use super::object_fields::{Fields, KindName};
use super::object_print::{object_json, print};
use crate::proto::scene_object::Kind;
use crate::proto::scene_service_client::SceneServiceClient;
use crate::proto::{
    CreateObjectRequest, DeleteObjectRequest, GetObjectRequest, ListObjectsRequest, SceneObject,
    UpdateObjectRequest,
};

/// Objects of the resident scene: shapes, paths and fields; they are kept on disk
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd ctl object add ball sphere --centre 0,0.3,0 --radius 0.02 --friction 0.3
  hapticd ctl object add plate box --centre 0.35,0,0 --half-extents 0.001,0.2,0.2 --stiffness 2e4
  hapticd ctl object set ball --radius 0.03
  hapticd ctl object list
  hapticd ctl object rm ball")]
pub struct ObjectCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Add an object; what its kind needs must be given
    #[command(after_help = "Needed, and what may be added:
  half-space   --point --normal                 [--hollow]
  sphere       --centre --radius                [--hollow]
  box          --centre --half-extents          [--orientation --hollow]
  capsule      --ends --radius                  [--hollow]
  corridor     --points                         [--radius]
  guide-point  --point                          [--radius]
  guide-line   --point --direction              [--radius]
  guide-plane  --point --normal                 [--radius]
  constant     --force
  viscous      --damping
  force-field  --origin                         [--force --moment --stiffness --damping --radius]
All but fields: [--stiffness --damping --friction --static-friction --surface-velocity].

Examples:
  hapticd ctl object add ball sphere --centre 0,0.3,0 --radius 0.02 --stiffness 2000 --friction 0.3 --static-friction 0.5
  hapticd ctl object add bone capsule --ends=-0.1,0.3,0:0.1,0.3,0 --radius 0.02 --stiffness 1e5
  hapticd ctl object add way corridor --points 0.2,0,0:0.3,0,0:0.3,0.1,0 --radius 0.005
  hapticd ctl object add rail guide-line --point 0,0.3,0 --direction 1,0,0 --stiffness 3000
  hapticd ctl object add magnet force-field --origin 0.3,0,0 --stiffness 200 --damping 2 --radius 0.05")]
    Add {
        /// a-z, 0-9 and \"-\", beginning with a letter
        name: String,
        /// What it is
        kind: KindName,
        #[command(flatten)]
        fields: Fields,
    },
    /// Change what is given, keep the rest
    #[command(after_help = "Examples:
  hapticd ctl object set ball --stiffness 20000
  hapticd ctl object set ball --centre 0,0.35,0 --radius 0.03")]
    Set {
        /// Which object
        name: String,
        #[command(flatten)]
        fields: Fields,
    },
    /// Show one object
    #[command(after_help = "Example:
  hapticd ctl object get ball --json")]
    Get {
        /// Which object
        name: String,
    },
    /// Show all objects of the scene
    #[command(after_help = "Example:
  hapticd ctl object list")]
    List,
    /// Remove an object
    #[command(after_help = "Example:
  hapticd ctl object rm ball")]
    Rm {
        /// Which object
        name: String,
    },
}

impl ObjectCommand {
    /// Does it and prints the object as the server has it then.
    pub async fn run(
        self,
        scenes: &mut SceneServiceClient<Authorized>,
        device: &str,
        as_json: bool,
    ) -> anyhow::Result<()> {
        let mut objects = Objects::new(scenes, device, as_json);
        match self.action {
            Action::Add { name, kind, fields } => objects.add(name, kind, fields).await,
            Action::Set { name, fields } => objects.set(&name, fields).await,
            Action::Get { name } => objects.get(&name).await,
            Action::List => objects.list().await,
            Action::Rm { name } => objects.remove(&name).await,
        }
    }
}

/// The objects of one scene, for commands.
pub struct Objects<'a> {
    scenes: &'a mut SceneServiceClient<Authorized>,
    /// Its resource name.
    scene: String,
    as_json: bool,
    /// Only half-spaces are changed or removed.
    pub only_walls: bool,
}

impl<'a> Objects<'a> {
    /// Those of a device.
    pub fn new(
        scenes: &'a mut SceneServiceClient<Authorized>,
        device: &str,
        as_json: bool,
    ) -> Self {
        Self { scenes, scene: format!("{device}/scene"), as_json, only_walls: false }
    }

    /// Adds one and prints it.
    pub async fn add(
        &mut self,
        name: String,
        kind: KindName,
        fields: Fields,
    ) -> anyhow::Result<()> {
        let request = CreateObjectRequest {
            parent: self.scene.clone(),
            object_id: name,
            object: Some(fields.new_object(kind)?),
            scene_revision: 0,
        };
        let added = self.scenes.create_object(request).await.map_err(plain)?;
        print(&added.into_inner(), self.as_json)
    }

    /// Changes one and prints it.
    pub async fn set(&mut self, name: &str, fields: Fields) -> anyhow::Result<()> {
        let (mut object, scene_revision) = self.find(name, "changed").await?;
        fields.apply(&mut object)?;
        // What was read is what is changed: somebody else's edit in between is not lost.
        let request = UpdateObjectRequest { object: Some(object), scene_revision };
        let updated = self.scenes.update_object(request).await.map_err(plain)?;
        print(&updated.into_inner(), self.as_json)
    }

    /// Prints one.
    pub async fn get(&mut self, name: &str) -> anyhow::Result<()> {
        let request = GetObjectRequest { name: self.full(name) };
        let object = self.scenes.get_object(request).await.map_err(plain)?;
        print(&object.into_inner(), self.as_json)
    }

    /// Prints all of them.
    pub async fn list(&mut self) -> anyhow::Result<()> {
        let (objects, revision) = self.all().await?;
        if self.as_json {
            let objects: Vec<_> = objects.iter().map(object_json).collect::<Result<_, _>>()?;
            say!("{}", json!({ "scene_revision": revision, "objects": objects }));
            return Ok(());
        }
        objects.iter().try_for_each(|object| print(object, false))?;
        say!("{}, revision {revision}", counted(objects.len()));
        Ok(())
    }

    /// Removes one.
    pub async fn remove(&mut self, name: &str) -> anyhow::Result<()> {
        let (object, scene_revision) = self.find(name, "removed").await?;
        // What was looked at is what is removed.
        let request = DeleteObjectRequest { name: object.name, scene_revision };
        let gone = self.scenes.delete_object(request).await.map_err(plain)?.into_inner();
        if self.as_json {
            say!("{}", json!({ "scene_revision": gone.scene_revision }));
        } else {
            say!("{name} removed, revision {}", gone.scene_revision);
        }
        Ok(())
    }

    fn full(&self, name: &str) -> String {
        format!("{}/objects/{name}", self.scene)
    }

    /// The object of this name, and the revision of the scene that it was found in.
    async fn find(&mut self, name: &str, done: &str) -> anyhow::Result<(SceneObject, u64)> {
        let full = self.full(name);
        let (objects, revision) = self.all().await?;
        let found = objects.into_iter().find(|object| object.name == full);
        let Some(object) = found else { bail!("there is no object {name:?}") };
        if self.only_walls && !matches!(object.kind, Some(Kind::HalfSpace(_))) {
            bail!("{full} is not a wall; nothing was {done}");
        }
        Ok((object, revision))
    }

    async fn all(&mut self) -> anyhow::Result<(Vec<SceneObject>, u64)> {
        let request = ListObjectsRequest { parent: self.scene.clone() };
        let listed = self.scenes.list_objects(request).await.map_err(plain)?.into_inner();
        Ok((listed.objects, listed.scene_revision))
    }
}

/// So many objects, in words.
pub fn counted(objects: usize) -> String {
    format!("{objects} object{}", if objects == 1 { "" } else { "s" })
}
