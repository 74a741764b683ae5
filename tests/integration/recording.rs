//! Recordings of real servers: made, fetched, replayed bit by bit, broken, and the black box.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use hapticd::client::{Client, Incoming, Services, services};
use hapticd::proto::record_entry::Entry;
use hapticd::proto::scene_object::Kind;
use hapticd::proto::{
    ClearFaultRequest, CreateObjectRequest, DeleteObjectRequest, DeleteRecordingRequest,
    DisableRequest, DownloadRecordingRequest, EnableRequest, GetRecordingRequest, HalfSpace,
    ListRecordingsRequest, Material, Mode, RecordEntry, Recording, Role, SceneObject,
    StartRecordingRequest, StopRecordingRequest, UpdateObjectRequest, Vector3,
};
use hapticd::recording::Recorded;
use prost::Message;
use rustix::process::Signal;
use serde_json::Value;
use tonic::{Code, Status};

use super::support::{
    DEVICE, Finished, PATIENCE, Rig, Server, finish, hapticd, next_state, run, send, wait_until,
    wall_at,
};

fn wall(x_m: f64) -> SceneObject {
    let point_m = Some(Vector3 { x: x_m, y: 0.0, z: 0.0 });
    let normal = Some(Vector3 { x: -1.0, y: 0.0, z: 0.0 });
    SceneObject {
        name: format!("{DEVICE}/scene/objects/wall"),
        kind: Some(Kind::HalfSpace(HalfSpace { point_m, normal })),
        material: Some(Material {
            stiffness_n_per_m: 1e7,
            kinetic_friction: 0.2,
            ..Material::default()
        }),
        ..SceneObject::default()
    }
}

fn create() -> CreateObjectRequest {
    CreateObjectRequest {
        parent: format!("{DEVICE}/scene"),
        object_id: "wall".into(),
        object: Some(wall(0.3)),
        scene_revision: 0,
    }
}

/// Answers States with a wall for so long, then leaves.
async fn command_for(client: &mut Client, x_m: f32, how_long: Duration) {
    let end = Instant::now() + how_long;
    while Instant::now() < end {
        let state = next_state(client).await;
        client.send_contacts(state.seq, 100, vec![wall_at(x_m)]).unwrap();
    }
}

/// Everything that may happen to a device in three seconds.
async fn disturb(rig: &Rig) {
    let mut services = rig.services().await;
    services.scenes.create_object(create()).await.unwrap();
    let mut client = rig.client("first", Role::Controller).await;
    command_for(&mut client, 0.2995, Duration::from_millis(500)).await;
    let name = || DEVICE.to_owned();
    services.devices.disable(DisableRequest { name: name() }).await.unwrap();
    services.devices.enable(EnableRequest { name: name() }).await.unwrap();
    let update = UpdateObjectRequest { object: Some(wall(0.302)), scene_revision: 0 };
    services.scenes.update_object(update).await.unwrap();
    command_for(&mut client, 0.301, Duration::from_millis(500)).await;
    drop(client);
    tokio::time::sleep(Duration::from_millis(300)).await;
    let mut client = rig.client("second", Role::Controller).await;
    while !matches!(client.next().await.unwrap(), Incoming::State(_)) {}
    command_for(&mut client, 0.3, Duration::from_millis(500)).await;
    let name = format!("{DEVICE}/scene/objects/wall");
    let delete = DeleteObjectRequest { name, scene_revision: 0 };
    services.scenes.delete_object(delete).await.unwrap();
    command_for(&mut client, 0.3, Duration::from_millis(300)).await;
}

fn replay(file: &Path) -> Finished {
    finish(hapticd().arg("replay").arg(file).arg("--json"))
}

fn verdict(finished: &Finished) -> Value {
    serde_json::from_str(&finished.stdout).unwrap_or_else(|e| panic!("{e}: {finished:?}"))
}

fn entries(bytes: &[u8]) -> Vec<RecordEntry> {
    let mut rest = bytes;
    let next = |rest: &mut &[u8]| RecordEntry::decode_length_delimited(rest).unwrap();
    std::iter::from_fn(|| (!rest.is_empty()).then(|| next(&mut rest))).collect()
}

