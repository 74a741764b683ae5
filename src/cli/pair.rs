//! `hapticd pair`: credentials of a server, made, listed and taken back beside it.
//!
//! It works on the files of the state directory: whoever may write them may let others in.

use std::fs::{File, OpenOptions};
use std::io::{IsTerminal, Write};
use std::net::IpAddr;
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use clap::Args;
use serde_json::{Value, json};

use super::qr::Code;
use super::serve::Settings;
use crate::app::{reachable_address, state_path};
use crate::audit::{self, Event, What};
use crate::client::{ConnectString, DEFAULT_UDP_PORT};
use crate::config::{ServerConfig, load_devices};
use crate::credentials::{
    Credential, CredentialFile, Grant, LOCAL, Token, Wanted, check_device, check_name, private,
};
use crate::net::Identity;
use crate::units::FieldError;
use crate::utc::Utc;

/// What [`Identity`] keeps in the state directory.
const IDENTITY: &str = "identity.pem";

/// Longest name of a host (RFC 1035 section 2.3.4).
const LONGEST_HOST: usize = 253;

/// Longest time that a credential is made for: ten years.
const MOST_DAYS: i64 = 3650;

/// Make a credential for somebody, and print the connect string with it; or list or revoke them.
#[derive(Debug, Args)]
#[command(after_help = "Roles, each with those before it: observer watches, controller commands a
device, operator decides about devices and about others. The token in the connect string is shown
once: the server keeps only its hash.

Examples:
  hapticd pair anna --role controller
  hapticd pair headset-3 --role observer --device left --days 30 --svg headset-3.svg
  hapticd pair anna --role operator --replace --config /etc/hapticd.toml --host lab.example
  hapticd pair --list
  hapticd pair --revoke anna")]
pub struct Pair {
    /// Name of the credential: up to 64 of A-Z, a-z, 0-9, -, _ and .; it stands in lists and logs
    #[arg(value_name = "NAME", required_unless_present_any = ["list", "revoke"])]
    name: Option<String>,
    /// What it allows: observer, controller or operator
    #[arg(long, value_name = "ROLE", required_unless_present_any = ["list", "revoke"])]
    role: Option<Grant>,
    /// Valid for this device alone, not for all of the server's
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
    /// Days until it expires; without this it holds until it is revoked
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    days: Option<i64>,
    /// Where clients reach the server; by default the address that it listens on, or where that
    /// is all of them, this machine's own
    #[arg(long, value_name = "HOST", allow_hyphen_values = true)]
    host: Option<String>,
    /// Take the place of a credential of that name, whose token is worth nothing then
    #[arg(long)]
    replace: bool,
    /// Write the connect string as a QR code here; must not exist
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Show the QR code although stderr is no terminal
    #[arg(long)]
    qr: bool,
    /// List the credentials of the server
    #[arg(long, conflicts_with_all = ISSUE)]
    list: bool,
    /// Take this credential back
    #[arg(long, value_name = "NAME", conflicts_with_all = ISSUE, conflicts_with = "list")]
    revoke: Option<String>,
    /// Configuration file of the server
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Where that server keeps its state
    #[arg(long, value_name = "DIR")]
    state_dir: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// What only the making of one takes.
const ISSUE: [&str; 8] = ["name", "role", "device", "days", "host", "replace", "svg", "qr"];

impl Pair {
    /// Does it and prints the outcome.
    pub fn run(self) -> anyhow::Result<()> {
        let settings = Settings {
            config: self.config.clone(),
            state_dir: self.state_dir.clone(),
            ..Settings::default()
        };
        let config = settings.server_config()?;
        let state_dir = state_path(&config)?;
        let file = CredentialFile::in_directory(&state_dir);
        if self.list {
            print_list(file.load()?.list(), Utc::now(), self.json);
            return Ok(());
        }
        if let Some(name) = &self.revoke {
            return revoke(&file, &state_dir, name, self.json);
        }
        let wanted = self.wanted()?;
        let connect = self.connect(&config)?;
        warn(&config, &wanted);
        self.issue(&file, &state_dir, wanted, connect)
    }

