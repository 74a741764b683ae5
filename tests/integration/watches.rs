//! WatchEvents and WatchDevices over real gRPC: what happens arrives, in order, with its number.

use std::time::Duration;

use hapticd::client::Devices;
use hapticd::proto::{
    DeviceEvent, DisableRequest, EnableRequest, EventKind, Mode, WatchDevicesRequest,
    WatchEventsRequest,
};
use tonic::{Code, Streaming};

use super::support::{DEVICE, Rig, run, wait_until};

fn from(after_id: Option<u64>) -> WatchEventsRequest {
    WatchEventsRequest { name: DEVICE.into(), after_id, only_past: false }
}

async fn watch(devices: &mut Devices, after_id: Option<u64>) -> Streaming<DeviceEvent> {
    devices.watch_events(from(after_id)).await.unwrap().into_inner()
}

async fn off_and_on(devices: &mut Devices) {
    devices.disable(DisableRequest { name: DEVICE.into() }).await.unwrap();
    devices.enable(EnableRequest { name: DEVICE.into() }).await.unwrap();
}

/// The next mode that is told, and its number.
async fn next_mode(events: &mut Streaming<DeviceEvent>) -> (Mode, u64) {
    loop {
        let told = events.message().await.unwrap().expect("the server is there");
        let event = told.event.unwrap();
        if event.kind() == EventKind::Mode {
            assert_eq!(event.value, told.mode as u32);
            return (told.mode(), event.id);
        }
    }
}

fn holding() -> Rig {
    Rig::with(|config| config.devices[0].hand = "hold".parse().unwrap())
}

#[test]
fn events_come_as_they_happen_and_again_from_any_number() {
    let rig = holding();
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let mut live = watch(&mut devices, None).await;
        off_and_on(&mut devices).await;
        let (mode, first) = next_mode(&mut live).await;
        assert_eq!(mode, Mode::Disabled);
        let (mode, second) = next_mode(&mut live).await;
        assert!(mode == Mode::Enabled && second > first);
        // The same again, from the history; then from a number in between.
        let mut again = watch(&mut devices, Some(0)).await;
        assert_eq!(next_mode(&mut again).await, (Mode::Disabled, first));
        assert_eq!(next_mode(&mut again).await, (Mode::Enabled, second));
        let mut later = watch(&mut devices, Some(first)).await;
        assert_eq!(next_mode(&mut later).await, (Mode::Enabled, second));
        let beyond = devices.watch_events(from(Some(second + 1_000_000))).await.unwrap_err();
        assert_eq!(beyond.code(), Code::InvalidArgument);
        assert!(beyond.message().contains("after_id = 1"), "{beyond}");
        let other = WatchEventsRequest { name: "devices/x".into(), ..from(None) };
        assert_eq!(devices.watch_events(other).await.unwrap_err().code(), Code::NotFound);
    });
}

#[test]
fn a_reader_that_is_too_slow_is_told_what_it_missed() {
    let rig = holding();
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let mut slow = watch(&mut devices, Some(0)).await;
        off_and_on(&mut devices).await;
        let (_, first) = next_mode(&mut slow).await;
        // More than the history holds, and what waits on the way; nobody reads.
        let host = rig.daemon().devices()[0].host();
        for _ in 0..600 {
            off_and_on(&mut devices).await;
        }
        let newest = host.events().last();
        assert!(newest - first > 1_100, "{first} {newest}");
        let mut reader = watch(&mut devices, Some(first)).await;
        let told = reader.message().await.unwrap().unwrap();
        assert_eq!(told.event.unwrap().id, first + told.missed + 1);
        assert!(told.missed > 50, "{}", told.missed);
        let (mut last, mut missed) = (told.event.unwrap().id, 0);
        while last < newest {
            let told = reader.message().await.unwrap().unwrap();
            assert_eq!(told.event.unwrap().id, last + told.missed + 1);
            (last, missed) = (told.event.unwrap().id, missed + told.missed);
        }
        assert_eq!(missed, 0, "what is kept is told without a gap");
        // The one that was there all the while and did not read is told of every gap, too.
        let mut last = first;
        while last < newest {
            let told = slow.message().await.unwrap().unwrap();
            assert_eq!(told.event.unwrap().id, last + told.missed + 1);
            last = told.event.unwrap().id;
        }
    });
}

#[test]
fn devices_are_listed_at_once_and_when_their_mode_changes() {
    let rig = holding();
    rig.run(async {
        let mut devices = rig.services().await.devices;
        let watched = devices.watch_devices(WatchDevicesRequest {}).await;
        let mut lists = watched.unwrap().into_inner();
        for wanted in [Mode::Enabled, Mode::Disabled, Mode::Enabled] {
            let list = lists.message().await.unwrap().unwrap().devices;
            let [only] = list.as_slice() else { panic!("{list:?}") };
            assert_eq!((only.name.as_str(), only.simulated), (DEVICE, true));
            assert_eq!(only.mode(), wanted, "{only:?}");
            let name = DEVICE.to_owned();
            match wanted {
                Mode::Enabled => drop(devices.disable(DisableRequest { name }).await.unwrap()),
                _ => drop(devices.enable(EnableRequest { name }).await.unwrap()),
            }
        }
        let last = lists.message().await.unwrap().unwrap().devices;
        assert_eq!(last[0].mode(), Mode::Disabled);
        // Nothing changes, nothing comes.
        let silent = tokio::time::timeout(Duration::from_millis(200), lists.message()).await;
        assert!(silent.is_err(), "{silent:?}");
    });
}

#[test]
fn the_command_prints_what_happened() {
    let rig = holding();
    rig.run(async { off_and_on(&mut rig.services().await.devices).await });
    wait_until("the events in the history", || {
        rig.daemon().devices()[0].host().events().last() >= 2
    });
    let connect = rig.target().to_string();
    let ctl = |arguments: &[&str]| run(&[&["ctl", "--connect", &connect], arguments].concat());
    let told = ctl(&["events"]).ok().stdout;
    assert!(told.contains("mode disabled\n") && told.contains("mode enabled\n"), "{told}");
    let told = ctl(&["events", "--json"]).ok().stdout;
    let ids: Vec<u64> = told
        .lines()
        .map(|line| {
            serde_json::from_str::<serde_json::Value>(line).unwrap()["id"].as_u64().unwrap()
        })
        .collect();
    assert!(ids.len() >= 2 && ids.is_sorted(), "{ids:?}");
    ctl(&["events", "--after", "99999"]).refused(&["after_id = 99999"]);
    let listed = ctl(&["devices"]).ok().stdout;
    assert_eq!(listed, "devices/cho-2005: enabled (five-bar, simulated)\n");
}
