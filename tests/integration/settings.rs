//! Settings over real gRPC and on the command line: masks, refusals, and what they do.

use hapticd::proto::{
    DisableRequest, EnableRequest, GetDescriptionRequest, GetSettingsRequest, GetStateRequest,
    GuardSettings, Limit, Role, Settings, State, Strategy, ToolSettings, UpdateSettingsRequest,
    Vector3,
};
use prost_types::FieldMask;
use tonic::{Code, Status};

use super::support::{DEVICE, Rig, run, state_where};

fn change(paths: &[&str], settings: Settings) -> UpdateSettingsRequest {
    let paths = paths.iter().map(|path| (*path).to_owned()).collect();
    let settings = Settings { name: DEVICE.into(), ..settings };
    UpdateSettingsRequest { settings: Some(settings), update_mask: Some(FieldMask { paths }) }
}

fn expect<T: std::fmt::Debug>(answer: Result<T, Status>, code: Code, words: &[&str]) {
    let status = answer.unwrap_err();
    assert_eq!(status.code(), code, "{status}");
    for word in words {
        assert!(status.message().contains(word), "{word:?} is not in {:?}", status.message());
    }
}

#[test]
fn a_mask_changes_what_it_names_all_or_nothing() {
    let rig = Rig::start();
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let get = || GetSettingsRequest { name: DEVICE.into() };
        let before = devices.get_settings(get()).await.unwrap().into_inner();
        assert_eq!((before.revision, before.force_gain, before.force_limit_n), (1, 1.0, 1000.0));
        assert_eq!(before.strategy(), Strategy::Auto);

        let wanted = Settings {
            force_gain: 0.5,
            force_limit_n: 7.0,
            tool: Some(ToolSettings { radius_m: 0.01, ..ToolSettings::default() }),
            ..Settings::default()
        };
        let request = change(&["force_gain", "tool.radius_m"], wanted.clone());
        let after = devices.update_settings(request).await.unwrap().into_inner();
        assert_eq!((after.revision, after.force_gain, after.force_limit_n), (2, 0.5, 1000.0));
        assert_eq!(after.tool.as_ref().unwrap().radius_m, 0.01);
        assert_eq!(after.guards, before.guards);
        assert_eq!(devices.get_settings(get()).await.unwrap().into_inner(), after);

        // The second value is wrong, so the first one is not taken either.
        let wrong = Settings {
            force_gain: 0.1,
            guards: Some(GuardSettings { max_overruns: 0, ..GuardSettings::default() }),
            ..Settings::default()
        };
        let refused =
            devices.update_settings(change(&["force_gain", "guards.max_overruns"], wrong));
        let words = ["settings.guards.max_overruns = 0", "1 to 1000000 ticks"];
        expect(refused.await, Code::InvalidArgument, &words);
        for (paths, settings, words) in [
            (vec![], wanted.clone(), vec!["update_mask.paths = (none)", "force_gain"]),
            (vec!["colour"], wanted.clone(), vec!["update_mask.paths[0] = \"colour\""]),
            (vec!["guards"], wanted.clone(), vec!["settings.guards = (none)", "required"]),
            (vec!["mount"], wanted.clone(), vec!["settings.mount = (none)"]),
            (vec!["strategy"], wanted.clone(), vec!["settings.strategy = 0", "STRATEGY_SLIDING"]),
            (
                vec!["force_gain"],
                Settings { force_gain: f64::NAN, ..Settings::default() },
                vec!["settings.force_gain = NaN", "0 to 1"],
            ),
        ] {
            let refused = devices.update_settings(change(&paths, settings)).await;
            expect(refused, Code::InvalidArgument, &words);
        }
        let late = Settings { revision: 1, force_gain: 0.9, ..Settings::default() };
        let refused = devices.update_settings(change(&["force_gain"], late)).await;
        expect(refused, Code::Aborted, &["settings.revision = 1", "revision 2"]);
        let elsewhere = UpdateSettingsRequest {
            settings: Some(Settings { name: "devices/other".into(), ..Settings::default() }),
            update_mask: None,
        };
        let refused = devices.update_settings(elsewhere).await;
        expect(refused, Code::NotFound, &["settings.name = \"devices/other\""]);
        assert_eq!(devices.get_settings(get()).await.unwrap().into_inner(), after);
    });
}

