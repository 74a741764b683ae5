//! The services over real gRPC: the device's switch, and a scene that is felt.

use hapticd::config::BUILT_IN;
use hapticd::proto::scene_object::Kind;
use hapticd::proto::{
    ClearFaultRequest, ConstantField, CreateObjectRequest, DeleteObjectRequest, DisableRequest,
    EnableRequest, Fault, GetDescriptionRequest, GetObjectRequest, GetStateRequest, HalfSpace,
    ListDevicesRequest, ListObjectsRequest, Material, Mode, Role, SceneObject, StopRequest,
    Strategy, UpdateObjectRequest, Vector3, WatchStateRequest,
};
use tonic::{Code, Status};

use super::support::{DEVICE, Rig, next_state, state_where, wait_until};

/// Ids in State of objects of the resident scene begin here.
const SCENE_ID: u32 = 1 << 31;

fn scene() -> String {
    format!("{DEVICE}/scene")
}

fn object_name(id: &str) -> String {
    format!("{DEVICE}/scene/objects/{id}")
}

/// The experiment's wall at `x_m`.
fn wall(x_m: f64) -> SceneObject {
    let point_m = Some(Vector3 { x: x_m, y: 0.0, z: 0.0 });
    let normal = Some(Vector3 { x: -1.0, y: 0.0, z: 0.0 });
    SceneObject {
        kind: Some(Kind::HalfSpace(HalfSpace { point_m, normal })),
        material: Some(Material { stiffness_n_per_m: 1e7, ..Material::default() }),
        ..SceneObject::default()
    }
}

/// A force of `y_N` along y, everywhere.
fn push(y_N: f64) -> SceneObject {
    let force_n = Some(Vector3 { x: 0.0, y: y_N, z: 0.0 });
    SceneObject { kind: Some(Kind::Constant(ConstantField { force_n })), ..SceneObject::default() }
}

fn create(id: &str, object: SceneObject) -> CreateObjectRequest {
    CreateObjectRequest {
        parent: scene(),
        object_id: id.into(),
        object: Some(object),
        scene_revision: 0,
    }
}

fn update(id: &str, object: SceneObject) -> UpdateObjectRequest {
    let object = SceneObject { name: object_name(id), ..object };
    UpdateObjectRequest { object: Some(object), scene_revision: 0 }
}

fn delete(id: &str) -> DeleteObjectRequest {
    DeleteObjectRequest { name: object_name(id), scene_revision: 0 }
}

fn expect<T: std::fmt::Debug>(answer: Result<T, Status>, code: Code, words: &[&str]) {
    let status = answer.unwrap_err();
    assert_eq!(status.code(), code, "{status}");
    for word in words {
        assert!(status.message().contains(word), "{word:?} is not in {:?}", status.message());
    }
}

#[test]
fn a_device_is_listed_described_and_watched() {
    let rig = Rig::start();
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let listed =
            devices.list_devices(ListDevicesRequest {}).await.unwrap().into_inner().devices;
        let [only] = listed.as_slice() else { panic!("{listed:?}") };
        assert_eq!(
            (only.name.as_str(), only.simulated, only.mechanism.as_str()),
            (DEVICE, true, "five-bar")
        );

        let described = devices.get_description(GetDescriptionRequest { name: DEVICE.into() });
        let described = described.await.unwrap().into_inner();
        assert_eq!((described.actuated_freedoms, described.actuators.len()), (2, 4));
        assert_eq!((described.tick_period_s, described.handle_mass_kg), (1e-3, 0.5));
        assert!(described.hand_force_sensor && described.force_limit_n == 1000.0);
        assert_eq!(described.parameters["k3"], 0.781);
        assert!(described.actuators.iter().all(|brake| brake.max_torque_nm == 20.0));

        let state = devices.get_state(GetStateRequest { name: DEVICE.into() }).await.unwrap();
        assert_eq!(state.get_ref().actuators.len(), 4);
        assert!(state.get_ref().measured_cf.is_some());

        let watch = WatchStateRequest { name: DEVICE.into(), interval_ms: 20 };
        let mut watched = devices.watch_state(watch).await.unwrap().into_inner();
        let mut ticks = Vec::new();
        while ticks.len() < 5 {
            ticks.push(watched.message().await.unwrap().unwrap().tick);
        }
        assert!(ticks.is_sorted() && ticks[0] < ticks[4], "{ticks:?}");

        let watch = WatchStateRequest { name: DEVICE.into(), interval_ms: 10_001 };
        let refused = devices.watch_state(watch).await;
        expect(refused.map(drop), Code::InvalidArgument, &["interval_ms = 10001", "1 to 10000 ms"]);
        let other = devices.get_state(GetStateRequest { name: "devices/other".into() }).await;
        expect(other, Code::NotFound, &["name = \"devices/other\"", DEVICE]);
    });
}

