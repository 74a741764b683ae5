//! "Why do I feel nothing", asked of a real server in each case that has an answer.

use std::time::Duration;

use hapticd::client::{Client, Devices};
use hapticd::config::{BUILT_IN, ServerConfig};
use hapticd::proto::scene_object::Kind;
use hapticd::proto::{
    ConstantField, CreateObjectRequest, DisableRequest, ExplainRequest, Explanation, HalfSpace,
    Material, Reason, Role, SceneObject, Settings, Sphere, StopRequest, UpdateSettingsRequest,
    Vector3,
};
use prost_types::FieldMask;
use tonic::Code;

use super::support::{DEVICE, Rig, next_state, run};

/// A hand that stays at (0.285, 0.35) m.
fn holding(config: &mut ServerConfig) {
    config.devices[0].hand = "hold".parse().unwrap();
}

/// A hand that goes round and round.
fn circling(config: &mut ServerConfig) {
    config.devices[0].hand = "circle".parse().unwrap();
}

fn vector(x: f64, y: f64, z: f64) -> Option<Vector3> {
    Some(Vector3 { x, y, z })
}

/// Felt from smaller x.
fn wall(x_m: f64) -> SceneObject {
    surface(Kind::HalfSpace(HalfSpace {
        point_m: vector(x_m, 0.0, 0.0),
        normal: vector(-1.0, 0.0, 0.0),
    }))
}

fn sphere(x_m: f64) -> SceneObject {
    surface(Kind::Sphere(Sphere { centre_m: vector(x_m, 0.0, 0.0), radius_m: 0.05 }))
}

fn surface(kind: Kind) -> SceneObject {
    let material = Some(Material { stiffness_n_per_m: 1e4, ..Material::default() });
    SceneObject { kind: Some(kind), material, ..SceneObject::default() }
}

fn field(x_N: f64, z_N: f64) -> SceneObject {
    let kind = Some(Kind::Constant(ConstantField { force_n: vector(x_N, 0.0, z_N) }));
    SceneObject { kind, ..SceneObject::default() }
}

async fn put(rig: &Rig, object: SceneObject) {
    let request = CreateObjectRequest {
        parent: format!("{DEVICE}/scene"),
        object_id: "thing".into(),
        object: Some(object),
        scene_revision: 0,
    };
    rig.services().await.scenes.create_object(request).await.unwrap();
}

async fn set(devices: &mut Devices, path: &str, settings: Settings) {
    let request = UpdateSettingsRequest {
        settings: Some(Settings { name: DEVICE.into(), ..settings }),
        update_mask: Some(FieldMask { paths: vec![path.into()] }),
    };
    devices.update_settings(request).await.unwrap();
}

fn question() -> ExplainRequest {
    ExplainRequest { name: DEVICE.into(), ..ExplainRequest::default() }
}

async fn told(devices: &mut Devices) -> Explanation {
    devices.explain(question()).await.unwrap().into_inner()
}

/// Expects this reason first, and that its sentence says all this.
async fn first(devices: &mut Devices, reason: Reason, words: &[&str]) -> Explanation {
    let told = told(devices).await;
    assert_eq!(told.reasons.first().map(|first| first.reason()), Some(reason), "{told:?}");
    for word in words {
        assert!(told.summary.contains(word), "{word:?} is not in {:?}", told.summary);
    }
    told
}

/// Asks until this reason is there: the handle moves.
async fn until(devices: &mut Devices, reason: Reason) -> Explanation {
    loop {
        let told = told(devices).await;
        if told.reasons.iter().any(|found| found.reason() == reason) {
            return told;
        }
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
}

#[test]
fn an_empty_scene_a_disabled_and_a_stopped_device() {
    let rig = Rig::with(holding);
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let empty = first(&mut devices, Reason::NoScene, &["Nothing is felt", "no object"]).await;
        let links: Vec<_> = empty.chain.iter().map(|link| link.name.as_str()).collect();
        assert_eq!(links, ["mode", "world", "command", "asked", "wanted", "limits", "law", "felt"]);
        put(&rig, wall(0.5)).await;
        devices.disable(DisableRequest { name: DEVICE.into() }).await.unwrap();
        first(&mut devices, Reason::Disabled, &["disabled: Enable it"]).await;
        devices.stop(StopRequest { name: DEVICE.into() }).await.unwrap();
        first(&mut devices, Reason::Stopped, &["stopped", "Disable, then Enable"]).await;
    });
}

#[test]
fn a_fault() {
    let (_, text) = BUILT_IN.into_iter().find(|(name, _)| *name == "cho-2005").unwrap();
    let coarse = text
        .replace("counts_per_revolution = 65536", "counts_per_revolution = 16")
        .replace("closure_limit_rad = 0.2", "closure_limit_rad = 0.0001");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cho-2005.toml");
    std::fs::write(&file, coarse).unwrap();
    let rig = Rig::with(|config| config.devices[0].source = file.display().to_string());
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let told = until(&mut devices, Reason::Fault).await;
        assert!(told.summary.contains("in fault (closure)"), "{}", told.summary);
    });
}

