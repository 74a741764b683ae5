//! A running daemon: its devices, its threads, its sockets.

use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Context, ensure};

use super::device::{ReadyDevice, RunningDevice};
use super::reachable;
use super::services::{Listeners, Services};
use super::sockets::Sockets;
use crate::archive::Archive;
use crate::audit::{AuditLog, What};
use crate::client::{ConnectString, DEFAULT_UDP_PORT};
use crate::clock::now_ns;
use crate::config::{
    DeviceDefinition, RealtimePolicy, ServedDevice, ServerConfig, StateDir, default_state_dir,
    load_devices,
};
use crate::credentials::Keyring;
use crate::host::Hosts;
use crate::net::{
    self, Access, BrowserIdentity, Caller, Gate, GrpcParts, HttpParts, Identity, Reach, Security,
    StreamHandle, StreamParts,
};
use crate::rt::{self, Processor, Realtime, RtConfig};
use crate::session::SessionConfig;
use crate::telemetry::Telemetry;
use crate::units::FieldError;

/// SCHED_FIFO priority of the stream thread, or just below the loops' where that is lower.
const STREAM_PRIORITY: u8 = 40;

/// How a daemon is started, beside its configuration.
#[derive(Clone, Copy, Debug, Default)]
pub struct Start {
    /// Replace ports in use by free ones.
    pub or_free_ports: bool,
}

/// A running daemon.
#[derive(Debug)]
pub struct Daemon {
    stream: StreamHandle,
    services: Services,
    gate: Arc<Gate>,
    ended: bool,
    devices: Vec<RunningDevice>,
    connect: ConnectString,
    /// Where `/metrics` is.
    pub http_address: SocketAddr,
    /// Where HTTPS is, beyond loopback.
    pub https_address: Option<SocketAddr>,
    /// Where the services are.
    pub grpc_address: SocketAddr,
    // Waits for recordings under way when it goes, so it goes after the recorders.
    _archive: Arc<Archive>,
    // Keeps the state directory locked.
    _state_dir: StateDir,
}

impl Daemon {
    /// Starts everything.
    pub fn start(config: &ServerConfig, start: Start) -> anyhow::Result<Self> {
        let telemetry = Telemetry::new()?;
        let Ready { devices, state_dir, identity, browser, archive, gate, sockets } =
            Ready::new(config, start, &telemetry)?;
        let sha256 = identity.sha256();
        let grpc_address = sockets.grpc.local_addr()?;
        let http_address = sockets.http.local_addr()?;
        let https_address = sockets.https.as_ref().map(TcpListener::local_addr).transpose()?;
        let Sockets { stream, sealed, grpc, http, https } = sockets;
        let listeners = Listeners {
            grpc: (grpc, identity.grpc_security(config.is_guarded())?),
            http: (http, reach(config)),
            https: match https {
                Some(https) => Some((https, https_security(config, &identity)?)),
                None => None,
            },
        };
        let mut services = Services::prepare(listeners)?;

        let (mut connected, mut streamed) = (Vec::new(), Vec::new());
        for device in devices {
            let sessions = session_config(config, &device, grpc_address.port());
            let (device, stream) = device.connect(sessions, &telemetry, config.black_box_s)?;
            connected.push(device);
            streamed.push(stream);
        }
        let access = access(config);
        let udp_port = sealed.local_addr()?.port();
        let (sessions, calls) = net::session_calls(udp_port);
        let stream = net::spawn_stream(StreamParts {
            socket: stream,
            sealed,
            identity,
            browser: Arc::clone(&browser),
            access: access.clone(),
            gate: Arc::clone(&gate),
            devices: streamed,
            calls,
            on_start: raise_stream(config.rt_priority),
        })?;
        let mut devices = Vec::new();
        for (i, (device, served)) in connected.into_iter().zip(&config.devices).enumerate() {
            devices.push(device.start(rt_config(config, served, i), &state_dir, &archive)?);
        }
        let connect = ConnectString {
            host: reachable::address(stream.address.ip()).to_string(),
            stream_port: stream.address.port(),
            grpc_port: grpc_address.port(),
            sha256: Some(sha256),
            token: None,
            udp_port: (udp_port != DEFAULT_UDP_PORT).then_some(udp_port),
        };
        let hosts = devices.iter().map(|device| device.host().clone()).collect();
        let hosts = Hosts::new(hosts);
        let stream_port = stream.address.port();
        let http_port = http_address.port();
        let http = HttpParts {
            scrape: telemetry.scrape(),
            hosts: hosts.clone(),
            browser,
            stream_port,
            access,
        };
        let how = if gate.is_guarded() { "credentials are needed" } else { "nobody is asked" };
        gate.record(What::Started, &Caller::local(), "", "", how);
        let own_gate = Arc::clone(&gate);
        let access = http.access.clone();
        let archived = Arc::clone(&archive);
        let parts = GrpcParts { hosts, sessions, archive: archived, gate, access, http_port };
        services.serve(&http, parts)?;
        let (_archive, _state_dir) = (archive, state_dir);
        Ok(Self {
            stream,
            services,
            gate: own_gate,
            ended: false,
            devices,
            connect,
            http_address,
            https_address,
            grpc_address,
            _archive,
            _state_dir,
        })
    }