    /// What is asked for, checked before anything is made.
    fn wanted(&self) -> anyhow::Result<Wanted> {
        let (name, grant) =
            self.name.clone().zip(self.role).context("NAME and --role are missing")?;
        check_name("NAME", &name)?;
        let device = self.device.as_ref().map(|device| check_device("--device", device));
        let days = self.days.map(|days| {
            let allowed = format!("must be a whole number in 1 to {MOST_DAYS} days");
            let inside = (1..=MOST_DAYS).contains(&days).then(|| u32::try_from(days).ok());
            inside.flatten().ok_or_else(|| FieldError::new("--days", days, allowed))
        });
        let (device, days) = (device.transpose()?, days.transpose()?);
        Ok(Wanted { name, grant, device, days, replace: self.replace })
    }

    /// How clients reach the server, without what only its state directory knows.
    fn connect(&self, config: &ServerConfig) -> anyhow::Result<ConnectString> {
        for (key, port) in [("stream_port", config.stream_port), ("grpc_port", config.grpc_port)] {
            let allowed = "must be a port, 1 to 65535: with 0, any free one, no connect string \
                           leads to the server when it starts again";
            ensure!(port != 0, FieldError::new(format!("server.{key}"), port, allowed));
        }
        let host = match &self.host {
            Some(host) => host.trim_matches(['[', ']']).to_owned(),
            None => host(config.listen),
        };
        check_host(&host)?;
        let ServerConfig { stream_port, grpc_port, udp_port, .. } = *config;
        // Any free one is said by the server itself.
        let udp_port = Some(udp_port).filter(|port| ![0, DEFAULT_UDP_PORT].contains(port));
        let local = ConnectString::local(stream_port, grpc_port);
        Ok(ConnectString { host, udp_port, ..local })
    }

