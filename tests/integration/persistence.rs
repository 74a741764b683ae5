//! What outlives a server: its scene and its identity, through `kill -9` and clean ends.

use std::collections::BTreeMap;
use std::net::{TcpListener, UdpSocket};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use hapticd::client::Authorized;
use hapticd::client::{ConnectString, services};
use hapticd::proto::scene_object::Kind;
use hapticd::proto::scene_service_client::SceneServiceClient;
use hapticd::proto::{
    CreateObjectRequest, DeleteObjectRequest, GetSceneRequest, HalfSpace, Material, Scene,
    SceneObject, UpdateObjectRequest, Vector3,
};
use rand::{Rng, SeedableRng};
use rustix::process::Signal;
use tokio::runtime::Runtime;

use super::support::{DEVICE, PATIENCE, Server, config_file, finish, hapticd};

const SCENE_FILE: &str = "devices/cho-2005/scene.toml";

/// Clients that write at the same time.
const WRITERS: usize = 3;

/// Servers that are killed one after another.
const LIVES: u64 = 100;

fn wall(id: &str, x_m: f64) -> SceneObject {
    let point_m = Some(Vector3 { x: x_m, y: 0.0, z: 0.0 });
    let normal = Some(Vector3 { x: -1.0, y: 0.0, z: 0.0 });
    SceneObject {
        name: format!("{DEVICE}/scene/objects/{id}"),
        kind: Some(Kind::HalfSpace(HalfSpace { point_m, normal })),
        material: Some(Material { stiffness_n_per_m: 1e7, ..Material::default() }),
        ..SceneObject::default()
    }
}

fn create(id: &str, x_m: f64) -> CreateObjectRequest {
    CreateObjectRequest {
        parent: format!("{DEVICE}/scene"),
        object_id: id.into(),
        object: Some(wall(id, x_m)),
        scene_revision: 0,
    }
}

/// A runtime whose every use ends.
struct Patient(Runtime);

impl Patient {
    fn new() -> Self {
        let mut builder = tokio::runtime::Builder::new_multi_thread();
        Self(builder.worker_threads(1).enable_all().build().unwrap())
    }

    fn run<T>(&self, work: impl Future<Output = T>) -> T {
        self.0.block_on(async { tokio::time::timeout(PATIENCE, work).await }).expect("no answer")
    }

    fn scene(&self, connect: &ConnectString) -> Scene {
        self.run(async {
            let request = GetSceneRequest { name: format!("{DEVICE}/scene") };
            scenes(connect).await.get_scene(request).await.unwrap().into_inner()
        })
    }
}

async fn scenes(connect: &ConnectString) -> SceneServiceClient<Authorized> {
    services(connect).await.unwrap().scenes
}

/// `serve` on this state, which has to be refused.
fn refused(state: &Path, top: &str, words: &[&str]) {
    let file = config_file(state, top);
    finish(hapticd().args(["serve", "--config"]).arg(file)).refused(words);
}

#[test]
fn walls_and_identity_survive_kill_9() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let client = Patient::new();
    let first = Server::start(&state);
    client.run(async {
        let mut scenes = scenes(&first.connect).await;
        scenes.create_object(create("table", 0.4)).await.unwrap();
        scenes.create_object(create("door", 0.5)).await.unwrap();
        scenes.create_object(create("gone", 0.6)).await.unwrap();
        let name = wall("gone", 0.0).name;
        scenes.delete_object(DeleteObjectRequest { name, scene_revision: 0 }).await.unwrap();
    });
    let before = client.scene(&first.connect);
    assert_eq!((before.revision, before.objects.len()), (5, 2));
    let identity = first.connect.sha256;
    first.kill();
    let second = Server::start(&state);
    assert_eq!(client.scene(&second.connect), before);
    assert!(identity.is_some() && second.connect.sha256 == identity);
}

#[test]
fn a_state_directory_has_one_server() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let first = Server::start(&state);
    let path = state.display().to_string();
    refused(&state, "", &["another hapticd is using this state directory", &path, "--state-dir"]);
    // The first is not disturbed, and when it is gone the next one may.
    Patient::new().scene(&first.connect);
    first.kill();
    drop(Server::start(&state));
}

#[test]
fn a_corrupt_scene_is_refused_and_left_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let client = Patient::new();
    let server = Server::start(&state);
    client.run(async {
        scenes(&server.connect).await.create_object(create("table", 0.4)).await.unwrap();
    });
    server.kill();
    let path = state.join(SCENE_FILE);
    let whole = std::fs::read_to_string(&path).unwrap();
    let half = whole[..whole.len() / 2].to_owned();
    let negative = whole.replace("stiffness_n_per_m = ", "stiffness_n_per_m = -");
    let table = [
        (half, "cut short"),
        (String::new(), "cut short"),
        (negative, "object[0].material.stiffness_n_per_m = -10000000"),
    ];
    for (corrupt, words) in table {
        std::fs::write(&path, &corrupt).unwrap();
        refused(&state, "", &["scene.toml", words]);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), corrupt);
    }
    std::fs::write(&path, whole).unwrap();
    assert_eq!(client.scene(&Server::start(&state).connect).objects.len(), 1);
}

