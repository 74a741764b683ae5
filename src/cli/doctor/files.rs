//! What a server of this configuration would need: its device, its state, its ports.

use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::path::Path;

use rustix::fs::{Access, access};

use super::Finding;
use crate::config::{
    DeviceDefinition, ServerConfig, StateDir, StateError, default_state_dir, load_devices,
};

/// Device, state directory and ports.
pub fn findings(config: &ServerConfig) -> Vec<Finding> {
    let mut findings = Vec::new();
    let devices = load_devices(&config.devices);
    match &devices {
        Ok(devices) => findings.extend(devices.iter().map(|device| {
            Finding::ok("device", format!("{}: {}", device.name, device.description))
        })),
        Err(error) => {
            findings.push(Finding::fail("device", error.to_string(), "correct the device file"));
        }
    }
    let default = || default_state_dir(|name| std::env::var_os(name));
    findings.push(match config.state_dir.clone().or_else(default) {
        Some(path) => state(&path, devices.as_deref().unwrap_or_default()),
        None => {
            let advice = "set state_dir, --state-dir, XDG_STATE_HOME or HOME";
            Finding::fail("state", "no place for it", advice)
        }
    });
    findings.push(ports(config));
    findings
}

fn state(path: &Path, devices: &[DeviceDefinition]) -> Finding {
    let shown = path.display();
    if !path.exists() {
        let above = path.ancestors().find(|above| above.exists()).unwrap_or(Path::new("/"));
        return match access(above, Access::WRITE_OK | Access::EXEC_OK) {
            Ok(()) => Finding::ok("state", format!("{shown} will be created")),
            Err(error) => {
                let found = format!("{shown} cannot be made in {}: {error}", above.display());
                Finding::fail("state", found, "choose another --state-dir, or run as its owner")
            }
        };
    }
    let objects = StateDir::open(path.to_owned()).and_then(|state| {
        let count = |device: &DeviceDefinition| Ok(state.scene(&device.name)?.1.items().len());
        devices.iter().map(count).sum::<Result<usize, StateError>>()
    });
    match objects {
        Ok(objects) => Finding::ok("state", format!("{shown}, {objects} objects in its scenes")),
        Err(StateError::InUse { .. }) => {
            Finding::ok("state", format!("{shown}, in use by a server that runs"))
        }
        Err(error) => Finding::fail("state", error.to_string(), "see to the named file"),
    }
}

fn ports(config: &ServerConfig) -> Finding {
    let at = |port| SocketAddr::new(config.listen, port);
    let tried = [
        ("grpc_port", config.grpc_port, TcpListener::bind(at(config.grpc_port)).map(drop)),
        ("stream_port", config.stream_port, UdpSocket::bind(at(config.stream_port)).map(drop)),
        ("http_port", config.http_port, TcpListener::bind(at(config.http_port)).map(drop)),
    ];
    let taken: Vec<_> = tried
        .iter()
        .filter_map(|(key, port, result)| Some((key, port, result.as_ref().err()?)))
        .map(|(key, port, error)| format!("{key} {port}: {error}"))
        .collect();
    if taken.is_empty() {
        let ports = tried.map(|(_, port, _)| port.to_string()).join(", ");
        Finding::ok("ports", format!("{ports} on {} are free", config.listen))
    } else {
        let advice = "a server that runs already, or choose other ports, or 0 for free ones";
        Finding::warn("ports", taken.join("; "), advice)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Verdict;
    use super::*;
    use crate::config::ServedDevice;

    #[test]
    fn a_scene_that_cannot_be_read_and_a_port_in_use_are_found() {
        let directory = tempfile::tempdir().unwrap();
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        let config = ServerConfig {
            grpc_port: taken.local_addr().unwrap().port(),
            stream_port: 0,
            udp_port: 0,
            http_port: 0,
            state_dir: Some(directory.path().to_owned()),
            ..ServerConfig::default()
        };
        let found = findings(&config);
        let verdicts: Vec<_> = found.iter().map(|found| (found.check, found.verdict)).collect();
        let expected = [("device", Verdict::Ok), ("state", Verdict::Ok), ("ports", Verdict::Warn)];
        assert_eq!(verdicts, expected, "{found:?}");

        let scene = directory.path().join("devices/cho-2005/scene.toml");
        std::fs::create_dir_all(scene.parent().unwrap()).unwrap();
        std::fs::write(&scene, "revision = \"no\"").unwrap();
        let found = &findings(&config)[1];
        assert_eq!(found.verdict, Verdict::Fail);
        assert!(found.found.contains("scene.toml"), "{found:?}");
        assert_eq!(std::fs::read_to_string(&scene).unwrap(), "revision = \"no\"");
    }

    #[test]
    fn a_device_that_does_not_exist_fails() {
        let config = ServerConfig {
            devices: vec![ServedDevice { source: "omega".into(), ..ServedDevice::default() }],
            ..ServerConfig::default()
        };
        assert_eq!(findings(&config)[0].verdict, Verdict::Fail);
    }
}
