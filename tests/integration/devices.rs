//! Several devices in one server: each with its own loop, scene, lease and labels.

use hapticd::client::{Client, ClientError, Options};
use hapticd::config::{ServedDevice, ServerConfig};
use hapticd::device::HandProgram;
use hapticd::proto::{
    ByeReason, DisableRequest, EnableRequest, GetSceneRequest, ListDevicesRequest, Mode, Role,
};

use super::support::{Rig, command_until, finish, hapticd, next_state, run, state_where, wall_at};

fn two(config: &mut ServerConfig) {
    let device = |id: &str, source: &str| {
        let text = format!("[[devices]]\nname = {id:?}\ndevice = {source:?}\n");
        ServerConfig::from_toml(&text, "test").unwrap().devices.remove(0)
    };
    let right = ServedDevice { hand: HandProgram::Hold, ..device("right", "two-link") };
    config.devices = vec![device("left", "cho-2005"), right];
}

async fn client(rig: &Rig, device: &str, role: Role) -> Result<Client, ClientError> {
    let options = Options { device: format!("devices/{device}"), ..Options::new("test", role) };
    Client::connect(rig.target(), options).await
}

#[test]
fn two_devices_are_felt_controlled_and_switched_apart() {
    let rig = Rig::with(two);
    rig.run(async {
        let mut left = client(&rig, "left", Role::Controller).await.unwrap();
        let mut right = client(&rig, "right", Role::Controller).await.unwrap();
        assert_eq!((left.welcome().actuators, right.welcome().actuators), (4, 2));
        command_until(&mut left, &[wall_at(0.29)], |state| state.contact_id == [1]).await;
        // What is commanded to one is nothing to the other.
        let state = next_state(&mut right).await;
        assert_eq!((state.command_seq, state.contact_id.len()), (0, 0));

        let mut services = rig.services().await;
        let name = || "devices/right".to_owned();
        services.devices.disable(DisableRequest { name: name() }).await.unwrap();
        state_where(&mut right, |state| state.mode() == Mode::Disabled).await;
        assert_eq!(next_state(&mut left).await.mode(), Mode::Enabled);
        services.devices.enable(EnableRequest { name: name() }).await.unwrap();
        state_where(&mut right, |state| state.mode() == Mode::Enabled).await;

        let listed = services.devices.list_devices(ListDevicesRequest {}).await.unwrap();
        let names: Vec<_> = listed.into_inner().devices.into_iter().map(|d| d.name).collect();
        assert_eq!(names, ["devices/left", "devices/right"]);
        let metrics = rig.scrape();
        for device in ["left", "right"] {
            let of = |name: &str| format!("hapticd_{name}{{device=\"{device}\"");
            assert!(metrics.value(&format!("{}}}", of("loop_ticks_total"))) > 0.0);
            let controllers = ",role=\"controller\",transport=\"quic\"}";
            assert_eq!(metrics.value(&(of("sessions") + controllers)), 1.0);
        }
    });
}

#[test]
fn who_does_not_say_which_device_is_told_which_there_are() {
    let rig = Rig::with(two);
    rig.run(async {
        let refused = Client::connect(rig.target(), Options::new("test", Role::Observer)).await;
        let Err(ClientError::Bye { reason, detail }) = refused else { panic!("{refused:?}") };
        assert_eq!(reason, ByeReason::UnknownDevice);
        assert!(detail.contains("devices/left or devices/right"), "{detail}");
    });
    let connect = rig.target().to_string();
    let refused = run(&["ctl", "state", "--connect", &connect]);
    refused.refused(&["several devices", "--device", "left", "right"]);
    let refused = run(&["scene", "wall", "--connect", &connect, "--seconds", "1"]);
    refused.refused(&["devices/left or devices/right"]);
    run(&["scene", "wall", "--connect", &connect, "--device", "left", "--seconds", "0.3"]).ok();
    run(&["ping", &connect, "--device", "right", "--seconds", "0.3"]).ok();
    let unknown = run(&["ctl", "stop", "--connect", &connect, "--device", "middle"]);
    unknown.refused(&["devices/middle", "devices/left, devices/right"]);
}

#[test]
fn each_device_keeps_a_scene_of_its_own() {
    let rig = Rig::with(two);
    let connect = rig.target().to_string();
    let add = ["ctl", "wall", "add", "table", "--point", "0,0.4,0", "--normal=0,-1,0"];
    run(&[&add[..], &["--connect", &connect, "--device", "right"]].concat()).ok();
    rig.run(async {
        let mut scenes = rig.services().await.scenes;
        for (device, objects) in [("left", 0), ("right", 1)] {
            let name = format!("devices/{device}/scene");
            let scene = scenes.get_scene(GetSceneRequest { name }).await.unwrap().into_inner();
            assert_eq!(scene.objects.len(), objects, "{device}");
        }
    });
    let kept = |device: &str| rig.state_dir().join(format!("devices/{device}/scene.toml"));
    assert!(kept("right").exists() && !kept("left").exists());
}

#[test]
fn two_devices_of_one_name_are_refused_before_anything_starts() {
    let state = tempfile::tempdir().unwrap();
    let twice = ["serve", "--device", "cho-2005", "--device", "cho-2005", "--state-dir"];
    let refused = finish(hapticd().args(twice).arg(state.path()));
    refused.refused(&["devices[1].name = cho-2005", "--device ID="]);
}
