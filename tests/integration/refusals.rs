//! What the services refuse, word by word, and what they say about themselves.

use hapticd::client::Services;
use hapticd::proto::scene_object::Kind;
use hapticd::proto::{
    self, ConstantField, Corridor, CreateObjectRequest, DeleteObjectRequest, GetSceneRequest,
    Guide, HalfSpace, Material, SceneObject, Sphere, UpdateObjectRequest, Vector3,
};
use tonic::transport::{Channel, Endpoint};
use tonic::{Code, Status};
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

use super::support::{DEVICE, Rig};

/// Most objects of a scene.
const MOST: usize = 256;

fn vector(x: f64) -> Option<Vector3> {
    Some(Vector3 { x, y: 0.0, z: 0.0 })
}

fn wall(change: impl FnOnce(&mut HalfSpace, &mut Material)) -> SceneObject {
    let mut plane = HalfSpace { point_m: vector(0.5), normal: vector(-1.0) };
    let mut material = Material { stiffness_n_per_m: 1e7, ..Material::default() };
    change(&mut plane, &mut material);
    SceneObject {
        kind: Some(Kind::HalfSpace(plane)),
        material: Some(material),
        ..SceneObject::default()
    }
}

fn good() -> SceneObject {
    wall(|_, _| ())
}

fn push(x_N: f64) -> SceneObject {
    let field = ConstantField { force_n: vector(x_N) };
    SceneObject { kind: Some(Kind::Constant(field)), ..SceneObject::default() }
}

fn create(id: &str, object: SceneObject) -> CreateObjectRequest {
    CreateObjectRequest {
        parent: format!("{DEVICE}/scene"),
        object_id: id.into(),
        object: Some(object),
        scene_revision: 0,
    }
}

fn named(id: &str, object: SceneObject) -> SceneObject {
    SceneObject { name: format!("{DEVICE}/scene/objects/{id}"), ..object }
}

async fn scene(services: &mut Services) -> hapticd::proto::Scene {
    let name = format!("{DEVICE}/scene");
    services.scenes.get_scene(GetSceneRequest { name }).await.unwrap().into_inner()
}

fn expect<T: std::fmt::Debug>(answer: Result<T, Status>, code: Code, words: &str) {
    let status = answer.unwrap_err();
    assert_eq!(status.code(), code, "{status}");
    assert!(status.message().contains(words), "{words:?} is not in {:?}", status.message());
}

/// Objects that nobody can have, and what has to be said of them.
fn impossible() -> Vec<(SceneObject, &'static str)> {
    let sphere = |radius_m| SceneObject {
        kind: Some(Kind::Sphere(Sphere { centre_m: vector(0.0), radius_m })),
        ..good()
    };
    vec![
        (
            wall(|_, material| material.stiffness_n_per_m = -1.0),
            "object.material.stiffness_n_per_m = -1: must be a number in 0 to 1000000000 N/m",
        ),
        (
            wall(|_, material| material.stiffness_n_per_m = f64::NAN),
            "object.material.stiffness_n_per_m = NaN: must be a number in 0 to 1000000000 N/m",
        ),
        (
            wall(|_, material| material.stiffness_n_per_m = f64::INFINITY),
            "object.material.stiffness_n_per_m = inf: must be",
        ),
        (
            wall(|_, material| material.damping_ns_per_m = f64::NAN),
            "object.material.damping_ns_per_m = NaN: must be a number in 0 to 1000000 N s/m",
        ),
        (
            wall(|_, material| material.kinetic_friction = 11.0),
            "object.material.kinetic_friction = 11: must be a number in 0 to 10",
        ),
        (
            wall(|_, material| {
                (material.kinetic_friction, material.static_friction) = (0.5, Some(0.4));
            }),
            "object.material.static_friction = 0.4: must be at least kinetic_friction, 0.5",
        ),
        (
            wall(|_, material| material.surface_velocity_m_per_s = vector(f64::INFINITY)),
            "object.material.surface_velocity_m_per_s.x = inf: must be a number in -100 to 100",
        ),
        (
            wall(|plane, _| plane.normal = vector(0.0)),
            "object.half_space.normal = 0: must be a number in 0.000001 to 1000000",
        ),
        (wall(|plane, _| plane.normal = None), "object.half_space.normal = (none): is required"),
        (
            wall(|plane, _| plane.point_m = vector(f64::NAN)),
            "object.half_space.point_m.x = NaN: must be a number in -100 to 100 m",
        ),
        (sphere(-0.1), "object.sphere.radius_m = -0.1: must be a number in 0.0001 to 100 m"),
        (push(f64::NAN), "object.constant.force_n.x = NaN: must be a number in -1000 to 1000 N"),
        (
            SceneObject { kind: Some(Kind::Box(proto::Box::default())), ..good() },
            "object.box.centre_m = (none): is required",
        ),
        (
            SceneObject { kind: Some(Kind::Corridor(Corridor::default())), ..good() },
            "object.corridor.points_m = 0 points: must be 2 to 64",
        ),
        (
            SceneObject { kind: Some(Kind::Guide(Guide::default())), ..good() },
            "object.guide.path = (none): one of point, line, plane is required",
        ),
        (SceneObject { material: None, ..good() }, "object.material = (none): a surface needs"),
        (
            SceneObject { hollow: true, ..push(1.0) },
            "object.hollow = true: only a half-space, sphere, box or capsule",
        ),
        (SceneObject::default(), "object.kind = (none): one of half_space, sphere"),
    ]
}

