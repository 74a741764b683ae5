//! `hapticd top` and `hapticd ping --baseline` against a real server.

use hapticd::proto::{ListDevicesRequest, Role};
use serde_json::Value;

use super::support::{Rig, next_state, run};

#[test]
fn top_shows_every_device_once_as_text_and_as_json() {
    let rig = Rig::start();
    let connect = rig.target().to_string();
    let _observer = rig.run(async {
        let listed = rig.services().await.devices.list_devices(ListDevicesRequest {}).await;
        let port = listed.unwrap().get_ref().http_port;
        assert_eq!(port, u32::from(rig.daemon().http_address.port()));
        let mut observer = rig.client("observer", Role::Observer).await;
        next_state(&mut observer).await;
        observer
    });
    let text = run(&["top", "--once", "--connect", &connect]).ok().stdout;
    let lines: Vec<_> = text.lines().collect();
    assert!(lines[0].starts_with("device") && lines[1].starts_with("cho-2005"), "{text}");
    assert!(lines[1].contains("enabled") && lines.len() == 3, "{text}");
    let json = run(&["top", "--once", "--json", "--connect", &connect]).ok().stdout;
    let json: Value = serde_json::from_str(&json).unwrap();
    let device = &json["devices"][0];
    assert_eq!(device["name"], "devices/cho-2005");
    assert!(device["ticks_per_s"].as_f64().unwrap() > 0.0, "{device}");
    assert!(device["tick_p99_us"].as_f64().unwrap() > 0.0, "{device}");
    run(&["top", "--connect", &connect]).refused(&["--once"]);
    let nobody = ["top", "--once", "--http", "127.0.0.1:1", "--connect", &connect];
    run(&nobody).refused(&["http://127.0.0.1:1/metrics"]);
}

#[test]
fn ping_compares_with_a_bare_echo_of_the_same_run() {
    let rig = Rig::start();
    let connect = rig.target().to_string();
    let base = ["ping", &connect, "--baseline", "--seconds", "0.5", "--rate", "1000"];
    let json = run(&[&base[..], &["--json"]].concat()).ok().stdout;
    let json: Value = serde_json::from_str(&json).unwrap();
    for transport in ["quic", "webtransport", "udp"] {
        assert!(json[format!("{transport}_ratio")].as_f64().unwrap() > 0.0, "{json}");
        assert!(json[transport]["rounds"].as_u64().unwrap() >= 3, "{json}");
    }
    let one = run(&[&base[..], &["--transport", "udp"]].concat()).ok().stdout;
    assert!(one.contains("bare echo") && !one.contains("quic"), "{one}");
}
