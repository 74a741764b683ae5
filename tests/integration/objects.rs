//! Objects of every kind through gRPC: as they were written, felt by the simulated hand, and
//! changed as a whole under somebody's eyes.

use std::time::Duration;

use hapticd::client::{Client, Services};
use hapticd::device::HandProgram;
use hapticd::proto::guide::Path;
use hapticd::proto::scene_object::Kind;
use hapticd::proto::{
    self, Capsule, Corridor, CreateObjectRequest, DeleteObjectRequest, ForceField, GetSceneRequest,
    Guide, GuideLine, GuidePlane, GuidePoint, Material, Quaternion, ReplaceSceneRequest, Role,
    Scene, SceneObject, State, Vector3, WatchSceneRequest, Wrench,
};
use tonic::{Code, Status};

use super::support::{DEVICE, PATIENCE, Rig, next_state};

/// Ids in State of objects of the resident scene begin here.
const SCENE_ID: u32 = 1 << 31;

fn at(x: f64, y: f64) -> Vector3 {
    Vector3 { x, y, z: 0.0 }
}

fn surface(kind: Kind) -> SceneObject {
    let material = Material { stiffness_n_per_m: 2e4, ..Material::default() };
    SceneObject { kind: Some(kind), material: Some(material), ..SceneObject::default() }
}

fn field(kind: Kind) -> SceneObject {
    SceneObject { kind: Some(kind), ..SceneObject::default() }
}

fn block(centre: Vector3, half: [f64; 3]) -> proto::Box {
    let [x, y, z] = half;
    let half_extents_m = Some(Vector3 { x, y, z });
    proto::Box { centre_m: Some(centre), half_extents_m, orientation: None }
}

fn guide(path: Path) -> SceneObject {
    surface(Kind::Guide(Guide { radius_m: 0.01, path: Some(path) }))
}

/// One of each, out of the hand's way, and such that it comes back as it is written.
fn every_kind() -> Vec<(&'static str, SceneObject)> {
    let far = at(50.0, 0.0);
    let up = Some(Vector3 { x: 0.0, y: 0.0, z: 1.0 });
    let turned = Some(Quaternion { x: 0.5, y: -0.5, z: 0.5, w: 0.5 });
    let wrench = Wrench { force_n: Some(at(0.1, 0.2)), moment_nm: up };
    let rubber = Material {
        stiffness_n_per_m: 2e4,
        damping_ns_per_m: 1.0,
        kinetic_friction: 0.3,
        static_friction: Some(0.5),
        surface_velocity_m_per_s: Some(at(0.25, 0.0)),
    };
    let plane = proto::HalfSpace { point_m: Some(far), normal: Some(at(-1.0, 0.0)) };
    let ball = proto::Sphere { centre_m: Some(far), radius_m: 0.02 };
    let turned = proto::Box { orientation: turned, ..block(far, [0.01, 0.02, 0.03]) };
    let line = GuideLine { point_m: Some(far), direction: up };
    let sheet = GuidePlane { point_m: Some(far), normal: up };
    vec![
        ("half-space", SceneObject { hollow: true, ..surface(Kind::HalfSpace(plane)) }),
        ("sphere", SceneObject { material: Some(rubber), ..surface(Kind::Sphere(ball)) }),
        ("box", SceneObject { hollow: true, ..surface(Kind::Box(turned)) }),
        ("capsule", surface(Kind::Capsule(Capsule { ends_m: vec![far; 2], radius_m: 0.02 }))),
        ("corridor", surface(Kind::Corridor(Corridor { points_m: vec![far; 64], radius_m: 60.0 }))),
        ("guide-point", guide(Path::Point(GuidePoint { point_m: Some(far) }))),
        ("guide-line", guide(Path::Line(line))),
        ("guide-plane", guide(Path::Plane(sheet))),
        ("constant", field(Kind::Constant(proto::ConstantField { force_n: Some(at(0.0, 0.1)) }))),
        ("viscous", field(Kind::Viscous(proto::ViscousField { damping_ns_per_m: 0.5 }))),
        (
            "force-field",
            field(Kind::ForceField(ForceField {
                origin_m: Some(far),
                wrench: Some(wrench),
                stiffness_n_per_m: (1..=9).map(f64::from).collect(),
                damping_ns_per_m: vec![1.0, 2.0, 3.0],
                radius_m: 0.05,
            })),
        ),
    ]
}