#[test]
fn a_device_is_switched_by_the_rules_of_its_modes() {
    let rig = Rig::start();
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let name = || DEVICE.to_owned();
        let mode = |answer: tonic::Response<hapticd::proto::DeviceMode>| answer.get_ref().mode();
        let clear = devices.clear_fault(ClearFaultRequest { name: name() }).await;
        expect(clear, Code::FailedPrecondition, &["ClearFault", "Enabled", "there is no fault"]);
        let enable = devices.enable(EnableRequest { name: name() }).await;
        assert_eq!(enable.map(mode).unwrap(), Mode::Enabled, "asking again is no error");
        let stop = devices.stop(StopRequest { name: name() }).await;
        assert_eq!(stop.map(mode).unwrap(), Mode::Stopped);
        let enable = devices.enable(EnableRequest { name: name() }).await;
        expect(
            enable,
            Code::FailedPrecondition,
            &["Enable", "Stopped", "disable the device first"],
        );
        let disable = devices.disable(DisableRequest { name: name() }).await;
        assert_eq!(disable.map(mode).unwrap(), Mode::Disabled);

        // The mode is that of the loop, and what is disabled renders nothing.
        let mut observer = rig.client("observer", Role::Observer).await;
        let field = rig.services().await.scenes.create_object(create("push", push(5.0))).await;
        let revision = field.unwrap().into_inner().revision;
        let state = state_where(&mut observer, |state| state.scene_revision == revision).await;
        assert_eq!((state.mode(), state.law()), (Mode::Disabled, Strategy::Unspecified));
        assert_eq!(
            (state.requested.as_slice(), state.achievable.as_slice()),
            (&[0.0, 5.0, 0.0][..], &[0.0; 3][..])
        );
        let enable = devices.enable(EnableRequest { name: name() }).await;
        assert_eq!(enable.map(mode).unwrap(), Mode::Enabled);
        state_where(&mut observer, |state| state.mode() == Mode::Enabled).await;

        let other = devices.stop(StopRequest { name: "devices/other".into() }).await;
        expect(other, Code::NotFound, &["devices/other"]);
    });
}

#[test]
fn a_fault_latches_until_it_is_cleared_and_comes_back_with_its_cause() {
    // Encoders of 16 counts cannot agree on a closed loop to a ten-thousandth of a radian.
    let (_, text) = BUILT_IN.into_iter().find(|(name, _)| *name == "cho-2005").unwrap();
    let coarse = text
        .replace("counts_per_revolution = 65536", "counts_per_revolution = 16")
        .replace("closure_limit_rad = 0.2", "closure_limit_rad = 0.0001");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("coarse.toml");
    std::fs::write(&file, coarse).unwrap();
    let rig = Rig::with(|config| config.devices[0].source = file.display().to_string());
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let name = || "devices/coarse".to_owned();
        let mut state = None;
        while state
            .as_ref()
            .is_none_or(|state: &hapticd::proto::DeviceState| state.mode() != Mode::Fault)
        {
            state = Some(
                devices.get_state(GetStateRequest { name: name() }).await.unwrap().into_inner(),
            );
        }
        assert_eq!(state.unwrap().fault(), Fault::Closure);
        let enable = devices.enable(EnableRequest { name: name() }).await;
        expect(enable, Code::FailedPrecondition, &["Enable", "Fault", "clear the fault first"]);
        let stop = devices.stop(StopRequest { name: name() }).await;
        expect(stop, Code::FailedPrecondition, &["Stop", "clear the fault first"]);
        let cleared = devices.clear_fault(ClearFaultRequest { name: name() }).await.unwrap();
        assert_eq!(cleared.get_ref().mode(), Mode::Disabled);
        let faults = "hapticd_faults_total{device=\"coarse\",fault=\"closure\"}";
        wait_until("the fault again", || rig.scrape().value(faults) >= 2.0);
        let mut observer = rig.client("observer", Role::Observer).await;
        state_where(&mut observer, |state| state.mode() == Mode::Fault).await;
    });
}

