//! SceneService: the resident scene, on disk and in force before it is answered.
//!
//! Edits come in one at a time; whoever watches sees them in that order, the newest at last,
//! and never more than one scene waits for a slow reader.

use std::num::NonZeroU64;
use std::sync::Arc;

use tokio::sync::watch;
use tonic::{Request, Response, Status};

use super::desk::{Desk, Desks};
use super::guard::Asker;
use super::places::Places;
use super::watches::{self, Watch, answers};
use super::{field_status, names, scene_status};
use crate::audit::What;
use crate::config::{self, Id, SceneError, object_from_proto, object_to_proto};
use crate::environment::MAX_OBJECTS;
use crate::host::DeviceHost;
use crate::proto::scene_service_server::SceneService;
use crate::proto::{
    CreateObjectRequest, DeleteObjectRequest, DeleteObjectResponse, GetObjectRequest,
    GetSceneRequest, ListObjectsRequest, ListObjectsResponse, ReplaceSceneRequest, Scene,
    SceneObject, UpdateObjectRequest, WatchSceneRequest,
};
use crate::units::FieldError;

/// The service.
pub struct Scenes {
    desks: Desks,
    watches: Places,
    stopped: watch::Receiver<bool>,
}

impl Scenes {
    /// Of these devices; watches end when `stopped` is true or its sender gone.
    pub fn new(desks: Desks, stopped: watch::Receiver<bool>) -> Self {
        Self { desks, watches: Places::new("watches of scenes", watches::MOST), stopped }
    }

    fn find(&self, asker: &Asker, field: &str, name: &str) -> Result<&Desk, Status> {
        names::find_scene(&self.desks, asker, field, name)
    }
}

impl Desk {
    /// Makes an edit in its turn; returns what it returned and the scene then.
    async fn edit<T: Send + 'static>(
        &self,
        asker: Asker,
        what: String,
        edit: impl FnOnce(&mut config::Scene) -> Result<T, SceneError> + Send + 'static,
    ) -> Result<(T, Arc<config::Scene>), Status> {
        let (host, newest) = (Arc::clone(&self.host), Arc::clone(&self.newest_scene));
        let work = move || {
            let (result, scene) = host.edit_scene(edit)?;
            // Here, where edits have their turn: told even if nobody waits for the answer.
            newest.send_replace(Arc::clone(&scene));
            let detail = format!("{what}, revision {}", scene.revision());
            asker.did(What::SceneChanged, &names::device(&host), &detail);
            Ok((result, scene))
        };
        self.edits.run(work).await
    }

    fn read(&self, id: &str, scene: &config::Scene) -> Result<Response<SceneObject>, Status> {
        let object = scene.get(id).map_err(|error| scene_status(&error))?;
        let name = names::object(&self.host, id);
        Ok(Response::new(object_to_proto(object, name)))
    }
}

/// An object with its whole name, as `field`, checked, and the device that it is to belong to.
fn named<'a>(
    desks: &'a Desks,
    asker: &Asker,
    field: &str,
    object: &SceneObject,
) -> Result<(&'a Desk, config::SceneObject), Status> {
    let name = format!("{field}.name");
    let (desk, id) = names::find_object(desks, asker, &name, &object.name)?;
    let id = Id::parse(&name, id).map_err(|error| {
        // The whole name is what was written; the rule is that of its last part.
        let value = format!("{:?}", object.name);
        field_status(&FieldError { value, ..error })
    })?;
    let object = object_from_proto(id, object);
    Ok((desk, object.map_err(|error| field_status(&error.within(field)))?))
}

fn scene_to_proto(host: &DeviceHost, scene: &config::Scene) -> Scene {
    let object = |object: &config::SceneObject| {
        object_to_proto(object, names::object(host, object.id().as_str()))
    };
    let objects = scene.list().map(object).collect();
    Scene { name: names::scene(host), revision: scene.revision(), objects }
}

fn missing_object() -> Status {
    field_status(&FieldError::new("object", "(none)", "is required"))
}

#[tonic::async_trait]
impl SceneService for Scenes {
    async fn get_scene(
        &self,
        request: Request<GetSceneRequest>,
    ) -> Result<Response<Scene>, Status> {
        let Desk { host, .. } =
            self.find(&Asker::of(request.extensions())?, "name", &request.get_ref().name)?;
        Ok(Response::new(scene_to_proto(host, &host.scene())))
    }

