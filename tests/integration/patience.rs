//! Nobody can keep the others waiting: not by asking much, nor by saying, reading or taking
//! nothing.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::process::{Child, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use hapticd::client::{Client, ClientError, ConnectString, Options};
use hapticd::proto::scene_object::Kind;
use hapticd::proto::{
    ConstantField, CreateObjectRequest, DisableRequest, EnableRequest, GetStateRequest, Mode, Role,
    SceneObject, StopRequest, UpdateObjectRequest, Vector3, WatchStateRequest,
};
use rustix::process::Signal;
use tonic::Code;

use super::support::{
    DEVICE, PATIENCE, Rig, config_file, finish, first_line, hapticd, http_get, next_state, run,
    send, wait, wait_until,
};

/// Edits that wait for the disk, one after the other.
const FLOOD: usize = 600;

/// A child that ends with the test.
struct Ends(Child);

impl Drop for Ends {
    fn drop(&mut self) {
        // Both fail when it has ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn push(y_N: f64) -> SceneObject {
    let force_n = Some(Vector3 { x: 0.0, y: y_N, z: 0.0 });
    SceneObject {
        name: format!("{DEVICE}/scene/objects/push"),
        kind: Some(Kind::Constant(ConstantField { force_n })),
        ..SceneObject::default()
    }
}

fn create_push() -> CreateObjectRequest {
    CreateObjectRequest {
        parent: format!("{DEVICE}/scene"),
        object_id: "push".into(),
        object: Some(push(0.0)),
        scene_revision: 0,
    }
}

#[test]
fn a_stop_does_not_wait_for_the_edits_before_it() {
    let rig = Rig::start();
    let edited = Arc::new(AtomicUsize::new(0));
    rig.run(async {
        let services = rig.services().await;
        services.scenes.clone().create_object(create_push()).await.unwrap();
        let edits: Vec<_> = (0..FLOOD)
            .map(|_| {
                let (mut scenes, edited) = (services.scenes.clone(), Arc::clone(&edited));
                rig.spawn(async move {
                    let object = Some(push(1.0));
                    let request = UpdateObjectRequest { object, scene_revision: 0 };
                    // One that is not answered in time is done all the same.
                    let _ = scenes.update_object(request).await;
                    edited.fetch_add(1, Ordering::SeqCst);
                })
            })
            .collect();
        while edited.load(Ordering::SeqCst) == 0 {
            tokio::task::yield_now().await;
        }
        let mut devices = rig.services().await.devices;
        let stopped = devices.stop(StopRequest { name: DEVICE.into() }).await.unwrap();
        let before = edited.load(Ordering::SeqCst);
        assert_eq!(stopped.get_ref().mode(), Mode::Stopped);
        assert!(before < FLOOD / 2, "{before} of {FLOOD} edits came first");
        println!("{before} of {FLOOD} edits came before the stop");
        for edit in edits {
            edit.abort();
        }
    });
}

#[test]
fn a_state_is_never_older_than_what_was_acknowledged() {
    let rig = Rig::start();
    rig.run(async {
        let services = rig.services().await;
        let (mut devices, mut scenes) = (services.devices, services.scenes);
        let name = || DEVICE.to_owned();
        scenes.create_object(create_push()).await.unwrap();
        for round in 0..25 {
            devices.disable(DisableRequest { name: name() }).await.unwrap();
            let state = devices.get_state(GetStateRequest { name: name() }).await.unwrap();
            assert_eq!(state.get_ref().mode(), Mode::Disabled, "round {round}");
            devices.enable(EnableRequest { name: name() }).await.unwrap();
            let watch = WatchStateRequest { name: name(), interval_ms: 10_000 };
            let mut states = devices.watch_state(watch).await.unwrap().into_inner();
            let state = states.message().await.unwrap().unwrap();
            assert_eq!(state.mode(), Mode::Enabled, "round {round}");
            let request = UpdateObjectRequest { object: Some(push(1.0)), scene_revision: 0 };
            let revision = scenes.update_object(request).await.unwrap().get_ref().revision;
            let state = devices.get_state(GetStateRequest { name: name() }).await.unwrap();
            assert_eq!(state.get_ref().scene_revision, revision, "round {round}");
        }
    });
}

#[test]
fn one_watch_too_many_is_refused_and_room_comes_back() {
    let rig = Rig::start();
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let watch = || WatchStateRequest { name: DEVICE.into(), interval_ms: 10_000 };
        let mut open = Vec::new();
        let refused = loop {
            match devices.watch_state(watch()).await {
                Ok(states) => open.push(states),
                Err(status) => break status,
            }
            assert!(open.len() < 1000, "there is no bound");
        };
        assert_eq!(refused.code(), Code::ResourceExhausted, "{refused}");
        open.clear();
        while devices.watch_state(watch()).await.is_err() {
            tokio::task::yield_now().await;
        }
    });
}