#[test]
fn an_impossible_object_is_refused_by_field_value_and_range() {
    let rig = Rig::start();
    rig.run(async {
        let mut services = rig.services().await;
        services.scenes.create_object(create("table", good())).await.unwrap();
        let before = scene(&mut services).await;
        for (object, words) in impossible() {
            let created = services.scenes.create_object(create("other", object.clone())).await;
            expect(created, Code::InvalidArgument, words);
            let object = Some(named("table", object));
            let request = UpdateObjectRequest { object, scene_revision: 0 };
            expect(services.scenes.update_object(request).await, Code::InvalidArgument, words);
        }
        for id in ["", "Table", "-table", "ta_ble", "../table", &"t".repeat(64)] {
            let created = services.scenes.create_object(create(id, good())).await;
            let words = format!("object_id = {id:?}: must be 1 to 63 of a-z, 0-9 and \"-\"");
            expect(created, Code::InvalidArgument, &words);
        }
        let nothing = CreateObjectRequest { object: None, ..create("other", good()) };
        let created = services.scenes.create_object(nothing).await;
        expect(created, Code::InvalidArgument, "object = (none): is required");
        assert_eq!(scene(&mut services).await, before);
    });
}

#[test]
fn an_edit_of_what_is_not_there_or_not_as_it_was_is_refused() {
    let rig = Rig::start();
    rig.run(async {
        let mut services = rig.services().await;
        services.scenes.create_object(create("table", good())).await.unwrap();
        let before = scene(&mut services).await;
        assert_eq!(before.revision, 2);
        let scenes = &mut services.scenes;
        let again = scenes.create_object(create("table", good())).await;
        expect(again, Code::AlreadyExists, "\"table\"");
        let parent = "devices/other/scene".to_owned();
        let elsewhere = CreateObjectRequest { parent, ..create("chair", good()) };
        let words = "parent = \"devices/other/scene\": this server has devices/cho-2005/scene";
        expect(scenes.create_object(elsewhere).await, Code::NotFound, words);

        let stale = "scene_revision = 1: the scene is at revision 2";
        let request = CreateObjectRequest { scene_revision: 1, ..create("chair", good()) };
        expect(scenes.create_object(request).await, Code::Aborted, stale);
        let object = Some(named("table", good()));
        let request = UpdateObjectRequest { object, scene_revision: 1 };
        expect(scenes.update_object(request).await, Code::Aborted, stale);
        let name = named("table", good()).name;
        let request = DeleteObjectRequest { name: name.clone(), scene_revision: 1 };
        expect(scenes.delete_object(request).await, Code::Aborted, stale);

        let object = Some(named("Chair", good()));
        let request = UpdateObjectRequest { object, scene_revision: 0 };
        let words = "object.name = \"devices/cho-2005/scene/objects/Chair\": must be 1 to 63";
        expect(scenes.update_object(request).await, Code::InvalidArgument, words);
        let object = Some(named("chair", good()));
        let request = UpdateObjectRequest { object, scene_revision: 0 };
        expect(scenes.update_object(request).await, Code::NotFound, "\"chair\"");
        let chair = named("chair", good()).name;
        let request = DeleteObjectRequest { name: chair, scene_revision: 0 };
        expect(scenes.delete_object(request).await, Code::NotFound, "\"chair\"");
        let nowhere = DeleteObjectRequest { name: "table".into(), scene_revision: 0 };
        expect(scenes.delete_object(nowhere).await, Code::NotFound, "name = \"table\"");
        assert_eq!(scene(&mut services).await, before);

        let right = DeleteObjectRequest { name, scene_revision: 2 };
        assert_eq!(services.scenes.delete_object(right).await.unwrap().get_ref().scene_revision, 3);
    });
}

