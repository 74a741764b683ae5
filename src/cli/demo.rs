//! `hapticd demo`: a daemon, a simulated hand, and a scene in a process of its own.

use std::fs::File;
use std::io::{IsTerminal, Read, Seek};
use std::net::{IpAddr, Ipv4Addr};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context;
use clap::{Args, Subcommand};

use super::format::parse_seconds;
use super::netsim::BadPath;
use super::view;
use crate::app::netsim::Netsim;
use crate::app::{Daemon, Logs, Start, init_log};
use crate::client::{ConnectString, Transport};
use crate::config::{LogLevel, ServedDevice, ServerConfig};
use crate::device::HandProgram;
use crate::telemetry::RunFigures;

/// Time for the scene to say goodbye by itself before it is ended.
const FAREWELL: Duration = Duration::from_secs(2);

/// Lines shown of a scene that ended by itself.
const LAST_LINES: usize = 5;

/// See a device at work: daemon, simulated hand and a scene over a real socket.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd demo wall
  hapticd demo wall --seconds 10 --json")]
pub struct Demo {
    #[command(subcommand)]
    demo: Which,
}

#[derive(Debug, Subcommand)]
enum Which {
    Wall(Wall),
}

/// The experiment of Cho 2005: a hand presses 10 N into a wall at x = 0.3 m of 1e7 N/m and
/// slides along it in -y at 0.1 m/s. On a smaller device all lengths shrink to its reach, and
/// motors get the stiffest wall that they can hold.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd demo wall
  hapticd demo wall --seconds 10 --json
  hapticd demo wall --device cho-2005-unoptimised --seconds 20
  hapticd demo wall --device kim-2003 --seconds 10
  hapticd demo wall --delay-ms 100 --loss-percent 30 --burst 10")]
struct Wall {
    /// End after this time; without it, at Ctrl-C or q
    #[arg(long, value_name = "N", value_parser = parse_seconds, allow_negative_numbers = true)]
    seconds: Option<Duration>,
    /// Print the run's figures as one JSON object, and nothing else, on stdout
    #[arg(long)]
    json: bool,
    /// Built-in device or device file
    #[arg(long, value_name = "NAME|FILE", default_value = "cho-2005")]
    device: String,
    /// Program of the simulated hand: hold, press-and-slide, circle, random, pointer
    #[arg(long, value_name = "PROGRAM", default_value = "press-and-slide")]
    hand: HandProgram,
    /// Keep state here instead of in a folder that is removed afterwards
    #[arg(long, value_name = "DIR")]
    state_dir: Option<PathBuf>,
    /// What carries the scene's stream: quic, webtransport or udp
    #[arg(long, value_name = "TRANSPORT", default_value_t = Transport::Quic)]
    transport: Transport,
    #[command(flatten)]
    path: BadPath,
}

impl Demo {
    /// Runs until its time is over or it is ended.
    pub fn run(self) -> anyhow::Result<()> {
        let Which::Wall(wall) = self.demo;
        wall.run()
    }
}

impl Wall {
    fn run(self) -> anyhow::Result<()> {
        let scratch = tempfile::tempdir().context("no folder for the demo's state")?;
        let state_dir = self.state_dir.clone().unwrap_or_else(|| scratch.path().to_owned());
        let mut config = ServerConfig {
            devices: vec![ServedDevice {
                source: self.device.clone(),
                hand: self.hand,
                ..ServedDevice::default()
            }],
            state_dir: Some(state_dir),
            ..ServerConfig::default()
        };
        config.log.level = LogLevel::Warn;
        let logs = init_log(&config.log)?;
        let mut daemon = Daemon::start(&config, Start { or_free_ports: true })?;
        announce(&daemon, &logs);
        let wall = daemon.devices()[0].host().definition().demo_wall(self.hand);
        let (_netsim, reached_by) = self.network(&daemon)?;
        let mut scene = Scene::start(&reached_by, self.transport)?;
        let until = self.seconds.map(|seconds| Instant::now() + seconds);
        let live = !self.json && std::io::stdout().is_terminal();
        if live {
            logs.flush();
            view::live(&mut daemon, &wall, until, &mut || scene.check())?;
        } else {
            let tell = |line: String| if self.json { logs.line(&line) } else { say!("{line}") };
            view::plain(&mut daemon, until, &tell, &mut || scene.check())?;
        }
        scene.stop();
        daemon.stop();
        print(&daemon.devices()[0].figures(), self.json)
    }

