//! A device with incremental encoders: it does not know where it is until it is told.

use std::path::Path;

use hapticd::config::BUILT_IN;
use hapticd::proto::{
    DisableRequest, EnableRequest, ExplainRequest, GetDescriptionRequest, GetStateRequest,
    HomeRequest, Homing, Mode, Reason,
};
use tonic::Code;

use super::support::{DEVICE, Rig, run};

/// `cho-2005` with incremental encoders, homed where its handle starts and is held.
fn incremental(folder: &Path) -> Rig {
    let (_, text) = BUILT_IN.into_iter().find(|(name, _)| *name == "cho-2005").unwrap();
    let text = text.replace(
        "kind = \"absolute\"",
        "kind = \"incremental\"\nhome_m = [0.285, 0.35] # where it starts",
    );
    let file = folder.join("cho-2005.toml");
    std::fs::write(&file, text).unwrap();
    Rig::with(|config| {
        config.devices[0].source = file.display().to_string();
        config.devices[0].hand = "hold".parse().unwrap();
    })
}

#[test]
fn incremental_encoders_are_homed_before_anything_is_enabled() {
    let folder = tempfile::tempdir().unwrap();
    let rig = incremental(folder.path());
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let name = || DEVICE.to_owned();
        let described = devices.get_description(GetDescriptionRequest { name: name() }).await;
        let home_m = described.unwrap().into_inner().home_m.unwrap();
        assert_eq!((home_m.x, home_m.y, home_m.z), (0.285, 0.35, 0.0));
        let state = devices.get_state(GetStateRequest { name: name() }).await.unwrap().into_inner();
        assert_eq!((state.mode(), state.homing()), (Mode::Disabled, Homing::Needed));
        let refused = devices.enable(EnableRequest { name: name() }).await.unwrap_err();
        assert_eq!(refused.code(), Code::FailedPrecondition);
        assert!(refused.message().contains("home the device first"), "{refused}");
        let why = ExplainRequest { name: name(), ..ExplainRequest::default() };
        let why = devices.explain(why).await.unwrap().into_inner();
        assert_eq!(why.reasons[0].reason(), Reason::NotHomed, "{why:?}");

        let homed = devices.home(HomeRequest { name: name() }).await.unwrap().into_inner();
        assert_eq!((homed.mode(), homed.homing()), (Mode::Disabled, Homing::Done));
        let at_m = homed.measured_cp.unwrap().position_m.unwrap();
        // A count is 0.1 mrad of a shaft.
        assert!((at_m.x - 0.285).hypot(at_m.y - 0.35) < 2e-3, "{at_m:?}");
        devices.enable(EnableRequest { name: name() }).await.unwrap();
        let again = devices.home(HomeRequest { name: name() }).await.unwrap_err();
        assert_eq!(again.code(), Code::FailedPrecondition);
        assert!(again.message().contains("disable the device first"), "{again}");
        devices.disable(DisableRequest { name: name() }).await.unwrap();
        devices.home(HomeRequest { name: name() }).await.unwrap();
    });
}

#[test]
fn absolute_encoders_need_no_home_and_say_so() {
    let rig = Rig::start();
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let state = devices.get_state(GetStateRequest { name: DEVICE.into() }).await.unwrap();
        assert_eq!(state.get_ref().homing(), Homing::NotNeeded);
    });
    let connect = rig.target().to_string();
    let refused = run(&["ctl", "home", "--connect", &connect]);
    refused.refused(&["Home is not needed", "encoders are absolute"]);
}

#[test]
fn the_command_homes_and_shows_where_the_handle_is() {
    let folder = tempfile::tempdir().unwrap();
    let rig = incremental(folder.path());
    let connect = rig.target().to_string();
    let ctl = |action: &str| run(&["ctl", action, "--connect", &connect]);
    assert!(ctl("describe").ok().stdout.contains("to be homed at (0.285, 0.35) m"));
    assert!(ctl("state").ok().stdout.contains("homing      needed"));
    ctl("enable").refused(&["home the device first"]);
    let homed = ctl("home").ok().stdout;
    assert!(homed.contains("(0.28") && !homed.contains("needed"), "{homed}");
    assert!(ctl("enable").ok().stdout.contains("enabled"));
}
