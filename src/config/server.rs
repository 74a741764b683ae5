//! The one file of `hapticd serve`: addresses, device, real-time policy, logs, sessions.
//!
//! Every key is optional; [`EXAMPLE`] shows all of them with their defaults. What a command
//! line says ([`Overrides`]) takes the place of the file's value before anything is checked.
//! Beyond loopback everybody needs a credential, unless that is switched off in so many words.

use std::ffi::OsString;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::path::PathBuf;

use serde::Deserialize;

use super::served::{ServedDevice, check_count};
use super::server_layout::ServerLayout;
use super::{ConfigError, error};
use crate::device::HandProgram;
use crate::units::FieldError;

/// The whole file with its defaults and an explanation of every key.
pub const EXAMPLE: &str = include_str!("../../deploy/hapticd.example.toml");

/// What the server needs.
#[derive(Clone, Debug, PartialEq)]
pub struct ServerConfig {
    /// Address to listen on.
    pub listen: IpAddr,
    /// TCP port of gRPC, 0 for any free one.
    pub grpc_port: u16,
    /// UDP port of the stream, 0 for any free one.
    pub stream_port: u16,
    /// UDP port of sealed datagrams, 0 for any free one.
    pub udp_port: u16,
    /// Names by which browsers may call the server, beside its addresses and localhost.
    pub names: Vec<String>,
    /// Pages from elsewhere that may connect.
    pub origins: Vec<String>,
    /// TCP port of plain HTTP, 0 for any free one.
    pub http_port: u16,
    /// Address of plain HTTP, where it is not [`ServerConfig::http_address`]'s own choice.
    pub http_listen: Option<IpAddr>,
    /// TCP port of HTTPS, 0 for any free one.
    pub https_port: u16,
    /// Certificate of HTTPS and its key, PEM files; `None`: the server's own.
    pub https_files: Option<(PathBuf, PathBuf)>,
    /// Credentials are needed on loopback as well.
    pub require_credentials: bool,
    /// Listening beyond loopback without credentials was asked for.
    pub insecure: bool,
    /// What is served; at least one.
    pub devices: Vec<ServedDevice>,
    /// What happens without real-time rights.
    pub realtime: RealtimePolicy,
    /// SCHED_FIFO priority of the loops.
    pub rt_priority: u8,
    /// Where state is kept; `None`: see [`default_state_dir`].
    pub state_dir: Option<PathBuf>,
    /// Seconds that a fault's black box keeps of what came before it; 0: there is none.
    pub black_box_s: f64,
    /// What is logged, and how.
    pub log: LogConfig,
    /// Bounds on sessions and their commands.
    pub session: SessionLimits,
}

/// What happens where a real-time right is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RealtimePolicy {
    /// Start, and say what was denied.
    #[default]
    BestEffort,
    /// Refuse to start.
    Enforce,
}

/// What is logged, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LogConfig {
    /// Least important events that are logged.
    pub level: LogLevel,
    /// One line per event, for people or for machines.
    pub format: LogFormat,
}

/// Importance of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LogLevel {
    /// Something failed.
    Error,
    /// Something is not as it should be.
    Warn,
    /// Something changed.
    #[default]
    Info,
    /// Why it changed.
    Debug,
    /// Every step.
    Trace,
}

impl LogLevel {
    /// The name that `tracing` filters understand.
    pub fn name(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Warn => "warn",
            Self::Info => "info",
            Self::Debug => "debug",
            Self::Trace => "trace",
        }
    }
}

/// How a logged event looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LogFormat {
    /// For people.
    #[default]
    Human,
    /// One JSON object.
    Json,
}

/// Bounds on sessions and their commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SessionLimits {
    /// More are refused.
    pub max_sessions: usize,
    /// How long contacts and fields hold that do not say so.
    pub default_ttl_ms: u32,
    /// How long a wrench holds that does not say so.
    pub default_wrench_ttl_ms: u32,
    /// How long any command can hold.
    pub max_ttl_ms: u32,
    /// A wrench or force field computed from an older State is refused.
    pub max_age_ms: u32,
    /// The same of contacts.
    pub max_contacts_age_ms: u32,
}