#[test]
fn settings_are_in_force_when_they_are_answered_and_stay_with_a_scene_edit() {
    let rig = Rig::start();
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let offset_m = Some(Vector3 { x: 0.0, y: 0.5, z: 0.25 });
        let wanted = Settings {
            force_limit_n: 12.5,
            strategy: Strategy::NearestReference.into(),
            tool: Some(ToolSettings { offset_m, ..ToolSettings::default() }),
            ..Settings::default()
        };
        let request = change(&["force_limit_n", "strategy", "tool.offset_m"], wanted);
        devices.update_settings(request).await.unwrap();
        let described = devices.get_description(GetDescriptionRequest { name: DEVICE.into() });
        assert_eq!(described.await.unwrap().get_ref().force_limit_n, 12.5);
        let state = || GetStateRequest { name: DEVICE.into() };
        let z_m = |state: &hapticd::proto::DeviceState| {
            state.measured_cp.as_ref().unwrap().position_m.as_ref().unwrap().z
        };
        assert_eq!(z_m(devices.get_state(state()).await.unwrap().get_ref()), 0.25);

        let point = "0,0.4,0";
        let connect = rig.target().to_string();
        let wall = ["ctl", "wall", "add", "table", "--point", point, "--normal=0,-1,0"];
        run(&[&wall[..], &["--stiffness", "500", "--connect", &connect]].concat()).ok();
        let seen = devices.get_state(state()).await.unwrap().into_inner();
        assert_eq!((z_m(&seen), seen.scene_revision), (0.25, 2), "kept with the scene's edit");
        let breeze = ["ctl", "object", "add", "breeze", "constant", "--force", "0,5,0"];
        run(&[&breeze[..], &["--connect", &connect]].concat()).ok();
        let seen = devices.get_state(state()).await.unwrap().into_inner();
        assert_eq!(seen.law(), Strategy::NearestReference);
    });
}

#[test]
fn after_enable_the_force_grows() {
    let rig = Rig::start();
    let connect = rig.target().to_string();
    let breeze = ["ctl", "object", "add", "breeze", "constant", "--force", "0,5,0"];
    run(&[&breeze[..], &["--connect", &connect]].concat()).ok();
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let slowly = Settings { activation_ramp_ms: 1_000.0, ..Settings::default() };
        devices.update_settings(change(&["activation_ramp_ms"], slowly)).await.unwrap();
        devices.disable(DisableRequest { name: DEVICE.into() }).await.unwrap();
        devices.enable(EnableRequest { name: DEVICE.into() }).await.unwrap();
        let bit = 1 << (Limit::Activation as u32 - 1);
        let growing = |state: &State| state.limits & bit != 0;
        let mut observer = rig.client("observer", Role::Observer).await;
        // Asked is what the field wants all the while; chosen is less of it.
        let state = state_where(&mut observer, growing).await;
        assert!((state.requested[1] - 5.0).abs() < 1e-6, "{:?}", state.requested);
        assert!(state.achievable[1] < 4.999, "{:?}", state.achievable);
        state_where(&mut observer, |state| !growing(state)).await;
    });
}

#[test]
fn the_command_line_shows_and_changes_settings() {
    let rig = Rig::start();
    let connect = rig.target().to_string();
    let ctl = |arguments: &[&str]| run(&[&["ctl", "--connect", &connect], arguments].concat());
    let shown = ctl(&["settings"]).ok().stdout;
    assert!(shown.contains("revision 1") && shown.contains("  force_gain = 1\n"), "{shown}");
    let changed = ctl(&["set", "force_gain=0.5", "tool.points_m=0.01,0,0;-0.01,0,0", "--json"]);
    let changed: serde_json::Value = serde_json::from_str(&changed.ok().stdout).unwrap();
    assert_eq!((&changed["force_gain"], &changed["revision"]), (&0.5.into(), &2.into()));
    assert_eq!(changed["tool.points_m"], "0.01,0,0;-0.01,0,0");
    assert!(ctl(&["strategy", "sliding"]).ok().stdout.contains("  strategy = sliding\n"));
    ctl(&["set", "force_gain=2"]).refused(&["settings.force_gain = 2", "0 to 1"]);
    ctl(&["set", "force_gain"]).refused(&["must be KEY=VALUE"]);
    ctl(&["set", "colour=red"]).refused(&["colour", "no such setting"]);
    ctl(&["set", "force_gain=1", "--revision", "1"]).refused(&["revision 3"]);
    ctl(&["strategy", "magic"]).refused(&["magic", "predicted-velocity"]);
}