#[test]
fn an_object_too_many_is_refused_and_the_others_stay() {
    let rig = Rig::start();
    rig.run(async {
        let mut services = rig.services().await;
        for number in 0..MOST {
            let request = create(&format!("wall-{number}"), good());
            services.scenes.create_object(request).await.unwrap();
        }
        let before = scene(&mut services).await;
        assert_eq!((before.objects.len(), before.revision), (MOST, 1 + MOST as u64));
        let one_more = services.scenes.create_object(create("one-more", good())).await;
        expect(one_more, Code::ResourceExhausted, "at most 256 objects");
        assert_eq!(scene(&mut services).await, before);
    });
}

async fn channel(rig: &Rig) -> Channel {
    let endpoint = format!("http://{}", rig.target().grpc_authority());
    Endpoint::from_shared(endpoint).unwrap().connect().await.unwrap()
}

#[test]
fn the_services_are_healthy() {
    let rig = Rig::start();
    rig.run(async {
        let mut health = HealthClient::new(channel(&rig).await);
        for service in ["", "hapticd.v1.DeviceService", "hapticd.v1.SceneService"] {
            let request = HealthCheckRequest { service: service.into() };
            let answer = health.check(request).await.unwrap().into_inner();
            assert_eq!(answer.status(), ServingStatus::Serving, "{service}");
        }
        let request = HealthCheckRequest { service: "hapticd.v1.Nothing".into() };
        expect(health.check(request).await, Code::NotFound, "");
    });
}

/// Lists the services by one version of reflection, and finds the file of one of them.
macro_rules! reflected {
    ($version:ident, $channel:expr) => {{
        use tonic_reflection::pb::$version::{
            ServerReflectionRequest, server_reflection_client::ServerReflectionClient,
            server_reflection_request::MessageRequest, server_reflection_response::MessageResponse,
        };
        let ask = |request| ServerReflectionRequest {
            message_request: Some(request),
            ..ServerReflectionRequest::default()
        };
        let requests = tokio_stream::iter([
            ask(MessageRequest::ListServices(String::new())),
            ask(MessageRequest::FileContainingSymbol("hapticd.v1.SceneService".into())),
        ]);
        let mut client = ServerReflectionClient::new($channel);
        let mut answers = client.server_reflection_info(requests).await.unwrap().into_inner();
        let first = answers.message().await.unwrap().unwrap().message_response.unwrap();
        let MessageResponse::ListServicesResponse(listed) = first else { panic!("{first:?}") };
        let second = answers.message().await.unwrap().unwrap().message_response.unwrap();
        let MessageResponse::FileDescriptorResponse(file) = second else { panic!("{second:?}") };
        assert!(!file.file_descriptor_proto.is_empty());
        listed.service.into_iter().map(|service| service.name).collect::<Vec<_>>()
    }};
}

#[test]
fn both_versions_of_reflection_list_the_services() {
    let rig = Rig::start();
    rig.run(async {
        let channel = channel(&rig).await;
        let listed = [reflected!(v1, channel.clone()), reflected!(v1alpha, channel)];
        for names in listed {
            for name in
                ["hapticd.v1.DeviceService", "hapticd.v1.SceneService", "grpc.health.v1.Health"]
            {
                assert!(names.iter().any(|listed| listed == name), "{name} is not in {names:?}");
            }
        }
    });
}