#[test]
fn a_port_in_use_is_named_with_its_key() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let file = folder.path().join("ports.toml");
    let tcp = TcpListener::bind("127.0.0.1:0").unwrap();
    let udp = UdpSocket::bind("127.0.0.1:0").unwrap();
    let (tcp, udp) = (tcp.local_addr().unwrap().port(), udp.local_addr().unwrap().port());
    for (key, port) in [("grpc_port", tcp), ("http_port", tcp), ("stream_port", udp)] {
        let ports = ["grpc_port", "http_port", "stream_port"]
            .map(|name| format!("{name} = {}\n", if name == key { port } else { 0 }));
        let text = format!("state_dir = {state:?}\n[server]\n{}", ports.concat());
        std::fs::write(&file, text).unwrap();
        let words = format!("server.{key} = {port}");
        let ended = finish(hapticd().args(["serve", "--config"]).arg(&file));
        ended.refused(&[&words, "127.0.0.1"]);
        assert_eq!(ended.stdout, "", "it does not say that it serves");
    }
}

#[test]
fn signals_stop_a_server_cleanly() {
    // As soon as it says that it serves, and more than once: a handler that comes later than
    // that is only sometimes too late.
    for signal in [Signal::TERM, Signal::INT].repeat(8) {
        let folder = tempfile::tempdir().unwrap();
        let server = Server::start(&folder.path().join("state"));
        let (code, log) = server.end_by(signal);
        assert_eq!(code, Some(0), "{signal:?}: {log}");
        assert!(log.contains("stopping"), "{log}");
    }
}

/// What one writer knows of its wall: `None` where there is none.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    acknowledged: Option<f64>,
    /// Asked for, and not answered yet.
    under_way: Option<Option<f64>>,
    /// Of the scene, at the last answer.
    revision: u64,
}

type Book = Arc<Mutex<BTreeMap<String, Known>>>;

/// Creates, moves and deletes one wall until the server is gone.
async fn write(id: String, connect: ConnectString, book: Book) {
    let mut scenes = scenes(&connect).await;
    for step in 1.. {
        let known = book.lock().unwrap()[&id];
        let next =
            (step % 5 != 0 || known.acknowledged.is_none()).then(|| 1.0 + f64::from(step) * 1e-3);
        book.lock().unwrap().get_mut(&id).unwrap().under_way = Some(next);
        let revision = match (known.acknowledged, next) {
            (None, x_m) => {
                let request = create(&id, x_m.unwrap_or_default());
                scenes.create_object(request).await.map(|made| made.into_inner().revision)
            }
            (Some(_), Some(x_m)) => {
                let object = Some(wall(&id, x_m));
                let request = UpdateObjectRequest { object, scene_revision: 0 };
                scenes.update_object(request).await.map(|moved| moved.into_inner().revision)
            }
            (Some(_), None) => {
                let name = wall(&id, 0.0).name;
                let request = DeleteObjectRequest { name, scene_revision: 0 };
                scenes.delete_object(request).await.map(|gone| gone.into_inner().scene_revision)
            }
        };
        let Ok(revision) = revision else { return };
        let known = Known { acknowledged: next, under_way: None, revision };
        book.lock().unwrap().insert(id.clone(), known);
    }
}

fn place(scene: &Scene, id: &str) -> Option<f64> {
    let name = wall(id, 0.0).name;
    match scene.objects.iter().find(|object| object.name == name)?.kind.as_ref()? {
        Kind::HalfSpace(plane) => plane.point_m.map(|point_m| point_m.x),
        _ => None,
    }
}

#[test]
fn no_acknowledged_change_is_lost_however_often_the_server_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let client = Patient::new();
    let ids: Vec<_> = (0..WRITERS).map(|number| format!("wall-{number}")).collect();
    let book = Book::default();
    book.lock().unwrap().extend(ids.iter().map(|id| (id.clone(), Known::default())));
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let mut last_revision = 1;
    for life in 0..LIVES {
        let server = Server::start(&state);
        let writers: Vec<_> = ids
            .iter()
            .map(|id| client.0.spawn(write(id.clone(), server.connect.clone(), Arc::clone(&book))))
            .collect();
        std::thread::sleep(Duration::from_millis(random.random_range(20..200)));
        server.kill();
        for writer in writers {
            // A writer that had not connected yet has written nothing.
            let _ = client.run(writer);
        }
        let scene = client.scene(&Server::start(&state).connect);
        let mut book = book.lock().unwrap();
        let acknowledged = book.values().map(|known| known.revision).max().unwrap();
        let under_way = book.values().filter(|known| known.under_way.is_some()).count() as u64;
        let least = acknowledged.max(last_revision);
        assert!((least..=least + under_way).contains(&scene.revision), "life {life}: {book:?}");
        last_revision = scene.revision;
        for (id, known) in book.iter_mut() {
            let found = place(&scene, id);
            let possible = found == known.acknowledged || Some(found) == known.under_way;
            assert!(possible, "life {life}: {id} is at {found:?}, known is {known:?}");
            *known = Known { acknowledged: found, under_way: None, revision: scene.revision };
        }
    }
    assert!(last_revision > 2 * LIVES, "hardly anything was written: {last_revision}");
}
