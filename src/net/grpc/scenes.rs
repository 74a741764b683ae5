//! SceneService: the resident scene, on disk and in force before it is answered.
//!
//! Edits come in one at a time; whoever watches sees them in that order, the newest at last,
//! and never more than one scene waits for a slow reader.

use std::num::NonZeroU64;
use std::sync::Arc;

use tokio::sync::{Semaphore, mpsc, watch};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status};

use super::{Lane, field_status, names, scene_status};
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

/// Watches at a time.
const MAX_WATCHES: usize = 64;

/// The service.
pub struct Scenes {
    host: Arc<DeviceHost>,
    edits: Lane,
    /// The newest scene in force, for those who watch.
    newest: Arc<watch::Sender<Arc<config::Scene>>>,
    watches: Arc<Semaphore>,
    stopped: watch::Receiver<bool>,
}

impl Scenes {
    /// Of one device; watches end when `stopped` is true or its sender gone.
    pub fn new(host: Arc<DeviceHost>, stopped: watch::Receiver<bool>) -> Self {
        let newest = Arc::new(watch::Sender::new(host.scene()));
        let watches = Arc::new(Semaphore::new(MAX_WATCHES));
        Self { host, edits: Lane::default(), newest, watches, stopped }
    }

    /// Makes an edit in its turn; returns what it returned and the scene then.
    async fn edit<T: Send + 'static>(
        &self,
        edit: impl FnOnce(&mut config::Scene) -> Result<T, SceneError> + Send + 'static,
    ) -> Result<(T, Arc<config::Scene>), Status> {
        let (host, newest) = (Arc::clone(&self.host), Arc::clone(&self.newest));
        let work = move || {
            let (result, scene) = host.edit_scene(edit)?;
            // Here, where edits have their turn: told even if nobody waits for the answer.
            newest.send_replace(Arc::clone(&scene));
            Ok((result, scene))
        };
        self.edits.run(work).await
    }

    fn read(&self, id: &str, scene: &config::Scene) -> Result<Response<SceneObject>, Status> {
        let object = scene.get(id).map_err(|error| scene_status(&error))?;
        let name = names::object(&self.host, id);
        Ok(Response::new(object_to_proto(object, name)))
    }

    /// An object with its whole name, as `field`; checked.
    fn named(&self, field: &str, object: &SceneObject) -> Result<config::SceneObject, Status> {
        let name = format!("{field}.name");
        let id = Id::parse(&name, names::object_id(&self.host, &name, &object.name)?);
        let id = id.map_err(|error| {
            // The whole name is what was written; the rule is that of its last part.
            let value = format!("{:?}", object.name);
            field_status(&FieldError { value, ..error })
        })?;
        object_from_proto(id, object).map_err(|error| field_status(&error.within(field)))
    }
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
        names::expect_scene(&self.host, "name", &request.get_ref().name)?;
        Ok(Response::new(scene_to_proto(&self.host, &self.host.scene())))
    }

    async fn replace_scene(
        &self,
        request: Request<ReplaceSceneRequest>,
    ) -> Result<Response<Scene>, Status> {
        let ReplaceSceneRequest { name, objects, scene_revision } = request.into_inner();
        names::expect_scene(&self.host, "name", &name)?;
        if objects.len() > MAX_OBJECTS {
            return Err(scene_status(&SceneError::Full { max: MAX_OBJECTS }));
        }
        let objects = objects.iter().enumerate();
        let objects = objects.map(|(i, object)| self.named(&format!("objects[{i}]"), object));
        let objects = objects.collect::<Result<Vec<_>, _>>()?;
        let expected = NonZeroU64::new(scene_revision);
        let (_, scene) = self.edit(move |scene| scene.replace(objects, expected)).await?;
        Ok(Response::new(scene_to_proto(&self.host, &scene)))
    }

    type WatchSceneStream = ReceiverStream<Result<Scene, Status>>;

    async fn watch_scene(
        &self,
        request: Request<WatchSceneRequest>,
    ) -> Result<Response<Self::WatchSceneStream>, Status> {
        names::expect_scene(&self.host, "name", &request.get_ref().name)?;
        let Ok(place) = Arc::clone(&self.watches).try_acquire_owned() else {
            let full = format!("{MAX_WATCHES} watches are open already; end one of them");
            return Err(Status::resource_exhausted(full));
        };
        let (scenes, watched) = mpsc::channel(1);
        let (host, mut newest) = (Arc::clone(&self.host), self.newest.subscribe());
        let mut stopped = self.stopped.clone();
        tokio::spawn(async move {
            let _place = place;
            let tell = async {
                loop {
                    // A slow reader is waited for here, and then told the newest.
                    let Ok(room) = scenes.reserve().await else { return };
                    let scene = Arc::clone(&newest.borrow_and_update());
                    room.send(Ok(scene_to_proto(&host, &scene)));
                    if newest.changed().await.is_err() {
                        return;
                    }
                }
            };
            tokio::select! {
                () = tell => {}
                () = scenes.closed() => {}
                _ = stopped.wait_for(|stopped| *stopped) => {}
            }
        });
        Ok(Response::new(ReceiverStream::new(watched)))
    }

    async fn list_objects(
        &self,
        request: Request<ListObjectsRequest>,
    ) -> Result<Response<ListObjectsResponse>, Status> {
        names::expect_scene(&self.host, "parent", &request.get_ref().parent)?;
        let Scene { revision, objects, .. } = scene_to_proto(&self.host, &self.host.scene());
        Ok(Response::new(ListObjectsResponse { objects, scene_revision: revision }))
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
        let object = object_from_proto(id, &object);
        let object = object.map_err(|error| field_status(&error.within("object")))?;
        let expected = NonZeroU64::new(scene_revision);
        let (_, scene) = self.edit(move |scene| scene.create(object, expected)).await?;
        self.read(&object_id, &scene)
    }

    async fn update_object(
        &self,
        request: Request<UpdateObjectRequest>,
    ) -> Result<Response<SceneObject>, Status> {
        let UpdateObjectRequest { object, scene_revision } = request.into_inner();
        let object = self.named("object", &object.ok_or_else(missing_object)?)?;
        let (id, expected) = (object.id().to_string(), NonZeroU64::new(scene_revision));
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