    fn issue(
        &self,
        file: &CredentialFile,
        state_dir: &Path,
        wanted: Wanted,
        connect: ConnectString,
    ) -> anyhow::Result<()> {
        let identity = Identity::load_or_create(state_dir)?;
        private::adopt(&state_dir.join(IDENTITY))
            .with_context(|| format!("cannot use {IDENTITY}"))?;
        let svg = self.svg.as_ref().map(|path| Ok((path, new_secret(path)?)));
        let svg = svg.transpose().map_err(|error: anyhow::Error| error)?;
        let issued = file.issue(wanted, Utc::now());
        // An empty picture would only be in the way of the next attempt.
        let (token, made) = issued.inspect_err(|_| {
            if let Some((path, _)) = &svg {
                let _ = std::fs::remove_file(path);
            }
        })?;
        record(state_dir, What::CredentialIssued, &made);
        let connect = with_secret(connect, &identity, &token).to_string();
        self.print(&made, &connect);
        self.draw(&connect)?;
        if let Some((path, mut picture)) = svg {
            let written = picture.write_all(Code::for_paper(&connect)?.svg().as_bytes());
            written.with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(())
    }

    fn print(&self, made: &Credential, connect: &str) {
        if self.json {
            let mut object = credential_json(made, Utc::now());
            object["connect"] = connect.into();
            say!("{object}");
        } else {
            say!("{connect}");
            eprintln!("{}: {}", made.name, in_words(made));
            eprintln!("The line above lets its reader in, and cannot be shown again.");
        }
    }

    fn draw(&self, connect: &str) -> anyhow::Result<()> {
        let mut stderr = std::io::stderr();
        let terminal = stderr.is_terminal();
        if self.qr || (terminal && !self.json) {
            let code = Code::for_screen(connect)?.text(terminal);
            stderr.write_all(code.as_bytes()).context("cannot write to stderr")?;
        }
        Ok(())
    }
}

fn with_secret(connect: ConnectString, identity: &Identity, token: &Token) -> ConnectString {
    let token = Some(token.as_str().to_owned());
    ConnectString { sha256: Some(identity.sha256()), token, ..connect }
}

/// What stands in a connect string as it is, and is no host with a port.
fn check_host(host: &str) -> Result<(), FieldError> {
    let inside = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.".contains(&byte);
    let named = host.starts_with(|c: char| c.is_ascii_alphanumeric()) && host.bytes().all(inside);
    if (named && host.len() <= LONGEST_HOST) || host.parse::<IpAddr>().is_ok() {
        return Ok(());
    }
    let shown: String = host.chars().take(LONGEST_HOST).collect();
    let allowed = "must be a host name or an IP address, without a port";
    Err(FieldError::new("--host", format!("{shown:?}"), allowed))
}

/// A name that others may resolve is better than an address that leads back to them.
fn host(listen: IpAddr) -> String {
    let address = reachable_address(listen);
    if address.is_loopback() && listen.is_unspecified() {
        rustix::system::uname().nodename().to_string_lossy().into_owned()
    } else {
        address.to_string()
    }
}

/// What is allowed, but may not be what was meant.
fn warn(config: &ServerConfig, wanted: &Wanted) {
    if config.listen.is_loopback() {
        eprintln!(
            "hapticd: server.listen = {}: as configured, the server is reached from this machine \
             only, and so this credential works only here",
            config.listen
        );
    }
    // A device file that cannot be read is the server's to tell.
    let Some((device, served)) = wanted.device.as_ref().zip(load_devices(&config.devices).ok())
    else {
        return;
    };
    let served: Vec<_> = served.iter().map(|device| format!("devices/{}", device.name)).collect();
    if !served.contains(device) {
        eprintln!(
            "hapticd: --device = {device}: as configured, the server has {}",
            served.join(", ")
        );
    }
}

/// A new file that nobody else may read.
fn new_secret(path: &Path) -> anyhow::Result<File> {
    let file = private::open(path, OpenOptions::new().write(true).create_new(true));
    file.with_context(|| format!("--svg = {}: cannot be made", path.display()))
}

fn revoke(file: &CredentialFile, state_dir: &Path, name: &str, json: bool) -> anyhow::Result<()> {
    check_name("--revoke", name)?;
    let revoked = file.revoke(name)?;
    record(state_dir, What::CredentialRevoked, &revoked);
    if json {
        say!("{}", json!({ "name": name, "revoked": true }));
    } else {
        say!("{name} revoked");
    }
    Ok(())
}

/// Into the audit log; where that cannot be, what was done stays done.
fn record(state_dir: &Path, what: What, credential: &Credential) {
    let detail = format!("{}: {}", credential.name, in_words(credential));
    let device = credential.device.as_deref().unwrap_or_default();
    let event = Event { what, who: LOCAL, from: "", device, detail: &detail };
    if let Err(error) = audit::append(state_dir, &event) {
        eprintln!("hapticd: this is not in the audit log, which cannot be written: {error}");
    }
}

fn in_words(credential: &Credential) -> String {
    let Credential { grant, device, expires, .. } = credential;
    let device = device.as_deref().unwrap_or("all devices");
    let until = expires.map_or("until it is revoked".to_owned(), |at| format!("until {at}"));
    format!("{grant} of {device}, {until}")
}

fn print_list(list: &[Credential], now: Utc, as_json: bool) {
    if as_json {
        let list: Vec<_> = list.iter().map(|entry| credential_json(entry, now)).collect();
        say!("{}", Value::from(list));
        return;
    }
    if list.is_empty() {
        say!("nobody has a credential");
    }
    for entry in list {
        let expires = entry.expires.map_or("never".to_owned(), |at| at.to_string());
        let expired = if entry.is_expired(now) { "  expired" } else { "" };
        say!(
            "{:<24} {:<11} {:<20} issued {}  expires {expires}{expired}",
            entry.name,
            entry.grant.name(),
            entry.device.as_deref().unwrap_or("all devices"),
            entry.issued,
        );
    }
}

fn credential_json(entry: &Credential, now: Utc) -> Value {
    json!({
        "name": entry.name,
        "role": entry.grant.name(),
        "device": entry.device,
        "issued": entry.issued.to_string(),
        "expires": entry.expires.map(|at| at.to_string()),
        "expired": entry.is_expired(now),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_on_all_addresses_is_not_at_the_loopback_of_others() {
        assert_eq!(host("192.0.2.7".parse().unwrap()), "192.0.2.7");
        assert_eq!(host("::1".parse().unwrap()), "::1");
        for listen in ["0.0.0.0", "::"] {
            let host = host(listen.parse().unwrap());
            assert!(!host.is_empty() && host != listen);
            assert!(!host.parse().is_ok_and(|ip: IpAddr| ip.is_loopback()), "{host}");
        }
    }
}