fn scene_name() -> String {
    format!("{DEVICE}/scene")
}

fn named(id: &str, object: SceneObject) -> SceneObject {
    SceneObject { name: format!("{DEVICE}/scene/objects/{id}"), ..object }
}

async fn create(services: &mut Services, id: &str, object: &SceneObject) -> SceneObject {
    let request = CreateObjectRequest {
        parent: scene_name(),
        object_id: id.into(),
        object: Some(object.clone()),
        scene_revision: 0,
    };
    services.scenes.create_object(request).await.unwrap().into_inner()
}

async fn get_scene(services: &mut Services) -> Scene {
    let request = GetSceneRequest { name: scene_name() };
    services.scenes.get_scene(request).await.unwrap().into_inner()
}

fn replace(objects: Vec<SceneObject>, scene_revision: u64) -> ReplaceSceneRequest {
    ReplaceSceneRequest { name: scene_name(), objects, scene_revision }
}

fn expect<T: std::fmt::Debug>(answer: Result<T, Status>, code: Code, words: &str) {
    let status = answer.unwrap_err();
    assert_eq!(status.code(), code, "{status}");
    assert!(status.message().contains(words), "{words:?} is not in {:?}", status.message());
}

#[test]
fn every_kind_is_read_back_as_it_was_written_also_by_the_next_server() {
    let rig = Rig::start();
    let written = every_kind();
    let scene = rig.run(async {
        let mut services = rig.services().await;
        for (revision, (id, object)) in (2..).zip(&written) {
            let made = create(&mut services, id, object).await;
            assert_eq!(made, SceneObject { revision, ..named(id, object.clone()) });
        }
        get_scene(&mut services).await
    });
    assert_eq!(scene.objects.len(), written.len());
    let (runtime, state) = rig.stop();
    drop(runtime);
    let again = Rig::with(|config| config.state_dir = Some(state.path().to_owned()));
    again.run(async {
        assert_eq!(get_scene(&mut again.services().await).await, scene);
    });
}

/// A hand that goes where it is told, and what is felt meanwhile.
struct Feeler {
    services: Services,
    hand: Client,
}

impl Feeler {
    /// Draws the hand to a place until a State is as wanted.
    async fn pull(&mut self, to: [f32; 2], wanted: impl Fn(&State) -> bool) -> State {
        loop {
            let state = next_state(&mut self.hand).await;
            if wanted(&state) {
                return state;
            }
            self.hand.send_hand([to[0], to[1], 0.0], true, 0).unwrap();
        }
    }

    /// Puts an object there, pulls into it until it asks for 2 N against the pull, and takes
    /// it away.
    async fn feels(&mut self, id: &str, object: SceneObject, from: [f32; 2], to: [f32; 2]) {
        self.pull(from, |state| {
            let away = [state.position_m[0] - from[0], state.position_m[1] - from[1]];
            away.iter().all(|part| part.abs() < 2e-3)
        })
        .await;
        let is_field = object.material.is_none();
        let made = create(&mut self.services, id, &object).await;
        let way = [to[0] - from[0], to[1] - from[1]];
        let state = self
            .pull(to, |state| {
                let against = state.requested.iter().zip(way).map(|(f, way)| f * way).sum::<f32>();
                let length = way.iter().map(|part| part * part).sum::<f32>().sqrt();
                state.scene_revision == made.revision && against < -2.0 * length
            })
            .await;
        let felt: &[u32] = if is_field { &[] } else { &[SCENE_ID] };
        assert_eq!(state.contact_id, felt, "{id}");
        let gone = DeleteObjectRequest { name: made.name, scene_revision: 0 };
        self.services.scenes.delete_object(gone).await.unwrap();
    }
}