#[test]
fn three_eventful_seconds_of_a_server_are_replayed_to_the_last_bit() {
    let rig = Rig::start();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.hrec");
    let (target, path) = (rig.target().to_string(), file.clone());
    let recording = std::thread::spawn(move || {
        let mut command = hapticd();
        command.args(["record", "--seconds", "3", "--json", "--connect", &target]);
        finish(command.arg(path))
    });
    rig.run(disturb(&rig));
    let recorded = verdict(&recording.join().unwrap().ok());
    assert_eq!(recorded["lost_ticks"], 0, "{recorded}");

    let replayed = verdict(&replay(&file).ok());
    assert_eq!(
        (&replayed["bit_equal"], &replayed["whole"]),
        (&true.into(), &true.into()),
        "{replayed}"
    );
    assert_eq!(replayed["ticks"], recorded["ticks"]);
    assert!(replayed["ticks"].as_u64().unwrap() > 1_000, "{replayed}");

    let bytes = fs::read(&file).unwrap();
    let run = Recorded::read(bytes.clone()).unwrap();
    let has = |wanted: fn(&hapticd::proto::RecordReport) -> bool| {
        run.reports().any(|(_, report)| wanted(&report))
    };
    assert!(has(|report| report.mode() == Mode::Disabled), "a mode change is in it");
    assert!(has(|report| report.contacts.iter().any(|contact| contact.controller)));
    assert!(has(|report| report.contacts.iter().any(|contact| !contact.controller)));
    assert!(has(|report| report.command_seq == 0) && has(|report| report.command_seq > 0));

    a_flipped_bit_is_found(&file, &bytes);
    a_cut_is_told(&file, &bytes);
    fs::write(&file, "no recording at all").unwrap();
    replay(&file).refused(&["run.hrec", "no recording of hapticd"]);
    assert!(rig.run(async { list(&mut rig.services().await).await }).is_empty(), "it was deleted");
}

fn a_flipped_bit_is_found(file: &Path, bytes: &[u8]) {
    let mut all = entries(bytes);
    let mut ticks = all.iter_mut().filter_map(|entry| match entry.entry.as_mut() {
        Some(Entry::Tick(tick)) => Some(tick),
        _ => None,
    });
    let tick = ticks.nth(1_000).unwrap();
    let (number, sample) = (tick.tick, tick.sample.as_mut().unwrap());
    sample.hand_plane_n[0] = f64::from_bits(sample.hand_plane_n[0].to_bits() ^ 1);
    let changed: Vec<u8> = all.iter().flat_map(Message::encode_length_delimited_to_vec).collect();
    fs::write(file, changed).unwrap();
    let finished = replay(file);
    finished.refused(&["differs"]);
    let difference = verdict(&finished)["difference"].clone();
    assert_eq!((&difference["tick"], &difference["field"]), (&number.into(), &"hand".into()));
}

fn a_cut_is_told(file: &Path, bytes: &[u8]) {
    fs::write(file, &bytes[..bytes.len() - 100]).unwrap();
    let cut = verdict(&replay(file).ok());
    assert!(cut["end"].as_str().unwrap().contains("cut short"), "{cut}");
    assert_eq!((&cut["bit_equal"], &cut["whole"]), (&true.into(), &false.into()));
}

async fn list(services: &mut Services) -> Vec<Recording> {
    let answer = services.recordings.list_recordings(ListRecordingsRequest {}).await;
    answer.unwrap().into_inner().recordings
}

fn start(seconds: f64) -> StartRecordingRequest {
    StartRecordingRequest { parent: DEVICE.to_owned(), seconds }
}

fn refused<T>(answer: Result<T, Status>, code: Code, words: &str) {
    let Err(status) = answer else { panic!("not refused") };
    assert_eq!(status.code(), code, "{status:?}");
    assert!(status.message().contains(words), "{status:?}");
}