#[test]
fn a_resident_wall_is_felt_moved_and_gone() {
    let rig = Rig::start();
    rig.run(async {
        let mut scenes = rig.services().await.scenes;
        let mut devices = rig.services().await.devices;
        let mut observer = rig.client("hand", Role::Observer).await;
        let made = scenes.create_object(create("table", wall(0.3))).await.unwrap().into_inner();
        assert_eq!((made.name.clone(), made.revision), (object_name("table"), 2));
        let state = state_where(&mut observer, |state| state.contact_id == [SCENE_ID]).await;
        let asked_N = state.requested[0];
        assert!((asked_N / (-1e7 * state.contact_depth_m[0]) - 1.0).abs() < 1e-3, "{asked_N}");
        assert!(state.position_m[0] > 0.3 - 1e-6 && state.scene_revision == 2);

        let got = scenes.get_object(GetObjectRequest { name: object_name("table") }).await.unwrap();
        assert_eq!(got.get_ref(), &made);
        let listed = scenes.list_objects(ListObjectsRequest { parent: scene() }).await.unwrap();
        assert_eq!(
            (listed.get_ref().objects.as_slice(), listed.get_ref().scene_revision),
            (&[made][..], 2)
        );
        // The device's own account names the object.
        loop {
            let state = devices.get_state(GetStateRequest { name: DEVICE.into() }).await.unwrap();
            if let [contact] = state.get_ref().contacts.as_slice() {
                assert_eq!(contact.name, object_name("table"));
                break;
            }
        }

        let moved = scenes.update_object(update("table", wall(0.5))).await.unwrap().into_inner();
        assert_eq!(moved.revision, 3);
        let state = state_where(&mut observer, |state| state.scene_revision == 3).await;
        assert!(state.contact_id.is_empty() && state.requested == [0.0; 3], "{state:?}");
        let gone = scenes.delete_object(delete("table")).await.unwrap().into_inner();
        assert_eq!(gone.scene_revision, 4);
        let missing = scenes.get_object(GetObjectRequest { name: object_name("table") }).await;
        expect(missing, Code::NotFound, &["\"table\""]);
    });
}

#[test]
fn what_is_acknowledged_is_in_force_within_two_ticks() {
    let rig = Rig::start();
    rig.run(async {
        let mut scenes = rig.services().await.scenes;
        let mut observer = rig.client("observer", Role::Observer).await;
        scenes.create_object(create("push", push(0.0))).await.unwrap();
        for round in 1..=20 {
            let y_N = f64::from(round);
            let request = update("push", push(y_N));
            let updated = scenes.update_object(request).await.unwrap().into_inner();
            // The device's clock is this machine's.
            let acknowledged_ns = hapticd::clock::now_ns();
            let mut ticks = 0;
            let state = loop {
                let state = next_state(&mut observer).await;
                ticks += u32::from(state.device_time_ns > acknowledged_ns);
                if ticks == 2 {
                    break state;
                }
            };
            assert_eq!(state.scene_revision, updated.revision);
            assert_eq!(state.requested, [0.0, y_N as f32, 0.0]);
        }
    });
}