    async fn replace_scene(
        &self,
        request: Request<ReplaceSceneRequest>,
    ) -> Result<Response<Scene>, Status> {
        let asker = Asker::of(request.extensions())?;
        let ReplaceSceneRequest { name, objects, scene_revision } = request.into_inner();
        let desk = self.find(&asker, "name", &name)?;
        if objects.len() > MAX_OBJECTS {
            return Err(scene_status(&SceneError::Full { max: MAX_OBJECTS }));
        }
        let named = |(i, object): (usize, &SceneObject)| {
            let field = format!("objects[{i}]");
            let (of, checked) = named(&self.desks, &asker, &field, object)?;
            if of.host.definition().name == desk.host.definition().name {
                return Ok(checked);
            }
            let allowed = format!("must be an object of {name}");
            let field = format!("{field}.name");
            Err(field_status(&FieldError::new(field, format!("{:?}", object.name), allowed)))
        };
        let objects = objects.iter().enumerate().map(named).collect::<Result<Vec<_>, _>>()?;
        let expected = NonZeroU64::new(scene_revision);
        let replace = move |scene: &mut config::Scene| scene.replace(objects, expected);
        let (_, scene) = desk.edit(asker, "the scene replaced".into(), replace).await?;
        Ok(Response::new(scene_to_proto(&desk.host, &scene)))
    }

    type WatchSceneStream = watches::Answers<Scene>;

    async fn watch_scene(
        &self,
        request: Request<WatchSceneRequest>,
    ) -> Result<Response<Self::WatchSceneStream>, Status> {
        let asker = Asker::of(request.extensions())?;
        let desk = self.find(&asker, "name", &request.get_ref().name)?;
        let place = self.watches.take(&asker)?;
        let (host, mut newest) = (Arc::clone(&desk.host), desk.newest_scene.subscribe());
        let (stopped, device) = (self.stopped.clone(), names::device(&host));
        let tell = move |teller: watches::Teller<_>| async move {
            loop {
                // A slow reader is waited for here, and then told the newest.
                let Ok(room) = teller.reserve().await else { return Ok(()) };
                let scene = Arc::clone(&newest.borrow_and_update());
                room.send(Ok(scene_to_proto(&host, &scene)));
                if newest.changed().await.is_err() {
                    return Ok(());
                }
            }
        };
        let watch = Watch { _place: place, stopped, asker, device, unfinished: None };
        Ok(Response::new(answers(1, watch, tell)))
    }

    async fn list_objects(
        &self,
        request: Request<ListObjectsRequest>,
    ) -> Result<Response<ListObjectsResponse>, Status> {
        let Desk { host, .. } =
            self.find(&Asker::of(request.extensions())?, "parent", &request.get_ref().parent)?;
        let Scene { revision, objects, .. } = scene_to_proto(host, &host.scene());
        Ok(Response::new(ListObjectsResponse { objects, scene_revision: revision }))
    }

    async fn get_object(
        &self,
        request: Request<GetObjectRequest>,
    ) -> Result<Response<SceneObject>, Status> {
        let asker = Asker::of(request.extensions())?;
        let name = &request.get_ref().name;
        let (desk, id) = names::find_object(&self.desks, &asker, "name", name)?;
        desk.read(id, &desk.host.scene())
    }

    async fn create_object(
        &self,
        request: Request<CreateObjectRequest>,
    ) -> Result<Response<SceneObject>, Status> {
        let asker = Asker::of(request.extensions())?;
        let CreateObjectRequest { parent, object_id, object, scene_revision } =
            request.into_inner();
        let desk = self.find(&asker, "parent", &parent)?;
        let object = object.ok_or_else(missing_object)?;
        let id = Id::parse("object_id", &object_id).map_err(|e| field_status(&e))?;
        let object = object_from_proto(id, &object);
        let object = object.map_err(|error| field_status(&error.within("object")))?;
        let expected = NonZeroU64::new(scene_revision);
        let create = move |scene: &mut config::Scene| scene.create(object, expected);
        let (_, scene) = desk.edit(asker, format!("{object_id} created"), create).await?;
        desk.read(&object_id, &scene)
    }

    async fn update_object(
        &self,
        request: Request<UpdateObjectRequest>,
    ) -> Result<Response<SceneObject>, Status> {
        let asker = Asker::of(request.extensions())?;
        let UpdateObjectRequest { object, scene_revision } = request.into_inner();
        let object = object.ok_or_else(missing_object)?;
        let (desk, object) = named(&self.desks, &asker, "object", &object)?;
        let (id, expected) = (object.id().to_string(), NonZeroU64::new(scene_revision));
        let update = move |scene: &mut config::Scene| scene.update(object, expected);
        let (_, scene) = desk.edit(asker, format!("{id} changed"), update).await?;
        desk.read(&id, &scene)
    }

    async fn delete_object(
        &self,
        request: Request<DeleteObjectRequest>,
    ) -> Result<Response<DeleteObjectResponse>, Status> {
        let asker = Asker::of(request.extensions())?;
        let DeleteObjectRequest { name, scene_revision } = request.into_inner();
        let (desk, id) = names::find_object(&self.desks, &asker, "name", &name)?;
        let (id, what) = (id.to_owned(), format!("{id} deleted"));
        let expected = NonZeroU64::new(scene_revision);
        let delete = move |scene: &mut config::Scene| scene.delete(&id, expected);
        let (scene_revision, _) = desk.edit(asker, what, delete).await?;
        Ok(Response::new(DeleteObjectResponse { scene_revision }))
    }
}