#[test]
fn connections_that_say_nothing_keep_nobody_out_and_are_let_go() {
    let rig = Rig::start();
    let grpc: SocketAddr = rig.target().grpc_authority().parse().unwrap();
    let mut idle = Vec::new();
    for address in [grpc, rig.daemon().http_address] {
        for _ in 0..140 {
            idle.push(TcpStream::connect(address).unwrap());
        }
    }
    let target = rig.target().to_string();
    run(&["ctl", "--connect", &target, "stop"]).ok();
    assert_eq!(http_get(rig.daemon().http_address, "/healthz").0, 200);
    for mut stream in idle {
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        // To the end: HTTP/2 sends its settings first. A reset is an end, too.
        let ended = stream.read_to_end(&mut Vec::new());
        let waiting = ended.is_err_and(|error| error.kind() == std::io::ErrorKind::WouldBlock);
        assert!(!waiting, "it is still open");
    }
}

#[test]
fn a_server_that_accepts_and_says_nothing_is_given_up() {
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = silent.local_addr().unwrap().port();
    let target = format!("hapticd://127.0.0.1:1/?grpc={port}");
    let ended = run(&["ctl", "--connect", &target, "stop"]);
    ended.refused(&["the server did not answer within"]);
}

#[test]
fn services_of_another_machine_are_not_talked_to_without_its_hash() {
    let ended = run(&["ctl", "--connect", "192.0.2.1:7351", "stop"]);
    ended.refused(&["192.0.2.1 is not this machine", "sha256="]);
}

#[test]
fn a_log_that_nobody_reads_stops_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (reader, mut writer) = std::io::pipe().unwrap();
    let stderr = writer.try_clone().unwrap();
    // Full to the brim: the first line that is logged has no room.
    std::thread::spawn(move || while writer.write_all(&[0; 4096]).is_ok() {});
    let mut command = hapticd();
    command.env("HAPTICD_LOG", "hapticd=debug").args(["serve", "--config"]);
    command.arg(config_file(&folder.path().join("state"), ""));
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(stderr);
    let mut server = Ends(command.spawn().unwrap());
    // Its ends of the pipe go, so that only the server's is left.
    drop(command);
    let connect = first_line(server.0.stdout.take().unwrap()).expect("where it is");
    let connect: ConnectString = connect.trim_end().parse().unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        // More lines than the queue of the log holds.
        for number in 0..300 {
            let options = Options::new(format!("number {number}"), Role::Observer);
            let answered = async {
                let mut client = Client::connect(&connect, options).await?;
                client.next().await?;
                client.close().await;
                Ok::<_, ClientError>(())
            };
            tokio::time::timeout(PATIENCE, answered).await.expect("it hangs").unwrap();
        }
    });
    send(&server.0, Signal::TERM);
    assert_eq!(wait(&mut server.0).code(), Some(0));
    drop(reader);
}