/// What a command line says; it takes the place of the file's value.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overrides {
    /// `--device`, as often as there are devices
    pub devices: Vec<String>,
    /// `--hand`
    pub hand: Option<HandProgram>,
    /// `--state-dir`
    pub state_dir: Option<PathBuf>,
    /// `--listen`
    pub listen: Option<IpAddr>,
    /// `--insecure`
    pub insecure: bool,
}

impl Default for ServerConfig {
    fn default() -> Self {
        Self {
            listen: IpAddr::V4(Ipv4Addr::LOCALHOST),
            grpc_port: 7350,
            stream_port: 7351,
            udp_port: 7352,
            http_port: 7353,
            http_listen: None,
            https_port: 7354,
            https_files: None,
            names: Vec::new(),
            origins: Vec::new(),
            require_credentials: false,
            insecure: false,
            devices: vec![ServedDevice::default()],
            realtime: RealtimePolicy::default(),
            rt_priority: 80,
            state_dir: None,
            black_box_s: 10.0,
            log: LogConfig::default(),
            session: SessionLimits {
                max_sessions: 64,
                default_ttl_ms: 100,
                default_wrench_ttl_ms: 20,
                max_ttl_ms: 200,
                max_age_ms: 200,
                max_contacts_age_ms: 1000,
            },
        }
    }
}

impl ServerConfig {
    /// The configuration in the text of a file; `file` is for messages only.
    pub fn from_toml(text: &str, file: &str) -> Result<Self, ConfigError> {
        Self::with_overrides(text, file, Overrides::default())
    }

    /// The same with what the command line says; an empty text is all defaults.
    pub fn with_overrides(text: &str, file: &str, over: Overrides) -> Result<Self, ConfigError> {
        let layout: ServerLayout = error::parse(text, file)?;
        let usual = layout.usual_device().map_err(ConfigError::field(file))?;
        let mut config = layout.check(&usual).map_err(ConfigError::field(file))?;
        if !over.devices.is_empty() {
            let of = |text: &String| usual.of("--device", text);
            let devices = over.devices.iter().map(of).collect::<Result<_, _>>();
            config.devices = devices.map_err(ConfigError::field("command line"))?;
            check_count(config.devices.len()).map_err(ConfigError::field("command line"))?;
        }
        for device in &mut config.devices {
            device.hand = over.hand.unwrap_or(device.hand);
        }
        config.state_dir = over.state_dir.or(config.state_dir);
        config.listen = over.listen.unwrap_or(config.listen);
        config.insecure |= over.insecure;
        if config.insecure && config.require_credentials {
            let allowed = "must be false where server.require_credentials is true";
            return Err(ConfigError::field(file)(FieldError::new(
                "server.insecure",
                true,
                allowed,
            )));
        }
        Ok(config)
    }

    /// Whether everybody is asked for a credential: beyond loopback, unless that was switched off
    /// in so many words, and wherever it was switched on.
    pub fn is_guarded(&self) -> bool {
        self.require_credentials || !self.listen.is_loopback() && !self.insecure
    }

    /// Address of plain HTTP: nobody on the way is to hear it, unless that was asked for.
    pub fn http_address(&self) -> IpAddr {
        let here = || match self.listen {
            _ if !self.is_guarded() => self.listen,
            IpAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
            IpAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
        };
        self.http_listen.unwrap_or_else(here)
    }
}