    /// The bad network between daemon and scene, if one is asked for, and how the scene reaches
    /// the daemon.
    fn network(&self, daemon: &Daemon) -> anyhow::Result<(Option<[Netsim; 2]>, ConnectString)> {
        let direct = daemon.connect_string();
        if !self.path.is_bad() {
            return Ok((None, direct.clone()));
        }
        let here = IpAddr::V4(Ipv4Addr::LOCALHOST);
        let ip = direct.host.parse().unwrap_or(here);
        let (proxies, through) = self.path.stand_before(direct, ip, (here, 0).into())?;
        Ok((Some(proxies), through))
    }
}

/// Says on stderr where everything is.
fn announce(daemon: &Daemon, logs: &Logs) {
    logs.line(&format!("stream   {}", daemon.connect_string()));
    logs.line(&format!("gRPC     {}", daemon.grpc_address));
    logs.line(&format!("metrics  http://{}/metrics", daemon.http_address));
}

fn print(figures: &RunFigures, as_json: bool) -> anyhow::Result<()> {
    if as_json {
        say!("{}", serde_json::to_string(figures)?);
        return Ok(());
    }
    let value = serde_json::to_value(figures)?;
    say!("");
    for (name, value) in value.as_object().into_iter().flatten() {
        match value.as_f64().filter(|_| value.is_f64()) {
            Some(number) => say!("{name:<30} {number:.3}"),
            None => say!("{name:<30} {value}"),
        }
    }
    Ok(())
}

/// The scene's process.
struct Scene {
    child: Child,
    /// What it says; shown when it ends by itself.
    stderr: File,
}

impl Scene {
    fn start(server: &ConnectString, transport: Transport) -> anyhow::Result<Self> {
        let program = std::env::current_exe().context("cannot find this program")?;
        let stderr = tempfile::tempfile().context("no file for what the scene says")?;
        let child = Command::new(program)
            .args(["scene", "wall", "--connect", &server.to_string()])
            .args(["--transport", transport.name()])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(stderr.try_clone()?)
            .spawn()
            .context("cannot start the scene's process")?;
        Ok(Self { child, stderr })
    }

    /// Fails when the scene has ended by itself.
    fn check(&mut self) -> anyhow::Result<()> {
        let ended = self.child.try_wait()?;
        match ended {
            None => Ok(()),
            Some(status) => {
                let said = self.last_lines();
                anyhow::bail!("the scene's process ended early ({status}), it said:\n{said}")
            }
        }
    }

    fn last_lines(&mut self) -> String {
        let mut text = Vec::new();
        // What cannot be read is not shown; that it ended is the news.
        let _ = self.stderr.rewind().and_then(|()| self.stderr.read_to_end(&mut text));
        let text = String::from_utf8_lossy(&text);
        let lines: Vec<_> = text.lines().collect();
        let last = &lines[lines.len().saturating_sub(LAST_LINES)..];
        if last.is_empty() { "  (nothing)".into() } else { format!("  {}", last.join("\n  ")) }
    }

    /// Asks it to end, and ends it if it does not.
    fn stop(&mut self) {
        if let Some(pid) = rustix::process::Pid::from_raw(self.child.id() as i32) {
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::INT);
        }
        let deadline = Instant::now() + FAREWELL;
        while Instant::now() < deadline {
            if !matches!(self.child.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) {
            self.stop();
        }
    }
}
