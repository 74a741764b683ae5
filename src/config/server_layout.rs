//! The layout of the server file, and the check of each of its values.
//!
//! Numbers are read as TOML's own integers and checked here, so that a refusal can name the
//! range; an absent key takes its value from [`ServerConfig::default`].

use std::net::IpAddr;
use std::path::PathBuf;

use serde::Deserialize;

use super::served::{DeviceTable, ServedDevice, check_devices, check_hand, check_processor};
use super::server::{LogConfig, RealtimePolicy, ServerConfig, SessionLimits};
use crate::units::{self, FieldError};

/// The layout of the file.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ServerLayout {
    device: Option<String>,
    hand: Option<String>,
    realtime: RealtimePolicy,
    rt_priority: Option<i64>,
    rt_cpu: Option<i64>,
    state_dir: Option<PathBuf>,
    black_box_s: Option<f64>,
    server: AddressLayout,
    log: LogConfig,
    session: SessionLayout,
    devices: Vec<DeviceTable>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct AddressLayout {
    listen: Option<String>,
    grpc_port: Option<i64>,
    stream_port: Option<i64>,
    udp_port: Option<i64>,
    names: Option<Vec<String>>,
    origins: Option<Vec<String>>,
    http_port: Option<i64>,
    http_listen: Option<String>,
    https_port: Option<i64>,
    https_certificate: Option<PathBuf>,
    https_key: Option<PathBuf>,
    require_credentials: bool,
    insecure: bool,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct SessionLayout {
    max_sessions: Option<i64>,
    default_ttl_ms: Option<i64>,
    default_wrench_ttl_ms: Option<i64>,
    max_ttl_ms: Option<i64>,
    max_age_ms: Option<i64>,
    max_contacts_age_ms: Option<i64>,
}

impl ServerLayout {
    /// What a device has that does not say otherwise.
    pub fn usual_device(&self) -> Result<ServedDevice, FieldError> {
        let usual = ServedDevice::default();
        Ok(ServedDevice {
            hand: self.hand.as_deref().map_or(Ok(usual.hand), check_hand)?,
            rt_cpu: self.rt_cpu.map(check_processor).transpose()?,
            ..usual
        })
    }

    /// The values of all tables.
    pub fn check(self, usual_device: &ServedDevice) -> Result<ServerConfig, FieldError> {
        let usual = ServerConfig::default();
        let devices = check_devices(self.device.as_deref(), usual_device, &self.devices)?;
        let Self { server, session, .. } = self;
        Ok(ServerConfig {
            listen: match server.listen {
                Some(text) => check_address("server.listen", &text)?,
                None => usual.listen,
            },
            grpc_port: whole("server.grpc_port", &units::PORT, server.grpc_port, usual.grpc_port)?,
            stream_port: whole(
                "server.stream_port",
                &units::PORT,
                server.stream_port,
                usual.stream_port,
            )?,
            udp_port: whole("server.udp_port", &units::PORT, server.udp_port, usual.udp_port)?,
            names: texts("server.names", server.names, usual.names)?,
            origins: texts("server.origins", server.origins, usual.origins)?,
            http_port: whole("server.http_port", &units::PORT, server.http_port, usual.http_port)?,
            http_listen: server
                .http_listen
                .map(|text| check_address("server.http_listen", &text))
                .transpose()?,
            https_port: whole(
                "server.https_port",
                &units::PORT,
                server.https_port,
                usual.https_port,
            )?,
            https_files: both(server.https_certificate, server.https_key)?,
            require_credentials: server.require_credentials,
            insecure: server.insecure,
            devices,
            realtime: self.realtime,
            rt_priority: whole(
                "rt_priority",
                &units::PRIORITY,
                self.rt_priority,
                usual.rt_priority,
            )?,
            state_dir: self.state_dir,
            black_box_s: units::BLACK_BOX
                .check("black_box_s", self.black_box_s.unwrap_or(usual.black_box_s))?,
            log: self.log,
            session: session.check(&usual.session)?,
        })
    }
}

impl SessionLayout {
    fn check(&self, usual: &SessionLimits) -> Result<SessionLimits, FieldError> {
        let time = |key: &str, written, usual| {
            whole(&format!("session.{key}"), &units::TIME_TO_LIVE, written, usual)
        };
        let limits = SessionLimits {
            max_sessions: whole(
                "session.max_sessions",
                &units::SESSIONS,
                self.max_sessions,
                usual.max_sessions,
            )?,
            default_ttl_ms: time("default_ttl_ms", self.default_ttl_ms, usual.default_ttl_ms)?,
            default_wrench_ttl_ms: time(
                "default_wrench_ttl_ms",
                self.default_wrench_ttl_ms,
                usual.default_wrench_ttl_ms,
            )?,
            max_ttl_ms: time("max_ttl_ms", self.max_ttl_ms, usual.max_ttl_ms)?,
            max_age_ms: time("max_age_ms", self.max_age_ms, usual.max_age_ms)?,
            max_contacts_age_ms: time(
                "max_contacts_age_ms",
                self.max_contacts_age_ms,
                usual.max_contacts_age_ms,
            )?,
        };
        let defaults = [
            ("session.default_ttl_ms", limits.default_ttl_ms),
            ("session.default_wrench_ttl_ms", limits.default_wrench_ttl_ms),
        ];
        if let Some((key, ms)) = defaults.into_iter().find(|(_, ms)| *ms > limits.max_ttl_ms) {
            let allowed = format!("must be at most session.max_ttl_ms = {} ms", limits.max_ttl_ms);
            return Err(FieldError::new(key, ms, allowed));
        }
        Ok(limits)
    }
}

/// Names of hosts or pages: short, and without anything that is never in one.
fn texts(
    field: &str,
    written: Option<Vec<String>>,
    usual: Vec<String>,
) -> Result<Vec<String>, FieldError> {
    let texts = written.unwrap_or(usual);
    let fits = |text: &String| {
        (1..=253).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_graphic())
    };
    match texts.iter().position(|text| !fits(text)) {
        None => Ok(texts),
        Some(place) => {
            let allowed = "must be 1 to 253 printable ASCII characters without spaces";
            Err(FieldError::new(
                format!("{field}[{place}]"),
                format!("{:?}", texts[place]),
                allowed,
            ))
        }
    }
}

/// A count in its range, or the default where none is written.
fn whole<T: TryFrom<u64>>(
    field: &str,
    range: &units::Range,
    written: Option<i64>,
    usual: T,
) -> Result<T, FieldError> {
    let Some(value) = written else {
        return Ok(usual);
    };
    let refusal = |_| FieldError::new(field, value, format!("must be a whole number in {range}"));
    T::try_from(range.check_whole(field, value)?).map_err(refusal)
}

fn check_address(key: &str, text: &str) -> Result<IpAddr, FieldError> {
    let allowed = "must be an IP address, such as 127.0.0.1 or ::1";
    text.parse().map_err(|_| FieldError::new(key, format!("{text:?}"), allowed))
}

fn both(
    certificate: Option<PathBuf>,
    key: Option<PathBuf>,
) -> Result<Option<(PathBuf, PathBuf)>, FieldError> {
    let missing = |key: &str| {
        let allowed = "must be a PEM file: a certificate and its key go together";
        FieldError::new(key, "(none)", allowed)
    };
    match (certificate, key) {
        (None, None) => Ok(None),
        (Some(certificate), Some(key)) => Ok(Some((certificate, key))),
        (None, Some(_)) => Err(missing("server.https_certificate")),
        (Some(_), None) => Err(missing("server.https_key")),
    }
}
