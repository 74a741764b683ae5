//! SceneService: the resident scene, on disk and in force before it is answered.

use std::num::NonZeroU64;
use std::sync::Arc;

use tonic::{Request, Response, Status};

use super::{Lane, convert, field_status, names, scene_status};
use crate::config::{Id, Scene as KeptScene, SceneError};
use crate::host::DeviceHost;
use crate::proto::scene_service_server::SceneService;
use crate::proto::{
    CreateObjectRequest, DeleteObjectRequest, DeleteObjectResponse, GetObjectRequest,
    GetSceneRequest, ListObjectsRequest, ListObjectsResponse, Scene, SceneObject,
    UpdateObjectRequest,
};
use crate::units::FieldError;

/// The service.
pub struct Scenes {
    host: Arc<DeviceHost>,
    edits: Lane,
}

impl Scenes {
    pub fn new(host: Arc<DeviceHost>) -> Self {
        Self { host, edits: Lane::default() }
    }

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
        names::expect_scene(&self.host, "name", &request.get_ref().name)?;
        let (revision, objects) = self.objects();
        Ok(Response::new(Scene { name: names::scene(&self.host), revision, objects }))
    }

    async fn list_objects(
        &self,
        request: Request<ListObjectsRequest>,
    ) -> Result<Response<ListObjectsResponse>, Status> {
        names::expect_scene(&self.host, "parent", &request.get_ref().parent)?;
        let (scene_revision, objects) = self.objects();
        Ok(Response::new(ListObjectsResponse { objects, scene_revision }))
    }

    async fn get_object(
        &self,
        request: Request<GetObjectRequest>,
    ) -> Result<Response<SceneObject>, Status> {
        let id = names::object_id(&self.host, "name", &request.get_ref().name)?;
        self.read(id, &self.host.scene())
    }

    async fn create_object(
        &self,
        request: Request<CreateObjectRequest>,
    ) -> Result<Response<SceneObject>, Status> {
        let CreateObjectRequest { parent, object_id, object, scene_revision } =
            request.into_inner();
        names::expect_scene(&self.host, "parent", &parent)?;
        let object = object.ok_or_else(missing_object)?;
        let id = Id::parse("object_id", &object_id).map_err(|e| field_status(&e))?;
        let object = convert::object_from_proto(id, &object).map_err(|e| field_status(&e))?;
        let expected = NonZeroU64::new(scene_revision);
        let (_, scene) = self.edit(move |scene| scene.create(object, expected)).await?;
        self.read(&object_id, &scene)
    }

    async fn update_object(
        &self,
        request: Request<UpdateObjectRequest>,
    ) -> Result<Response<SceneObject>, Status> {
        let UpdateObjectRequest { object, scene_revision } = request.into_inner();
        let object = object.ok_or_else(missing_object)?;
        let id = names::object_id(&self.host, "object.name", &object.name)?.to_owned();
        let parsed = Id::parse("object.name", &id).map_err(|error| {
            // The whole name is what was written; the rule is that of its last part.
            let value = format!("{:?}", object.name);
            field_status(&FieldError { value, ..error })
        })?;
        let object = convert::object_from_proto(parsed, &object).map_err(|e| field_status(&e))?;
        let expected = NonZeroU64::new(scene_revision);
        let (_, scene) = self.edit(move |scene| scene.update(object, expected)).await?;
        self.read(&id, &scene)
    }

    async fn delete_object(
        &self,
        request: Request<DeleteObjectRequest>,
    ) -> Result<Response<DeleteObjectResponse>, Status> {
        let DeleteObjectRequest { name, scene_revision } = request.into_inner();
        let id = names::object_id(&self.host, "name", &name)?.to_owned();
        let expected = NonZeroU64::new(scene_revision);
        let (scene_revision, _) = self.edit(move |scene| scene.delete(&id, expected)).await?;
        Ok(Response::new(DeleteObjectResponse { scene_revision }))
    }
}