#[test]
fn a_reader_that_has_read_enough_ends_a_watch_and_not_a_server() {
    let rig = Rig::start();
    let target = rig.target().to_string();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut watch = hapticd();
    watch.args(["ctl", "--connect", &target, "state", "--watch", "--interval", "10"]);
    let mut watch = Ends(watch.stdout(writer).stderr(Stdio::null()).spawn().unwrap());
    assert_eq!(wait(&mut watch.0).code(), Some(0));

    let folder = tempfile::tempdir().unwrap();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut serve = hapticd();
    serve.args(["serve", "--config"]).arg(config_file(&folder.path().join("state"), ""));
    let serve = serve.stdout(writer).stderr(Stdio::piped());
    let mut serve = Ends(serve.spawn().unwrap());
    let (said, lines) = std::sync::mpsc::channel();
    let mut stderr = serve.0.stderr.take().unwrap();
    std::thread::spawn(move || {
        let mut bytes = [0; 4096];
        while let Ok(count @ 1..) = stderr.read(&mut bytes) {
            let _ = said.send(String::from_utf8_lossy(&bytes[..count]).into_owned());
        }
    });
    let mut log = String::new();
    while !log.contains("Ctrl-C stops") {
        log += &lines.recv_timeout(PATIENCE).unwrap_or_else(|_| panic!("not serving: {log}"));
    }
    send(&serve.0, Signal::TERM);
    assert_eq!(wait(&mut serve.0).code(), Some(0));
    log.extend(lines.iter());
    assert!(log.contains("stopping"), "the last line is not lost: {log}");
}

#[test]
fn a_demo_hears_the_first_signal() {
    for signal in [Signal::TERM, Signal::INT] {
        let mut demo = hapticd();
        demo.args(["demo", "wall", "--json"]);
        demo.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut demo = Ends(demo.spawn().unwrap());
        // It says first where it is, and hears signals from before then.
        assert!(first_line(demo.0.stderr.take().unwrap()).unwrap().starts_with("stream   hapticd"));
        send(&demo.0, signal);
        let mut figures = String::new();
        assert_eq!(wait(&mut demo.0).code(), Some(0));
        demo.0.stdout.take().unwrap().read_to_string(&mut figures).unwrap();
        assert!(figures.starts_with("{\"ticks\":"), "{figures}");
    }
}

#[test]
fn a_scene_ends_while_it_connects_and_says_why_when_it_is_sent_away() {
    // Nobody answers here, and nobody says so either.
    let silent = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let target = silent.local_addr().unwrap().to_string();
    let mut scene = hapticd();
    scene.args(["scene", "wall", "--connect", &target]).stderr(Stdio::piped());
    let mut scene = Ends(scene.spawn().unwrap());
    silent.set_read_timeout(Some(PATIENCE)).unwrap();
    silent.recv_from(&mut [0; 2048]).unwrap();
    send(&scene.0, Signal::INT);
    let status = wait(&mut scene.0);
    let mut said = String::new();
    scene.0.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!(
        (status.code(), said.contains("before it was connected")),
        (Some(0), true),
        "{said}"
    );

    let rig = Rig::start();
    let mut scene = hapticd();
    scene.args(["scene", "wall", "--connect", &rig.target().to_string()]).stderr(Stdio::piped());
    let mut scene = Ends(scene.spawn().unwrap());
    let controllers =
        "hapticd_sessions{device=\"cho-2005\",role=\"controller\",transport=\"quic\"}";
    wait_until("its session", || rig.scrape().value(controllers) == 1.0);
    send(&scene.0, Signal::STOP);
    wait_until("its end by silence", || rig.scrape().value(controllers) == 0.0);
    send(&scene.0, Signal::CONT);
    let status = wait(&mut scene.0);
    let mut said = String::new();
    scene.0.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!(status.code(), Some(1), "{said}");
    assert!(said.contains("BYE_REASON_SILENT") || said.contains("was lost"), "{said}");
}

#[test]
fn an_address_that_is_not_this_machines_is_blamed_and_not_a_port() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let mut command = hapticd();
    command.args(["serve", "--listen", "192.0.2.1", "--insecure", "--state-dir"]).arg(&state);
    finish(&mut command).refused(&["server.listen = 192.0.2.1", "no such address"]);
}

#[test]
fn what_listens_everywhere_prints_where_it_is_reached() {
    let rig = Rig::with(|config| {
        config.listen = std::net::Ipv4Addr::UNSPECIFIED.into();
        config.insecure = true;
    });
    let target = rig.target();
    assert_ne!(target.host, "0.0.0.0");
    let client = async {
        let mut client = Client::connect(target, Options::new("far", Role::Observer)).await?;
        next_state(&mut client).await;
        client.close().await;
        Ok::<_, ClientError>(())
    };
    rig.run(client).unwrap();
    wait_until("its end", || {
        let sessions = "hapticd_sessions{device=\"cho-2005\",role=\"observer\",transport=\"quic\"}";
        rig.scrape().value(sessions) == 0.0
    });
}