    /// How clients reach it.
    pub fn connect_string(&self) -> &ConnectString {
        &self.connect
    }

    /// What it serves, in the order of the configuration; at least one.
    pub fn devices(&self) -> &[RunningDevice] {
        &self.devices
    }

    /// Waits for Ctrl-C or SIGTERM, at most until `until`; true when one has come. One that
    /// came since the start counts.
    pub fn wait_for_signal(&mut self, until: Option<Instant>) -> bool {
        self.services.wait_for_signal(until)
    }

    /// Stops in order: clients are told, calls under way are answered, the devices are let go,
    /// and everything they did is in their figures.
    pub fn stop(&mut self) {
        self.services.close();
        self.stream.stop();
        self.services.stop();
        // All of them let go before anything that takes its time.
        self.devices.iter_mut().for_each(RunningDevice::let_go);
        self.devices.iter_mut().for_each(RunningDevice::stop);
        if !std::mem::replace(&mut self.ended, true) {
            self.gate.record(What::Ended, &Caller::local(), "", "", "");
        }
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        self.stop();
    }
}

/// What is read, made and bound before any thread starts; what is wrong with any of it is
/// said here.
struct Ready {
    devices: Vec<ReadyDevice>,
    state_dir: StateDir,
    identity: Identity,
    browser: Arc<BrowserIdentity>,
    archive: Arc<Archive>,
    gate: Arc<Gate>,
    sockets: Sockets,
}

impl Ready {
    fn new(config: &ServerConfig, start: Start, telemetry: &Telemetry) -> anyhow::Result<Self> {
        let definitions = load_devices(&config.devices)?;
        let state_dir = StateDir::open(state_path(config)?)?;
        let ready = |(served, definition): (&ServedDevice, DeviceDefinition)| {
            ReadyDevice::new(served, definition, &state_dir)
        };
        let devices = config.devices.iter().zip(definitions).map(ready);
        let devices = devices.collect::<Result<_, _>>()?;
        let identity = Identity::load_or_create(state_dir.path())?;
        let browser = Arc::new(BrowserIdentity::load_or_create(state_dir.path())?);
        let gate = Arc::new(gate(config, state_dir.path(), telemetry)?);
        let sockets = Sockets::bind(config, start.or_free_ports)?;
        let archive = Arc::new(Archive::open(state_dir.path())?);
        Ok(Self { devices, state_dir, identity, browser, archive, gate, sockets })
    }
}

/// Beyond loopback with the credentials that were issued; without any, nobody could come.
fn gate(config: &ServerConfig, state_dir: &Path, telemetry: &Telemetry) -> anyhow::Result<Gate> {
    let keyring = config.is_guarded().then(|| Keyring::open(state_dir)).transpose()?;
    let nobody = keyring.as_ref().is_some_and(|keyring| keyring.credentials().list().is_empty());
    let allowed = "nobody has a credential yet, so nobody could come in: \
                   hapticd pair NAME --role ROLE makes one, with the same --config and \
                   --state-dir; insecure = true (--insecure) asks nobody for any";
    ensure!(!nobody, FieldError::new("server.listen", config.listen, allowed));
    let audit = AuditLog::open(state_dir)
        .with_context(|| format!("cannot write the audit log in {}", state_dir.display()))?;
    Ok(Gate::new(keyring, audit, telemetry.turned_away()))
}