#[test]
fn one_of_each_family_is_felt_by_the_simulated_hand() {
    let rig = Rig::with(|config| config.devices[0].hand = HandProgram::Pointer);
    rig.run(async {
        let mut feeler =
            Feeler { services: rig.services().await, hand: rig.client("hand", Role::Hand).await };
        let (home, right, up) = ([0.3, 0.1], [0.36, 0.1], [0.3, 0.16]);
        let plate = surface(Kind::Box(block(at(0.32, 0.1), [0.001, 0.1, 0.1])));
        feeler.feels("plate", plate, home, right).await;
        let ends_m = vec![at(0.33, 0.05), at(0.33, 0.15)];
        let bone = surface(Kind::Capsule(Capsule { ends_m, radius_m: 0.01 }));
        feeler.feels("bone", bone, home, right).await;
        let points_m = vec![at(0.2, 0.1), at(0.3, 0.1), at(0.4, 0.1)];
        let way = surface(Kind::Corridor(Corridor { points_m, radius_m: 0.01 }));
        feeler.feels("way", way, home, up).await;
        let line = GuideLine { point_m: Some(at(0.0, 0.1)), direction: Some(at(1.0, 0.0)) };
        feeler.feels("rail", guide(Path::Line(line)), home, up).await;
        let spring = ForceField {
            origin_m: Some(at(0.3, 0.1)),
            stiffness_n_per_m: vec![200.0; 3],
            radius_m: 0.1,
            ..ForceField::default()
        };
        feeler.feels("spring", field(Kind::ForceField(spring)), home, right).await;
    });
}

#[test]
fn a_whole_scene_is_replaced_at_once_or_not_at_all() {
    let rig = Rig::start();
    rig.run(async {
        let mut services = rig.services().await;
        let all: Vec<_> = every_kind().into_iter().map(|(id, object)| named(id, object)).collect();
        let first = services.scenes.replace_scene(replace(all.clone(), 1)).await.unwrap();
        let first = first.into_inner();
        assert_eq!((first.revision, first.objects.len()), (2, all.len()));
        // One is changed, one is gone, one is new, in whatever order.
        let mut next = all.clone();
        next.reverse();
        next.retain(|object| !object.name.ends_with("/viscous"));
        for object in &mut next {
            if let Some(Kind::Sphere(ball)) = &mut object.kind {
                ball.radius_m = 0.03;
            }
        }
        next.push(named("fresh", guide(Path::Point(GuidePoint { point_m: Some(at(9.0, 9.0)) }))));
        let second = services.scenes.replace_scene(replace(next, 2)).await.unwrap().into_inner();
        assert_eq!((second.revision, second.objects.len()), (3, all.len()));
        for object in &second.objects {
            let changed = object.name.ends_with("/sphere") || object.name.ends_with("/fresh");
            assert_eq!(object.revision, if changed { 3 } else { 2 }, "{}", object.name);
        }
        // Nothing of what is refused is done.
        let scenes = &mut services.scenes;
        let stale = scenes.replace_scene(replace(vec![], 2)).await;
        expect(stale, Code::Aborted, "scene_revision = 2: the scene is at revision 3");
        let mut bad = all.clone();
        if let Some(Kind::Capsule(bone)) = &mut bad[3].kind {
            bone.ends_m[1].y = f64::NAN;
        }
        let words = "objects[3].capsule.ends_m[1].y = NaN: must be a number in -100 to 100 m";
        expect(scenes.replace_scene(replace(bad, 0)).await, Code::InvalidArgument, words);
        let twins = vec![all[0].clone(), all[1].clone(), all[0].clone()];
        let words = "objects[2].name = half-space: must be unique";
        expect(scenes.replace_scene(replace(twins, 0)).await, Code::InvalidArgument, words);
        let nameless = vec![SceneObject { name: "ball".into(), ..all[1].clone() }];
        let words = "objects[0].name = \"ball\": this server has devices/cho-2005/scene/objects/ID";
        expect(scenes.replace_scene(replace(nameless, 0)).await, Code::NotFound, words);
        let shouted = vec![named("Ball", all[1].clone())];
        let words = "objects[0].name = \"devices/cho-2005/scene/objects/Ball\": must be 1 to 63";
        expect(scenes.replace_scene(replace(shouted, 0)).await, Code::InvalidArgument, words);
        let many = (0..257).map(|i| named(&format!("w{i}"), all[0].clone())).collect();
        let crowd = scenes.replace_scene(replace(many, 0)).await;
        expect(crowd, Code::ResourceExhausted, "at most 256 objects");
        let elsewhere =
            ReplaceSceneRequest { name: "devices/x/scene".into(), ..replace(vec![], 0) };
        expect(scenes.replace_scene(elsewhere).await, Code::NotFound, "devices/x/scene");
        assert_eq!(get_scene(&mut services).await, second);
    });
}

