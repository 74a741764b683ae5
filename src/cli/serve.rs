//! `hapticd serve`: the daemon.

use std::io::{ErrorKind, Write};
use std::net::IpAddr;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;

use crate::app::{Daemon, Start, init_log};
use crate::client::ConnectString;
use crate::config::{Overrides, ServerConfig};
use crate::device::HandProgram;

/// Serve one device or several: stream, services, metrics. Without anything else, a simulated Cho-2005
/// device with a simulated hand, on this machine only.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd serve
  hapticd serve --device two-link --hand circle
  hapticd serve --device left=cho-2005 --device right=cho-2005
  hapticd serve --config hapticd.toml --state-dir /var/lib/hapticd
  hapticd pair anna --role controller --host 192.0.2.20 && hapticd serve --listen 192.0.2.20

Then, in another terminal:  hapticd scene wall --connect 127.0.0.1:7351 --seconds 30")]
pub struct Serve {
    #[command(flatten)]
    pub settings: Settings,
}

/// What commands that start a daemon have in common.
#[derive(Debug, Default, Args)]
pub struct Settings {
    /// Configuration file; `hapticd config --example` prints one
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Built-in device (cho-2005, cho-2005-unoptimised, cho-2005-crossed, two-link, kim-2003,
    /// singh, singh-brakes) or a device file; several times for several devices, with an ID to call it otherwise
    #[arg(long = "device", value_name = "[ID=]NAME|FILE")]
    pub devices: Vec<String>,
    /// Program of the simulated hand: hold, press-and-slide, circle, random, pointer
    #[arg(long, value_name = "PROGRAM")]
    pub hand: Option<HandProgram>,
    /// Where scenes and the server's identity are kept
    #[arg(long, value_name = "DIR")]
    pub state_dir: Option<PathBuf>,
    /// Address to listen on
    #[arg(long, value_name = "ADDRESS")]
    pub listen: Option<IpAddr>,
    /// Ask nobody for a credential beyond this machine either
    #[arg(long)]
    pub insecure: bool,
}

impl Settings {
    /// The configuration that they amount to.
    pub fn server_config(&self) -> anyhow::Result<ServerConfig> {
        let (text, file) = match &self.config {
            None => (String::new(), "(no file)".to_owned()),
            Some(path) => {
                let text = std::fs::read_to_string(path)
                    .with_context(|| format!("cannot read {}", path.display()))?;
                (text, path.display().to_string())
            }
        };
        let overrides = Overrides {
            devices: self.devices.clone(),
            hand: self.hand,
            state_dir: self.state_dir.clone(),
            listen: self.listen,
            insecure: self.insecure,
        };
        Ok(ServerConfig::with_overrides(&text, &file, overrides)?)
    }
}

impl Serve {
    /// Serves until Ctrl-C or SIGTERM.
    pub fn run(self) -> anyhow::Result<()> {
        let config = self.settings.server_config()?;
        let _logs = init_log(&config.log)?;
        let mut daemon = Daemon::start(&config, Start::default())?;
        announce(daemon.connect_string()).context("cannot write to stdout")?;
        tracing::info!(
            devices = names(&daemon).join(", "),
            grpc = %daemon.grpc_address,
            http = %format!("http://{}/metrics", daemon.http_address),
            https = daemon.https_address.map(|address| format!("https://{address}")),
            credentials = if config.is_guarded() { "needed" } else { "not needed" },
            "serving; Ctrl-C stops"
        );
        daemon.wait_for_signal(None);
        tracing::info!("stopping");
        daemon.stop();
        Ok(())
    }
}

fn names(daemon: &Daemon) -> Vec<String> {
    daemon.devices().iter().map(|device| device.host().definition().name.to_string()).collect()
}

/// Plain, alone on its line and flushed: programs read it. It has no token, which `pair` shows to
/// whom it is for. One that does not want it leaves
/// the server as it is.
fn announce(connect: &ConnectString) -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{connect}").and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written,
    }
}