/// Who hears what is said on plain HTTP.
fn reach(config: &ServerConfig) -> Reach {
    let here = config.http_address().is_loopback() || config.insecure;
    if here { Reach::Here } else { Reach::Watchers }
}

/// With the certificate that browsers were said to trust, else with the server's own.
fn https_security(config: &ServerConfig, identity: &Identity) -> anyhow::Result<Security> {
    let Some((certificate, key)) = &config.https_files else {
        return Ok(identity.https_security()?);
    };
    Ok(Identity::load(certificate, key)?.https_security()?)
}

/// The machine's own name is one of the server's.
fn access(config: &ServerConfig) -> Access {
    let own = rustix::system::uname().nodename().to_string_lossy().into_owned();
    let names = config.names.iter().cloned().chain([format!("{own}.local"), own]).collect();
    Access { names, origins: config.origins.clone() }
}

/// A force waits for the stream thread too. Always below the loop, above everything ordinary;
/// denied, it goes on as it is: the loop is denied the same and says so.
fn raise_stream(rt_priority: u8) -> Box<dyn Fn() + Send> {
    let priority = STREAM_PRIORITY.min(rt_priority.saturating_sub(1));
    Box::new(move || {
        if priority > 0 {
            let _ = rt::fifo(priority);
        }
    })
}

/// Where the state of a server of this configuration is.
pub(crate) fn state_path(config: &ServerConfig) -> anyhow::Result<PathBuf> {
    let default = || default_state_dir(|name| std::env::var_os(name));
    config.state_dir.clone().or_else(default).context(
        "state_dir is not set (--state-dir), and neither XDG_STATE_HOME nor HOME is: say where state may be kept",
    )
}

/// Of one device; those that do not name a processor share out the allowed ones.
fn rt_config(config: &ServerConfig, served: &ServedDevice, place: usize) -> RtConfig {
    let realtime = match config.realtime {
        RealtimePolicy::BestEffort => Realtime::BestEffort,
        RealtimePolicy::Enforce => Realtime::Enforce,
    };
    let cpu = served.rt_cpu.map_or(Processor::FromLast(place), Processor::Number);
    RtConfig { realtime, priority: config.rt_priority, cpu }
}

fn session_config(config: &ServerConfig, device: &ReadyDevice, grpc_port: u16) -> SessionConfig {
    let DeviceDefinition { name, mechanism, tick_ns, .. } = &device.definition;
    let utc_ns = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos());
    SessionConfig {
        max_sessions: config.session.max_sessions,
        takes_hands: device.takes_hands(),
        default_ttl_ms: config.session.default_ttl_ms,
        default_wrench_ttl_ms: config.session.default_wrench_ttl_ms,
        max_age_ms: config.session.max_age_ms,
        max_contacts_age_ms: config.session.max_contacts_age_ms,
        max_ttl_ms: config.session.max_ttl_ms,
        grpc_port,
        example_wall: Some(device.example_wall()),
        utc_minus_device_ns: (utc_ns as i64).wrapping_sub(now_ns() as i64),
        ..SessionConfig::new(
            name.as_str(),
            *tick_ns,
            mechanism.freedoms() as u32,
            mechanism.actuators() as u32,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whoever may hear plain HTTP beyond this machine gets no token and calls nothing.
    #[test]
    fn plain_http_beyond_this_machine_is_for_those_who_watch() {
        let of = |lines: &str| {
            reach(&ServerConfig::from_toml(&format!("[server]\n{lines}"), "f").unwrap())
        };
        assert_eq!(of(""), Reach::Here);
        assert_eq!(of("listen = \"0.0.0.0\""), Reach::Here);
        assert_eq!(of("listen = \"0.0.0.0\"\ninsecure = true"), Reach::Here);
        assert_eq!(of("http_listen = \"0.0.0.0\""), Reach::Watchers);
        assert_eq!(of("http_listen = \"0.0.0.0\"\nlisten = \"0.0.0.0\""), Reach::Watchers);
    }
}