/// Where state is kept by default: `$XDG_STATE_HOME/hapticd`, else `~/.local/state/hapticd`.
/// `variable` looks up an environment variable; `None` where neither is usable.
pub fn default_state_dir(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    let absolute = |name| variable(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let state_home = absolute("XDG_STATE_HOME");
    let base = state_home.or_else(|| Some(absolute("HOME")?.join(".local/state")));
    base.map(|base| base.join("hapticd"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(text: &str) -> String {
        ServerConfig::from_toml(text, "server.toml").unwrap_err().to_string()
    }

    #[test]
    fn the_example_is_all_defaults() {
        let example = ServerConfig::from_toml(EXAMPLE, "example").unwrap();
        assert_eq!(example, ServerConfig::default());
        assert_eq!(ServerConfig::from_toml("", "empty").unwrap(), example);
    }

    #[test]
    fn the_example_mentions_every_key_and_explains_it() {
        // The layouts themselves say which keys there are.
        for (table, at_least) in
            [("", 10), ("[server]\n", 5), ("[log]\n", 2), ("[session]\n", 3), ("[[devices]]\n", 4)]
        {
            let said = refusal(&format!("{table}no-such-key = 1"));
            let expected = said.split_once("expected").expect(&said).1;
            let keys: Vec<_> = expected.split('`').skip(1).step_by(2).collect();
            assert!(keys.len() >= at_least, "{said}");
            for key in keys {
                let starts = [
                    format!("{key} = "),
                    format!("# {key} = "),
                    format!("[{key}]"),
                    format!("# [[{key}]]"),
                ];
                let lines: Vec<_> = EXAMPLE.lines().collect();
                let found = lines
                    .iter()
                    .position(|line| starts.iter().any(|start| line.starts_with(start)));
                let line = found.unwrap_or_else(|| panic!("{key} is not in the example"));
                let comment = line > 0 && lines[line - 1].starts_with('#');
                assert!(comment || lines[line].starts_with('['), "{key} is not explained");
            }
        }
    }

    #[test]
    fn the_keys_left_out_of_the_example_are_right_too() {
        let (keys, devices) = EXAMPLE.split_once("# [[devices]]").unwrap();
        let text = keys.replace("# rt_cpu", "rt_cpu").replace("# state_dir", "state_dir");
        let config = ServerConfig::from_toml(&text, "example").unwrap();
        assert_eq!(config.devices[0].rt_cpu, Some(1));
        assert_eq!(config.state_dir, Some("/var/lib/hapticd".into()));
        let devices = format!("[[devices]]{}", devices.replace("# As ", "#").replace("\n# ", "\n"));
        let devices = devices.replace("It is", "# It is");
        let config = ServerConfig::from_toml(&devices, "example").unwrap();
        assert_eq!(config.devices[0].name.as_ref().unwrap().as_str(), "left");
    }

    #[test]
    fn each_bad_value_is_refused_by_its_key_path() {
        for (text, named) in [
            (
                "[server]\ngrpc_port = 65536",
                "server.grpc_port = 65536: must be a number in 0 to 65535",
            ),
            ("[server]\nstream_port = -1", "server.stream_port = -1"),
            ("[server]\nhttp_port = \"x\"", "server.http_port: invalid type"),
            ("[server]\nlisten = \"localhost\"", "server.listen = \"localhost\""),
            ("[server]\nlsten = \"::1\"", "server.lsten: unknown field"),
            ("hand = \"wave\"", "hand = \"wave\": must be one of \"hold\""),
            (
                "realtime = \"always\"",
                "realtime: unknown variant `always`, expected `best-effort` or `enforce`",
            ),
            ("rt_priority = 0", "rt_priority = 0: must be a number in 1 to 99"),
            ("rt_cpu = 1e3", "rt_cpu: invalid type"),
            ("[log]\nlevel = \"loud\"", "log.level: unknown variant `loud`"),
            ("[session]\nmax_sessions = 0", "session.max_sessions = 0"),
            (
                "[session]\nmax_ttl_ms = 50",
                "session.default_ttl_ms = 100: must be at most session.max_ttl_ms = 50 ms",
            ),
            ("[session]\ndefault_ttl_ms = -1", "session.default_ttl_ms = -1"),
        ] {
            let said = refusal(text);
            assert!(said.starts_with("server.toml:") && said.contains(named), "{named}: {said}");
        }
    }

    #[test]
    fn beyond_loopback_credentials_are_needed_and_plain_http_stays_here() {
        for (listen, http) in [
            ("0.0.0.0", "127.0.0.1"),
            ("192.168.1.2", "127.0.0.1"),
            ("::", "::1"),
            ("2001:db8::1", "::1"),
        ] {
            let text = format!("[server]\nlisten = \"{listen}\"\n");
            let config = ServerConfig::from_toml(&text, "f").unwrap();
            assert!(config.is_guarded());
            assert_eq!(config.http_address().to_string(), http);
            let seen = format!("{text}http_listen = \"192.168.1.2\"");
            let seen = ServerConfig::from_toml(&seen, "f").unwrap().http_address();
            assert_eq!(seen.to_string(), "192.168.1.2");
            let asked = ServerConfig::from_toml(&format!("{text}insecure = true"), "f").unwrap();
            assert!(!asked.is_guarded());
            assert_eq!(asked.http_address(), asked.listen);
            let over = Overrides { insecure: true, ..Overrides::default() };
            assert!(!ServerConfig::with_overrides(&text, "f", over).unwrap().is_guarded());
        }
        for listen in ["127.0.0.1", "127.3.2.1", "::1"] {
            let over = Overrides { listen: listen.parse().ok(), ..Overrides::default() };
            let config = ServerConfig::with_overrides("", "f", over).unwrap();
            assert!(!config.is_guarded());
            assert_eq!(config.http_address(), config.listen);
        }
        let text = "[server]\nrequire_credentials = true\n";
        assert!(ServerConfig::from_toml(text, "f").unwrap().is_guarded(), "on loopback, too");
        let said = refusal(&format!("{text}insecure = true"));
        assert!(said.contains("server.insecure = true: must be false where"), "{said}");
    }

    #[test]
    fn a_certificate_comes_with_its_key() {
        let text = "[server]\nhttps_certificate = \"a.pem\"\nhttps_key = \"b.pem\"\n";
        let config = ServerConfig::from_toml(text, "f").unwrap();
        assert_eq!(config.https_files, Some(("a.pem".into(), "b.pem".into())));
        for (key, missing) in
            [("https_certificate", "https_key"), ("https_key", "https_certificate")]
        {
            let said = refusal(&format!("[server]\n{key} = \"a.pem\""));
            assert!(said.contains(&format!("server.{missing} = (none)")), "{said}");
        }
    }

    #[test]
    fn the_command_line_goes_before_the_file() {
        let over = Overrides {
            devices: vec!["two-link".into()],
            hand: Some(HandProgram::Hold),
            state_dir: Some("/elsewhere".into()),
            ..Overrides::default()
        };
        let text = "device = \"cho-2005-crossed\"\nhand = \"circle\"\nstate_dir = \"/there\"\n";
        let config = ServerConfig::with_overrides(text, "f", over).unwrap();
        let [device] = config.devices.as_slice() else { panic!("one device") };
        assert_eq!((device.source.as_str(), device.hand), ("two-link", HandProgram::Hold));
        assert_eq!(config.state_dir, Some("/elsewhere".into()));
    }

    #[test]
    fn state_is_kept_where_xdg_says() {
        let with = |state_home: Option<&'static str>, home: Option<&'static str>| {
            default_state_dir(move |name| match name {
                "XDG_STATE_HOME" => state_home.map(OsString::from),
                "HOME" => home.map(OsString::from),
                _ => None,
            })
        };
        assert_eq!(with(Some("/s"), Some("/h")), Some("/s/hapticd".into()));
        assert_eq!(with(None, Some("/h")), Some("/h/.local/state/hapticd".into()));
        assert_eq!(with(Some("relative"), Some("/h")), Some("/h/.local/state/hapticd".into()));
        assert_eq!(with(Some(""), None), None);
    }
}
