//! SceneService: the resident scene, on disk and in force before it is answered.

use std::num::NonZeroU64;
use std::sync::Arc;

use tonic::{Request, Response, Status};

use super::desk::{Desk, Desks};
use super::{convert, field_status, names, scene_status};
use crate::config::{Id, Scene as KeptScene, SceneError};
use crate::proto::scene_service_server::SceneService;
use crate::proto::{
    CreateObjectRequest, DeleteObjectRequest, DeleteObjectResponse, GetObjectRequest,
    GetSceneRequest, ListObjectsRequest, ListObjectsResponse, Scene, SceneObject,
    UpdateObjectRequest,
};
use crate::units::FieldError;

/// The service.
pub struct Scenes {
    desks: Desks,
}

impl Scenes {
    /// Of these devices.
    pub fn new(desks: Desks) -> Self {
        Self { desks }
    }
}

impl Desk {
    /// Makes an edit in its turn; returns what it returned and the scene then.
    async fn edit<T: Send + 'static>(
        &self,
        edit: impl FnOnce(&mut KeptScene) -> Result<T, SceneError> + Send + 'static,
    ) -> Result<(T, Arc<KeptScene>), Status> {
        let host = Arc::clone(&self.host);
        self.edits.run(move || host.edit_scene(edit)).await
    }

    fn objects(&self) -> (u64, Vec<SceneObject>) {
        let scene = self.host.scene();
        let objects = scene.list().map(|object| convert::object_to_proto(&self.host, object));
        (scene.revision(), objects.collect())
    }

    fn read(&self, id: &str, scene: &KeptScene) -> Result<Response<SceneObject>, Status> {
        let object = scene.get(id).map_err(|error| scene_status(&error))?;
        Ok(Response::new(convert::object_to_proto(&self.host, object)))
    }
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
        let desk = names::find_scene(&self.desks, "name", &request.get_ref().name)?;
        let (revision, objects) = desk.objects();
        Ok(Response::new(Scene { name: names::scene(&desk.host), revision, objects }))
    }

    async fn list_objects(
        &self,
        request: Request<ListObjectsRequest>,
    ) -> Result<Response<ListObjectsResponse>, Status> {
        let desk = names::find_scene(&self.desks, "parent", &request.get_ref().parent)?;
        let (scene_revision, objects) = desk.objects();
        Ok(Response::new(ListObjectsResponse { objects, scene_revision }))
    }

    async fn get_object(
        &self,
        request: Request<GetObjectRequest>,
    ) -> Result<Response<SceneObject>, Status> {
        let (desk, id) = names::find_object(&self.desks, "name", &request.get_ref().name)?;
        desk.read(id, &desk.host.scene())
    }

    async fn create_object(
        &self,
        request: Request<CreateObjectRequest>,
    ) -> Result<Response<SceneObject>, Status> {
        let CreateObjectRequest { parent, object_id, object, scene_revision } =
            request.into_inner();
        let desk = names::find_scene(&self.desks, "parent", &parent)?;
        let object = object.ok_or_else(missing_object)?;
        let id = Id::parse("object_id", &object_id).map_err(|e| field_status(&e))?;
        let object = convert::object_from_proto(id, &object).map_err(|e| field_status(&e))?;
        let expected = NonZeroU64::new(scene_revision);
        let (_, scene) = desk.edit(move |scene| scene.create(object, expected)).await?;
        desk.read(&object_id, &scene)
    }

    async fn update_object(
        &self,
        request: Request<UpdateObjectRequest>,
    ) -> Result<Response<SceneObject>, Status> {
        let UpdateObjectRequest { object, scene_revision } = request.into_inner();
        let object = object.ok_or_else(missing_object)?;
        let (desk, id) = names::find_object(&self.desks, "object.name", &object.name)?;
        let parsed = Id::parse("object.name", id).map_err(|error| {
            // The whole name is what was written; the rule is that of its last part.
            let value = format!("{:?}", object.name);
            field_status(&FieldError { value, ..error })
        })?;
        let object = convert::object_from_proto(parsed, &object).map_err(|e| field_status(&e))?;
        let expected = NonZeroU64::new(scene_revision);
        let id = id.to_owned();
        let (_, scene) = desk.edit(move |scene| scene.update(object, expected)).await?;
        desk.read(&id, &scene)
    }

    async fn delete_object(
        &self,
        request: Request<DeleteObjectRequest>,
    ) -> Result<Response<DeleteObjectResponse>, Status> {
        let DeleteObjectRequest { name, scene_revision } = request.into_inner();
        let (desk, id) = names::find_object(&self.desks, "name", &name)?;
        let id = id.to_owned();
        let expected = NonZeroU64::new(scene_revision);
        let (scene_revision, _) = desk.edit(move |scene| scene.delete(&id, expected)).await?;
        Ok(Response::new(DeleteObjectResponse { scene_revision }))
    }
}