#[test]
fn who_watches_a_scene_is_told_it_and_every_change_and_the_newest_in_the_end() {
    let rig = Rig::start();
    let (mut first, mut slow) = rig.run(async {
        let mut services = rig.services().await;
        let watch = || WatchSceneRequest { name: scene_name() };
        let mut first = services.scenes.watch_scene(watch()).await.unwrap().into_inner();
        let now = first.message().await.unwrap().unwrap();
        assert_eq!(now, get_scene(&mut services).await);
        let slow = services.scenes.watch_scene(watch()).await.unwrap().into_inner();
        let ball = &every_kind()[1].1;
        create(&mut services, "ball", ball).await;
        let then = first.message().await.unwrap().unwrap();
        assert_eq!(then, get_scene(&mut services).await);
        for round in 0..40 {
            create(&mut services, &format!("ball-{round}"), ball).await;
        }
        // Whoever reads late may have missed some, and ends with the newest all the same.
        (first, slow)
    });
    rig.run(async {
        for watched in [&mut first, &mut slow] {
            let mut last = 0;
            while last < 42 {
                let scene = watched.message().await.unwrap().unwrap();
                assert!(scene.revision > last, "{} after {last}", scene.revision);
                assert_eq!(scene.objects.len() as u64, scene.revision - 1);
                last = scene.revision;
            }
        }
        // A refused edit is no change.
        let mut services = rig.services().await;
        let refused = services.scenes.replace_scene(replace(vec![], 1)).await;
        expect(refused, Code::Aborted, "scene_revision = 1");
        let quiet = tokio::time::timeout(Duration::from_millis(100), first.message()).await;
        assert!(quiet.is_err(), "{quiet:?}");
    });
    let (runtime, _state) = rig.stop();
    let ended = runtime.block_on(async { tokio::time::timeout(PATIENCE, first.message()).await });
    assert!(matches!(ended, Ok(Ok(None) | Err(_))), "{ended:?}");
}

#[test]
fn a_watch_too_many_is_refused_and_one_that_ends_makes_room() {
    let rig = Rig::start();
    rig.run(async {
        let mut services = rig.services().await;
        let watch = || WatchSceneRequest { name: scene_name() };
        let mut watches = Vec::new();
        for _ in 0..64 {
            watches.push(services.scenes.watch_scene(watch()).await.unwrap());
        }
        let refused = services.scenes.watch_scene(watch()).await.map(drop);
        expect(refused, Code::ResourceExhausted, "64 watches of scenes are open already");
        watches.pop();
        while services.scenes.watch_scene(watch()).await.is_err() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        let other = WatchSceneRequest { name: "devices/other/scene".into() };
        let other = services.scenes.watch_scene(other).await.map(drop);
        expect(other, Code::NotFound, "devices/other/scene");
    });
}