#[test]
fn nothing_touched_out_of_range_and_given_away() {
    for (object, reason, words) in [
        (wall(0.4), Reason::NothingTouched, ["touches nothing", "thing is 115.0 mm away"]),
        (wall(0.2), Reason::GivenAway, ["inside thing", "move out and come back"]),
        (sphere(5.0), Reason::OutOfReach, ["Out of range", "thing is 4."]),
    ] {
        let rig = Rig::with(holding);
        rig.run(async {
            let mut devices = rig.services().await.devices;
            put(&rig, object).await;
            let told = first(&mut devices, reason, &["Nothing is felt"]).await;
            let near = told.summary.replace("0.115 m", "115.0 mm");
            assert!(words.iter().all(|word| near.contains(word)), "{near}");
        });
    }
}

#[test]
fn a_force_limit_the_range_of_the_device_a_gain_and_a_direction_it_does_not_have() {
    let rig = Rig::with(holding);
    rig.run(async {
        let mut devices = rig.services().await.devices;
        put(&rig, field(900.0, 0.0)).await;
        first(&mut devices, Reason::DeviceRange, &["900.0 N are asked", "has here"]).await;
        let limit = Settings { force_limit_n: 3.0, ..Settings::default() };
        set(&mut devices, "force_limit_n", limit).await;
        first(&mut devices, Reason::ForceLimit, &["force limit of 3.0 N"]).await;
        set(&mut devices, "force_gain", Settings::default()).await;
        first(&mut devices, Reason::NoGain, &["gain is set to 0"]).await;
    });
    let rig = Rig::with(holding);
    rig.run(async {
        let mut devices = rig.services().await.devices;
        put(&rig, field(0.0, 5.0)).await;
        first(&mut devices, Reason::OutsideFreedoms, &["no freedom"]).await;
    });
}

#[test]
fn a_direction_that_brakes_cannot_push_and_a_torque_limit() {
    let rig = Rig::with(circling);
    rig.run(async {
        let mut devices = rig.services().await.devices;
        put(&rig, field(900.0, 0.0)).await;
        let told = until(&mut devices, Reason::NotDisplayable).await;
        assert!(told.reasons.iter().any(|r| r.text.contains("brakes would have to push")));
        until(&mut devices, Reason::TorqueLimit).await;
    });
}

/// Commands until `done` says so.
async fn command(client: &mut Client, mut send: impl FnMut(&mut Client, u64)) {
    for _ in 0..50 {
        let state = next_state(client).await;
        send(client, state.seq);
    }
}

#[test]
fn a_clutch_and_a_controller_that_fell_silent() {
    let rig = Rig::with(holding);
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let mut controller = rig.client("controller", Role::Controller).await;
        command(&mut controller, |client, seq| {
            client.send_clutched(seq, 1_000).unwrap();
        })
        .await;
        first(&mut devices, Reason::Clutched, &["clutched"]).await;
        command(&mut controller, |client, seq| {
            client.send_contacts(seq, 100, Vec::new()).unwrap();
        })
        .await;
        first(&mut devices, Reason::NothingTouched, &["asks nothing here"]).await;
        // Now it says nothing any more.
        let stale = until(&mut devices, Reason::Stale).await;
        assert!(stale.summary.contains("ran out"), "{}", stale.summary);
        tokio::time::sleep(Duration::from_millis(200)).await;
        first(&mut devices, Reason::Stale, &["ran out", "none came since"]).await;
    });
}

#[test]
fn an_observer_is_told_that_it_only_observes() {
    let rig = Rig::with(holding);
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let _observer = rig.client("observer", Role::Observer).await;
        let as_observer = ExplainRequest { role: Role::Observer.into(), ..question() };
        let told = devices.explain(as_observer).await.unwrap().into_inner();
        assert_eq!(told.reasons[0].reason(), Reason::Observer, "{told:?}");
        assert!(told.summary.contains("only observes"), "{}", told.summary);
        for wrong in [
            (ExplainRequest { role: 99, ..question() }, Code::InvalidArgument, "role = 99"),
            (
                ExplainRequest { name: "devices/x".into(), ..question() },
                Code::NotFound,
                "devices/x",
            ),
        ] {
            let status = devices.explain(wrong.0).await.unwrap_err();
            assert_eq!(status.code(), wrong.1);
            assert!(status.message().contains(wrong.2), "{status}");
        }
    });
}

#[test]
fn the_command_explains_in_words_and_in_json() {
    let rig = Rig::with(holding);
    let connect = rig.target().to_string();
    let words = run(&["explain", "--connect", &connect]).ok().stdout;
    assert!(words.contains("devices/cho-2005, tick ") && words.contains("no object"), "{words}");
    assert!(words.contains("  law      0.00 N"), "{words}");
    let json = run(&["explain", "--as", "observer", "--json", "--connect", &connect]).ok().stdout;
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["reasons"][0]["reason"], "observer");
    assert_eq!(json["chain"].as_array().unwrap().len(), 8);
    run(&["explain", "--as", "king", "--connect", &connect]).refused(&["king", "observer"]);
}
