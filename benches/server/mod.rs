//! A hapticd in a process of its own, as it is when it serves: with its own memory, its own
//! threads, and nothing of those who load it.
//!
//! The process is the bench itself, started once more with [`SERVE`] and a configuration. It
//! runs the `Daemon` that `hapticd serve` runs, and answers every line on its stdin with the
//! figures since the line before. It ends when its stdin does, that is with the bench, however
//! that ends.

#![allow(dead_code)] // each bench takes what it needs

use std::io::{BufRead, BufReader, Write, stdin, stdout};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::Context;
use hapticd::app::{Daemon, Start};
use hapticd::client::ConnectString;
use hapticd::config::ServerConfig;
use serde_json::Value;

/// First argument of the bench that is to be a server; the second is its configuration.
const SERVE: &str = "--serve";

/// Free ports, and room for more sessions than there usually is.
const TABLES: &str = "\
[server]
grpc_port = 0
stream_port = 0
udp_port = 0
http_port = 0
[session]
max_sessions = 100
";

/// The configuration, if this process is to be the server.
pub fn asked() -> Option<String> {
    let mut arguments = std::env::args().skip_while(|argument| argument != SERVE);
    arguments.nth(1)
}

/// Is the server until stdin ends.
pub fn serve(config: &str) -> anyhow::Result<()> {
    let mut config = ServerConfig::from_toml(config, "the bench's configuration")?;
    // Its own, so that it goes with it whatever becomes of the bench.
    let state = tempfile::tempdir()?;
    config.state_dir = Some(state.path().to_owned());
    let mut daemon = Daemon::start(&config, Start::default())?;
    say(&daemon.connect_string().to_string())?;
    for line in stdin().lines() {
        line?;
        say(&serde_json::to_string(&daemon.devices()[0].take_figures())?)?;
    }
    daemon.stop();
    Ok(())
}

fn say(line: &str) -> std::io::Result<()> {
    let mut out = stdout().lock();
    writeln!(out, "{line}")?;
    out.flush()
}

/// A server's process; it ends when this is dropped.
pub struct Server {
    child: Child,
    // `None`: told to end.
    ask: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
    target: ConnectString,
}

impl Server {
    /// Starts one on free ports. `keys` are lines of its configuration before any table.
    pub fn start(keys: &str) -> anyhow::Result<Self> {
        let config = format!("{keys}\n{TABLES}");
        let mut child = Command::new(std::env::current_exe()?)
            .args([SERVE, &config])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let ask = child.stdin.take();
        let mut answers = BufReader::new(child.stdout.take().context("it has no stdout")?);
        let mut line = String::new();
        answers.read_line(&mut line)?;
        if line.is_empty() {
            anyhow::bail!("the server did not start: {}", child.wait()?);
        }
        let target = line.trim().parse()?;
        Ok(Self { child, ask, answers, target })
    }

    /// How clients reach it.
    pub fn target(&self) -> &ConnectString {
        &self.target
    }

    /// Memory that is its own and not on disk.
    pub fn memory_kib(&self) -> anyhow::Result<i64> {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id()))?;
        let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:"));
        let number = line.and_then(|rest| rest.trim().strip_suffix(" kB"));
        Ok(number.context("the system does not tell")?.trim().parse()?)
    }

    /// What it measured since this was last asked.
    pub fn take_figures(&mut self) -> anyhow::Result<Figures> {
        self.ask.as_mut().context("the server is stopped")?.write_all(b"\n")?;
        let mut line = String::new();
        self.answers.read_line(&mut line)?;
        Ok(Figures(serde_json::from_str(&line).context("the server has ended")?))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.ask.take();
        // What it had to say is on stderr.
        let _ = self.child.wait();
    }
}

/// `RunFigures` by their names.
pub struct Figures(Value);

impl Figures {
    /// One figure that there always is.
    pub fn get(&self, name: &str) -> anyhow::Result<f64> {
        self.0[name].as_f64().with_context(|| format!("{name} was not measured"))
    }
}