#[test]
fn a_recording_has_its_life_on_the_server() {
    let rig = Rig::start();
    rig.run(async {
        let services = &mut rig.services().await;
        let client = &mut services.recordings.clone();
        for seconds in [0.0, -1.0, 601.0, f64::NAN] {
            refused(client.start_recording(start(seconds)).await, Code::InvalidArgument, "seconds");
        }
        let elsewhere = StartRecordingRequest { parent: "devices/other".into(), seconds: 1.0 };
        refused(client.start_recording(elsewhere).await, Code::NotFound, DEVICE);
        let name = client.start_recording(start(600.0)).await.unwrap().into_inner().name;
        let get = || GetRecordingRequest { name: name.clone() };
        while client.get_recording(get()).await.unwrap().into_inner().ticks < 50 {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        let download = || DownloadRecordingRequest { name: name.clone() };
        let delete = || DeleteRecordingRequest { name: name.clone() };
        let under_way = Code::FailedPrecondition;
        refused(client.download_recording(download()).await, under_way, "stop it first");
        refused(client.delete_recording(delete()).await, under_way, "stop it first");
        let stop = StopRecordingRequest { name: name.clone() };
        let stopped = client.stop_recording(stop).await.unwrap().into_inner();
        assert!(stopped.complete && stopped.ticks >= 50, "{stopped:?}");
        assert_eq!(list(services).await, std::slice::from_ref(&stopped));
        let mut pieces = client.download_recording(download()).await.unwrap().into_inner();
        let mut bytes = Vec::new();
        while let Some(piece) = pieces.message().await.unwrap() {
            bytes.extend(piece.data);
        }
        let run = Recorded::read(bytes).unwrap();
        let replayed = hapticd::recording::replay(&run);
        assert_eq!(replayed.equal, stopped.ticks, "{replayed:?}");
        client.delete_recording(delete()).await.unwrap();
        refused(client.get_recording(get()).await, Code::NotFound, &name["recordings/".len()..]);
        for name in ["recordings/../scene", "recordings/", "rubbish"] {
            let name = name.to_owned();
            let answer = client.delete_recording(DeleteRecordingRequest { name }).await;
            refused(answer, Code::NotFound, "recording");
        }
    });
}

#[test]
fn only_so_many_recordings_go_on_at_a_time_and_their_room_is_set_aside() {
    let rig = Rig::start();
    rig.run(async {
        let client = &mut rig.services().await.recordings;
        // Each may need more than a gigabyte, of four in all.
        client.start_recording(start(600.0)).await.unwrap();
        client.start_recording(start(600.0)).await.unwrap();
        refused(client.start_recording(start(600.0)).await, Code::ResourceExhausted, "delete");
        client.start_recording(start(60.0)).await.unwrap();
        client.start_recording(start(60.0)).await.unwrap();
        refused(client.start_recording(start(1.0)).await, Code::ResourceExhausted, "under way");
    });
}

#[test]
fn ctrl_c_keeps_what_came() {
    let rig = Rig::start();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("early.hrec");
    let mut command = hapticd();
    command.args(["record", "--seconds", "600", "--connect", &rig.target().to_string()]).arg(&file);
    let mut child = command.spawn().unwrap();
    wait_until("a recording of some ticks", || {
        rig.run(async { list(&mut rig.services().await).await }).iter().any(|r| r.ticks > 100)
    });
    send(&child, Signal::INT);
    assert!(super::support::wait(&mut child).success());
    let replayed = verdict(&replay(&file).ok());
    assert!(replayed["equal"].as_u64().unwrap() > 100, "{replayed}");
    let target = rig.target().to_string();
    let again = ["record", "--seconds", "1", "--connect", &target, file.to_str().unwrap()];
    run(&again).refused(&["early.hrec", "exists"]);
}

fn black_boxes(state: &Path) -> Vec<PathBuf> {
    let folder = fs::read_dir(state.join("devices/easily-late/black-box"));
    let files = folder.into_iter().flatten().map(|entry| entry.unwrap().path());
    files.filter(|path| path.extension().is_some_and(|end| end == "hrec")).collect()
}

#[test]
fn a_fault_leaves_a_black_box_that_can_be_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let usual = include_str!("../../devices/cho-2005.toml");
    assert!(usual.contains("max_overruns = 100"));
    let device = folder.path().join("easily-late.toml");
    fs::write(&device, usual.replace("max_overruns = 100", "max_overruns = 1")).unwrap();
    let state = folder.path().join("state");
    let server = Server::with(&state, &format!("device = {device:?}\n"));
    let patient = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let deadline = Instant::now() + PATIENCE;
    let good = |file: &PathBuf| {
        let told = verdict(&replay(file));
        told["bit_equal"] == true && told["cause"].as_str().unwrap().contains("fault overrun")
    };
    // A machine that is late by itself has its faults before there is a state to begin with.
    while !black_boxes(&state).iter().any(good) {
        assert!(Instant::now() < deadline, "{:?}", black_boxes(&state));
        patient.block_on(async {
            let mut services = services(&server.connect).await.unwrap();
            let name = || "devices/easily-late".to_owned();
            let _ = services.devices.clear_fault(ClearFaultRequest { name: name() }).await;
            let _ = services.devices.enable(EnableRequest { name: name() }).await;
        });
        std::thread::sleep(Duration::from_millis(100));
        server.stall(Duration::from_millis(50));
        std::thread::sleep(Duration::from_millis(500));
    }
}
